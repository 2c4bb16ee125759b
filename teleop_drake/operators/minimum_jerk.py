"""An operator who moves as hands do: with as little jerk as possible."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.environments import Surface
from teleop_drake.numerics.piecewise_polynomial import (
    differentiate_pieces,
    largest_norm,
    minimum_jerk_pieces,
)
from teleop_drake.operators.base import OperatorConfig
from teleop_drake.operators.profile import ProfileOperator
from teleop_drake.validation import CheckVector, Number, Refuse

Array = NDArray[np.float64]


@dataclass(kw_only=True, eq=False)
class MinimumJerkConfig(OperatorConfig):
    """v_d is that of the path of least jerk through waypoints (Flash and Hogan 1985).

    The path begins and ends at rest and does not stop in between. Each of its pieces
    has a time in proportion to its length, and all of them together are such that the
    fastest speed is |velocity|. Of `velocity` the direction has no effect, except
    where there are no waypoints: then the path leads along it.
    """

    kind = "minimum_jerk"

    # Where to, m from the start, n entries each, one after another different; empty:
    # where `velocity` would have come after `reach_time`.
    waypoints: list[list[float]] = field(default_factory=list)
    # Used without waypoints, s, > 0. Assumed.
    reach_time: float = Number(1.0, "s", above=0)

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; see OperatorConfig.Check."""
        super().Check(path, num_axes)
        previous = np.zeros(num_axes)
        for i, point in enumerate(self.waypoints):
            CheckVector(f"{path}.waypoints.{i}", point, num_axes, "m")
            if np.array_equal(point, previous):
                before = "start" if i == 0 else "waypoint before"
                Refuse(
                    f"{path}.waypoints.{i}", point, f"another point than the {before}"
                )
            previous = np.asarray(point, dtype=float)

    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> ProfileOperator:
        """Makes the block; see OperatorConfig.MakeOperator."""
        breaks, position = self.Path()
        return ProfileOperator(
            breaks=breaks,
            coefficients=differentiate_pieces(position),
            contact_force=self.contact_force,
            contact_surface=contact_surface,
            stop_time=self.stop_time,
            nonsmooth_times=[breaks[-1]],
        )

    def Path(self) -> tuple[Array, Array]:
        """Returns breaks (K + 1) in s and coefficients (K, 6, n) of p_d - start."""
        velocity = np.asarray(self.velocity, dtype=float)
        speed = float(np.linalg.norm(velocity))
        points = np.array(
            [
                0 * velocity,
                *(self.waypoints or [(velocity * self.reach_time).tolist()]),
            ]
        )
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        times = np.concatenate([[0.0], np.cumsum(lengths)]) / speed
        breaks, position = minimum_jerk_pieces(times, points)
        # The path does not depend on how fast it is passed: time is stretched.
        stretch = largest_norm(breaks, differentiate_pieces(position)) / speed
        powers = stretch ** -np.arange(6.0)
        return breaks * stretch, position * powers[np.newaxis, :, np.newaxis]
