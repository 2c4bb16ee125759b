"""Where a run of a loop ends early: bounds that its signals have to stay in."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

from teleop_drake.arrays import Array
from teleop_drake.laws.task_space import MAX_ROTATION
from teleop_drake.numerics.pieces import Pieces
from teleop_drake.numerics.step_polynomials import part
from teleop_drake.simulation.run import Ending, Outcome
from teleop_drake.tasks.base import SpeedLimit

# How far a joint may be past its limit, rad or m: rounding errors of a pose at it.
_TOLERANCE = 1e-9


class Bound(NamedTuple):
    """A run ends where a part of a signal leaves a range.

    Attributes:
        name: What happens there.
        detail: The numbers of this run that belong to the name.
        signal: Name of the signal.
        first: The first of the components.
        size: How many they are.
        lower: The least value of a single component.
        upper: The largest one, or the largest length of several components.
    """

    name: str
    detail: str
    signal: str
    first: int
    size: int
    lower: float
    upper: float

    def Excess(self, samples: Array) -> Array:
        """Returns how far samples (N, n) of the signal are out of the range (N)."""
        x = samples[:, self.first : self.first + self.size]
        if self.size == 1:
            return np.maximum(self.lower - x, x - self.upper)[:, 0]
        # A square must not overflow.
        return np.linalg.norm(x / self.upper, axis=1) - 1.0


def BoundsOf(
    diagram: Diagram, sizes: Mapping[str, int], limit: SpeedLimit
) -> list[Bound]:
    """Returns the bounds of a loop's runs, that of the tool's speed first.

    The others are the ranges of the joints of the robot's plant, which itself knows no
    stops, and how far its tool can be turned. A robot without a system `plant`, or
    whose joints turn without limit, has none of them.

    Args:
        diagram: What is simulated.
        sizes: Of the signals that are recorded, by their names.
        limit: What speed of the tool ends a run.
    """
    name = "the tool exceeds its speed limit"
    size = sizes["tool_velocity"]
    bounds = [Bound(name, "", "tool_velocity", 0, size, -limit.speed, limit.speed)]
    ranges = JointRanges(diagram)
    if not ranges or "joint_position" not in sizes:
        return bounds
    for k, (joint, (lower, upper)) in enumerate(ranges.items()):
        name = f"joint {joint} leaves its range"
        detail = f", {lower:.4g} to {upper:.4g}"
        bounds.append(Bound(name, detail, "joint_position", k, 1, lower, upper))
    num_angles = sizes["tool_position"] - 3
    if num_angles > 0:
        name = f"the tool is turned by {MAX_ROTATION:g} rad from the posture"
        angles = "tool_position", 3, num_angles
        bounds.append(Bound(name, "", *angles, -MAX_ROTATION, MAX_ROTATION))
    return bounds


def EndAtBound(diagram: Diagram, limit: SpeedLimit, run: Outcome) -> None:
    """Ends a run, in place, where a signal first leaves one of its bounds.

    At the speed limit it ends only if it was the speed that ended the run: beyond, an
    overflow may be to blame.
    """
    times, signals, steps = run.series
    sizes = {name: samples.shape[1] for name, samples in signals.items()}
    speed, *others = BoundsOf(diagram, sizes, limit)
    pieces = Pieces(times, steps)
    ends: dict[Bound, float] = {}
    for bound in [speed, *others] if run.is_too_fast else others:
        excess = bound.Excess(signals[bound.signal])[:, np.newaxis]
        upwards = pieces.crossings(pieces.signal(excess)[..., 0]).upwards
        if upwards:
            ends[bound] = upwards[0]
    if not ends:
        return
    first = min(ends, key=ends.__getitem__)
    run.series = part(run.series, times[0], ends[first])
    # How fast the tool was is known to what ended the run.
    if first is not speed:
        run.ending = Ending("diverged", first.name + first.detail)


def JointRanges(diagram: Diagram) -> dict[str, tuple[float, float]]:
    """Returns the ranges of the joints of the robot's plant by their names.

    None of a robot without a system `plant`.
    """
    if not diagram.HasSubsystemNamed("robot"):
        return {}
    robot = diagram.GetSubsystemByName("robot")
    if not (isinstance(robot, Diagram) and robot.HasSubsystemNamed("plant")):
        return {}
    plant = robot.GetSubsystemByName("plant")
    if not isinstance(plant, MultibodyPlant):
        return {}
    lower = plant.GetPositionLowerLimits() - _TOLERANCE
    upper = plant.GetPositionUpperLimits() + _TOLERANCE
    names = plant.GetPositionNames(
        add_model_instance_prefix=False, always_add_suffix=False
    )
    return dict(zip(names, zip(lower, upper, strict=True), strict=True))
