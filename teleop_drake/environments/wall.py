"""Base of the environments behind one plane."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.environments.base import EnvironmentConfig
from teleop_drake.environments.surface import (
    CONTACT,
    PlaneSurface,
    Surface,
    UnitNormal,
)
from teleop_drake.validation import REQUIRED, Number


@dataclass(kw_only=True, eq=False)
class WallConfig(EnvironmentConfig):
    """Base of the environments behind one plane, which is the surface `contact`."""

    # Where the plane is along its normal from the origin, m.
    start: float = Number(REQUIRED, "m")
    # Its normal, into the material, n entries, of any length but 0. Null: along x.
    direction: np.ndarray | None = None

    def Check(self) -> None:
        """Checks every field."""
        super().Check()
        if self.direction is not None:
            UnitNormal(self.direction, np.size(self.direction), "direction")

    def Surfaces(self, start: ArrayLike) -> tuple[Surface, ...]:
        """Returns the surface that the block tells."""
        normal_W = UnitNormal(self.direction, np.size(start))
        return (PlaneSurface(CONTACT, self.start, normal_W),)


def PlaneOf(surface: Surface) -> NDArray[np.float64]:
    """Returns a point and the normal of a surface (2, n), as laws take them."""
    return np.array([surface.point_W, surface.normal_W])
