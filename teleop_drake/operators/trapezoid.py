"""An operator who speeds up, keeps a velocity, and slows down."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.channels.base import SHORTEST_TIME
from teleop_drake.environments import Surface
from teleop_drake.operators.base import OperatorConfig
from teleop_drake.operators.profile import ProfileOperator
from teleop_drake.validation import Number


@dataclass(kw_only=True, eq=False)
class TrapezoidConfig(OperatorConfig):
    """v_d = s(t) velocity, where s rises from 0 to 1, stays, and falls back to 0."""

    kind = "trapezoid"

    # How long v_d rises, and falls, s, >= SHORTEST_TIME. Assumed.
    rise_time: float = Number(0.5, "s", minimum=SHORTEST_TIME)
    # How long it stays at `velocity`, s, >= 0; null: from then on.
    cruise_time: float | None = Number(None, "s", minimum=0)

    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> ProfileOperator:
        """Makes the block; see OperatorConfig.MakeOperator."""
        breaks, coefficients = self._Pieces()
        return ProfileOperator(
            breaks=breaks,
            coefficients=coefficients,
            contact_force=self.contact_force,
            contact_surface=contact_surface,
            stop_time=self.stop_time,
            nonsmooth_times=[x for x in breaks[1:] if math.isfinite(x)],
        )

    def _Pieces(self) -> tuple[list[float], NDArray[np.float64]]:
        """Returns breaks (K + 1) in s and coefficients (K, 2, n)."""
        rise = self.rise_time
        # The value at the beginning and the slope, as shares of the velocity.
        if self.cruise_time is None:
            breaks = [0.0, rise, math.inf]
            shares = [(0.0, 1 / rise), (1.0, 0.0)]
        elif self.cruise_time == 0:
            breaks = [0.0, rise, 2 * rise]
            shares = [(0.0, 1 / rise), (1.0, -1 / rise)]
        else:
            end = rise + self.cruise_time
            breaks = [0.0, rise, end, end + rise]
            shares = [(0.0, 1 / rise), (1.0, 0.0), (1.0, -1 / rise)]
        velocity = np.asarray(self.velocity, dtype=float)
        return breaks, np.array(shares)[:, :, np.newaxis] * velocity
