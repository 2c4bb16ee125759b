"""The limits of the joints of discrete plants, which a program does not have.

Drake stops a joint of a discrete plant at its limit; a continuous plant ignores the
limit. A compiled run is that of Drake as long as no joint comes near to its limit.
"""

from typing import Any, NamedTuple

import numpy as np

from teleop_drake.loops.engine.flatten import NearLimit
from teleop_drake.loops.framework.arrays import Array

# Drake limits a joint that its velocity takes beyond the limit in so many time steps,
# and one more.
_TIME_STEPS = 3.0


class JointLimits(NamedTuple):
    """The limits of the n positions of a discrete plant.

    Attributes:
        names: The name of the joint of each position.
        lower: The lower limits, rad or m (n).
        upper: The upper limits, rad or m (n).
        time_step: The time step of the plant, s.
    """

    names: list[str]
    lower: Array
    upper: Array
    time_step: float

    def Limited(self) -> str:
        """Returns the name of the first joint that has a limit."""
        has_limit = np.isfinite(self.lower) | np.isfinite(self.upper)
        return self.names[int(np.argmax(has_limit))]

    def Check(self, path: str, times: Array, states: Array) -> None:
        """Refuses a run in which a joint has come near to its limit.

        Args:
            path: The path of the plant.
            times: The times of the rows, s (N).
            states: The positions and velocities in the rows (N, 2 n).

        Raises:
            NearLimit: If it has; the message names the joint and the time.
        """
        q, v = np.split(states, 2, axis=1)
        ahead = q + _TIME_STEPS * self.time_step * v
        is_inside = np.minimum(q, ahead) > self.lower
        is_inside &= np.maximum(q, ahead) < self.upper
        if is_inside.all():
            return
        row, joint = np.argwhere(~is_inside)[0]
        raise NearLimit(
            f"joint {self.names[joint]} of {path} comes to its limit at "
            f"{times[row]:.4g} s"
        )


def LimitsOf(plant: Any) -> JointLimits | None:
    """Returns the limits of a discrete plant's joints; None if it has none."""
    lower = plant.GetPositionLowerLimits()
    upper = plant.GetPositionUpperLimits()
    has_limits = np.isfinite(lower).any() or np.isfinite(upper).any()
    if plant.time_step() == 0 or not has_limits:
        return None
    names = [""] * plant.num_positions()
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        for i in range(joint.num_positions()):
            names[joint.position_start() + i] = joint.name()
    return JointLimits(names, lower, upper, plant.time_step())
