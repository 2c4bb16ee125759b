"""The operators of the haptic device: a file for each kind."""

from teleop_drake.model.blocks.operators.base import OperatorConfig
from teleop_drake.model.blocks.operators.human import HumanConfig
from teleop_drake.model.blocks.operators.move_and_wait import MoveAndWaitConfig
from teleop_drake.model.blocks.operators.planned import (
    ConstantVelocityConfig,
    ConstantVelocityOperator,
    MinimumJerkConfig,
    SineConfig,
    TrapezoidConfig,
)
from teleop_drake.model.blocks.operators.recorded import RecordedConfig
from teleop_drake.model.kinds import KindTable

OPERATOR_KINDS = KindTable(
    OperatorConfig,
    (
        ConstantVelocityConfig,
        TrapezoidConfig,
        SineConfig,
        MinimumJerkConfig,
        RecordedConfig,
        HumanConfig,
        MoveAndWaitConfig,
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
