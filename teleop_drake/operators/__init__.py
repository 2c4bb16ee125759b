"""Operators of the haptic device."""

from teleop_drake.kinds import KindTable
from teleop_drake.operators.base import OperatorConfig
from teleop_drake.operators.human import HumanConfig
from teleop_drake.operators.planned import (
    ConstantVelocityConfig,
    ConstantVelocityOperator,
    MinimumJerkConfig,
    SineConfig,
    TrapezoidConfig,
)
from teleop_drake.operators.recorded import RecordedConfig

OPERATOR_KINDS = KindTable(
    OperatorConfig,
    (
        ConstantVelocityConfig,
        TrapezoidConfig,
        SineConfig,
        MinimumJerkConfig,
        RecordedConfig,
        HumanConfig,
    ),
    noun="operator",
)
"""Every kind of operator, the default first."""

__all__ = [
    "OPERATOR_KINDS",
    "ConstantVelocityConfig",
    "ConstantVelocityOperator",
    "OperatorConfig",
    "RecordedConfig",
]
