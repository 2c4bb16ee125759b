"""The kinds of environments that a scenario can name."""

from teleop_drake.model.blocks.environments.base import EnvironmentConfig
from teleop_drake.model.blocks.environments.layered_force_field import (
    LayersEnvironmentConfig,
)
from teleop_drake.model.blocks.environments.needle_path import NeedlePathConfig
from teleop_drake.model.blocks.environments.wall import (
    FrictionWallConfig,
    HuntCrossleyConfig,
    StandardLinearSolidConfig,
)
from teleop_drake.model.kinds import KindTable

ENVIRONMENT_KINDS = KindTable(
    EnvironmentConfig,
    (
        LayersEnvironmentConfig,
        HuntCrossleyConfig,
        FrictionWallConfig,
        StandardLinearSolidConfig,
        NeedlePathConfig,
    ),
    noun="environment",
)
"""Every kind of environment, the default first."""
