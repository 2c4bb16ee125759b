"""The environments of the tool: a file for each kind."""

from teleop_drake.loops.framework.surface import (
    CONTACT,
    PUNCTURE,
    FindSurface,
    Material,
    ShownNormal,
    Surface,
    SurfacesOf,
)
from teleop_drake.model.blocks.environments.base import EnvironmentConfig

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
