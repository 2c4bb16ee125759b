"""What the tool meets: a file for each kind of environment."""

from teleop_drake.environments.base import EnvironmentConfig
from teleop_drake.environments.layers import LayerConfig, LayersEnvironmentConfig
from teleop_drake.environments.surface import (
    CONTACT,
    PUNCTURE,
    FindSurface,
    Material,
    ShownNormal,
    Surface,
    SurfacesOf,
)
from teleop_drake.kinds import KindTable

ENVIRONMENT_KINDS = KindTable(
    EnvironmentConfig, (LayersEnvironmentConfig,), noun="environment"
)
"""Every kind of environment, the default first."""

__all__ = [
    "CONTACT",
    "ENVIRONMENT_KINDS",
    "PUNCTURE",
    "EnvironmentConfig",
    "FindSurface",
    "LayerConfig",
    "LayersEnvironmentConfig",
    "Material",
    "ShownNormal",
    "Surface",
    "SurfacesOf",
]
