"""The environments of the tool: a file for each kind."""

from teleop_drake.blocks.environments.base import EnvironmentConfig
from teleop_drake.blocks.environments.layered_force_field import (
    LayerConfig,
    LayersEnvironmentConfig,
)
from teleop_drake.blocks.environments.needle_path import NeedlePathConfig
from teleop_drake.blocks.environments.surface import (
    CONTACT,
    PUNCTURE,
    FindSurface,
    Material,
    ShownNormal,
    Surface,
    SurfacesOf,
)
from teleop_drake.blocks.environments.wall import (
    FrictionWallConfig,
    HuntCrossleyConfig,
    StandardLinearSolidConfig,
)
from teleop_drake.kinds import KindTable

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

__all__ = [
    "CONTACT",
    "ENVIRONMENT_KINDS",
    "PUNCTURE",
    "EnvironmentConfig",
    "FindSurface",
    "FrictionWallConfig",
    "HuntCrossleyConfig",
    "LayerConfig",
    "LayersEnvironmentConfig",
    "Material",
    "NeedlePathConfig",
    "ShownNormal",
    "StandardLinearSolidConfig",
    "Surface",
    "SurfacesOf",
]
