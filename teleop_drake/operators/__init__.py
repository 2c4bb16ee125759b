"""Operators of the haptic device: a file for each kind."""

from teleop_drake.kinds import KindTable
from teleop_drake.operators.base import OperatorConfig
from teleop_drake.operators.constant_velocity import (
    ConstantVelocityConfig,
    ConstantVelocityOperator,
)
from teleop_drake.operators.human import HumanConfig
from teleop_drake.operators.minimum_jerk import MinimumJerkConfig
from teleop_drake.operators.recorded import RecordedConfig
from teleop_drake.operators.sine import SineConfig
from teleop_drake.operators.trapezoid import TrapezoidConfig

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
    "HumanConfig",
    "MinimumJerkConfig",
    "OperatorConfig",
    "RecordedConfig",
    "SineConfig",
    "TrapezoidConfig",
]
