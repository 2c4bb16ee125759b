"""The monitor of joint ranges."""

import math

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

from teleop_drake.numerics.step_polynomials import first_crossing, part
from teleop_drake.simulation.outcome import Outcome

# How far a joint may be past its limit, rad or m: rounding errors of a pose at it.
_TOLERANCE = 1e-9


def EndAtJointLimit(diagram: Diagram, run: Outcome) -> None:
    """Ends a run, in place, where a joint of the robot's plant leaves its range.

    The plant itself knows no stops: what it does beyond is left out. A robot without a
    system `plant`, or whose joints turn without limit, is left as it is.

    Args:
        run: What came out; `diverged` afterwards if a joint left its range.
    """
    robot = diagram.GetSubsystemByName("robot")
    if not (isinstance(robot, Diagram) and robot.HasSubsystemNamed("plant")):
        return
    times, signals, steps = run.series
    plant, q = robot.GetSubsystemByName("plant"), signals.get("joint_position")
    if not isinstance(plant, MultibodyPlant) or q is None or len(steps) == 0:
        return
    lower = plant.GetPositionLowerLimits() - _TOLERANCE
    upper = plant.GetPositionUpperLimits() + _TOLERANCE
    beyond = np.maximum(lower - q, q - upper)[steps]
    ends = [first_crossing(times, y, steps) for y in np.moveaxis(beyond, 2, 0)]
    joint = int(np.argmin(ends))
    if ends[joint] == math.inf:
        return
    run.series = part(run.series, times[0], ends[joint])
    name = plant.GetPositionNames(
        add_model_instance_prefix=False, always_add_suffix=False
    )[joint]
    run.termination, run.is_too_fast = "diverged", False
    run.reason = (
        f"joint {name} leaves its range, {lower[joint]:.4g} to {upper[joint]:.4g}"
    )
