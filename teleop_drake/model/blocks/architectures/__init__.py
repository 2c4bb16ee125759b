"""The control architectures: a file for each kind."""

from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBacksteppingConfig,
)
from teleop_drake.model.blocks.architectures.base import (
    Architecture,
    ArchitectureConfig,
    ControlLawConfig,
    Facts,
)
from teleop_drake.model.blocks.architectures.damped_force import DampedForceConfig
from teleop_drake.model.blocks.architectures.direct_force import DirectForceConfig
from teleop_drake.model.blocks.architectures.four_channel import FourChannelConfig
from teleop_drake.model.blocks.architectures.own_law import LawConfig
from teleop_drake.model.blocks.architectures.proportional_damping import (
    ProportionalDampingConfig,
)
from teleop_drake.model.blocks.architectures.robust_backstepping import (
    RobustBacksteppingConfig,
)
from teleop_drake.model.blocks.architectures.smith_predictor import SmithPredictorConfig
from teleop_drake.model.blocks.architectures.time_domain_passivity import (
    TimeDomainPassivityConfig,
)
from teleop_drake.model.blocks.architectures.wave_variables import WaveVariablesConfig
from teleop_drake.model.kinds import KindTable

ARCHITECTURE_KINDS = KindTable(
    ArchitectureConfig,
    (
        DirectForceConfig,
        AdaptiveBacksteppingConfig,
        DampedForceConfig,
        WaveVariablesConfig,
        TimeDomainPassivityConfig,
        ProportionalDampingConfig,
        FourChannelConfig,
        SmithPredictorConfig,
        RobustBacksteppingConfig,
    ),
    noun="controller",
    adapt=LawConfig,
)
"""Every kind of control architecture; the first two are those of the thesis."""

CONTROLLERS = ("direct_force", "adaptive_backstepping")
"""The two controllers of the thesis, the baseline first."""

ARCHITECTURES = ARCHITECTURE_KINDS.names
"""The names of all kinds; the first two are those of the thesis."""

__all__ = [
    "ARCHITECTURES",
    "ARCHITECTURE_KINDS",
    "CONTROLLERS",
    "AdaptiveBacksteppingConfig",
    "Architecture",
    "ArchitectureConfig",
    "ControlLawConfig",
    "DampedForceConfig",
    "DirectForceConfig",
    "Facts",
    "FourChannelConfig",
    "ProportionalDampingConfig",
    "RobustBacksteppingConfig",
    "SmithPredictorConfig",
    "TimeDomainPassivityConfig",
    "WaveVariablesConfig",
]
