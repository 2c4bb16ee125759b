"""The environments of the tool: a file for each kind."""

from teleop_drake.blocks.environments.base import EnvironmentConfig
from teleop_drake.blocks.environments.surface import (
    CONTACT,
    PUNCTURE,
    FindSurface,
    Material,
    ShownNormal,
    Surface,
    SurfacesOf,
)

__all__ = [
    "CONTACT",
    "PUNCTURE",
    "EnvironmentConfig",
    "FindSurface",
    "Material",
    "ShownNormal",
    "Surface",
    "SurfacesOf",
]
