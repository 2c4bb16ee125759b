"""Bounds on the signals of a loop: a run ends where a signal leaves its bound."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import System

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.numerics.pieces import Pieces
from teleop_drake.loops.numerics.step_polynomials import part
from teleop_drake.loops.run.run import Ending, NormBound, Outcome
from teleop_drake.model.laws.task_space import MAX_ROTATION

# Tolerance of a joint's limits, rad or m, for rounding errors of a pose at a limit.
_TOLERANCE = 1e-9


class Bound(NamedTuple):
    """A range of one or more components of a signal.

    Attributes:
        name: The reason for the end of a run that leaves the range.
        detail: The numbers of this run that complete the reason.
        signal: Name of the signal.
        first: Index of the first component.
        size: Number of components.
        lower: The least value of a single component.
        upper: The largest value of a single component, or the largest norm of several.
    """

    name: str
    detail: str
    signal: str
    first: int
    size: int
    lower: float
    upper: float

    def Excess(self, samples: Array) -> Array:
        """Returns the excess (N) of samples (N, n) over the range, < 0 inside.

        For several components, it is a share of `upper`.
        """
        x = samples[:, self.first : self.first + self.size]
        if self.size == 1:
            return np.maximum(self.lower - x, x - self.upper)[:, 0]
        # Scaled first, so that squares do not overflow.
        return np.linalg.norm(x / self.upper, axis=1) - 1.0


def BoundsOf(
    systems: Mapping[str, System], sizes: Mapping[str, int], limit: NormBound
) -> list[Bound]:
    """Returns the bounds of a loop's runs, the bound of the tool's speed first.

    The other bounds are the ranges of the joints of the robot's plant, which does not
    simulate stops, and the largest rotation of its tool. A robot without a system
    `plant` does not have them. A joint without limits has an infinite range.

    Args:
        systems: The systems of the simulated Diagram, by their paths.
        sizes: The sizes of the recorded signals, by name.
        limit: The bound of the tool's velocity.
    """
    name = "the tool exceeds its speed limit"
    speed = limit.largest
    size = sizes["tool_velocity"]
    bounds = [Bound(name, "", "tool_velocity", 0, size, -speed, speed)]
    plant = systems.get("robot/plant")
    if not isinstance(plant, MultibodyPlant) or "joint_position" not in sizes:
        return bounds
    bounds += _JointBounds(plant)
    num_angles = sizes["tool_position"] - 3
    if num_angles > 0:
        name = f"the tool is turned by {MAX_ROTATION:g} rad from the posture"
        angles = "tool_position", 3, num_angles
        bounds.append(Bound(name, "", *angles, -MAX_ROTATION, MAX_ROTATION))
    return bounds


def EndAtBound(limit: NormBound, run: Outcome) -> None:
    """Cuts off a run, in place, where a signal first leaves one of its bounds.

    The bound of the speed counts only if the speed limit ended the run. Otherwise an
    overflow may have exceeded it.
    """
    times, signals, steps = run.series
    sizes = {name: samples.shape[1] for name, samples in signals.items()}
    speed, *others = BoundsOf(run.systems, sizes, limit)
    pieces = Pieces(times, steps)
    ends: dict[Bound, float] = {}
    for bound in [speed, *others] if run.is_beyond_bound else others:
        excess = bound.Excess(signals[bound.signal])[:, np.newaxis]
        upwards = pieces.crossings(pieces.signal(excess)[..., 0]).upwards
        if upwards:
            ends[bound] = upwards[0]
    if not ends:
        return
    first = min(ends, key=ends.__getitem__)
    run.series = part(run.series, times[0], ends[first])
    # The reason of the speed limit already contains the speed of the tool.
    if first is not speed:
        run.ending = Ending("diverged", first.name + first.detail)


def _JointBounds(plant: MultibodyPlant) -> list[Bound]:
    """Returns the ranges of the joints of a plant, in the order of its positions."""
    lower = plant.GetPositionLowerLimits() - _TOLERANCE
    upper = plant.GetPositionUpperLimits() + _TOLERANCE
    names = plant.GetPositionNames(
        add_model_instance_prefix=False, always_add_suffix=False
    )
    bounds = []
    for k, joint in enumerate(names):
        name = f"joint {joint} leaves its range"
        detail = f", {lower[k]:.4g} to {upper[k]:.4g}"
        bounds.append(Bound(name, detail, "joint_position", k, 1, lower[k], upper[k]))
    return bounds
