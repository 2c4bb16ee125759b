"""Where a run leaves the range of a joint."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

from teleop_drake.numerics.interpolation import find_crossing, interpolate
from teleop_drake.simulation.outcome import Outcome

# How far a joint may be past its limit, rad or m: rounding errors of a pose at it.
_TOLERANCE = 1e-9


def EndAtJointLimit(diagram: Diagram, run: Outcome) -> None:
    """Ends a run, in place, where a joint of the robot's plant leaves its range.

    The plant itself knows no stops: what it does beyond is left out. A robot without a
    system `plant`, or whose joints turn without limit, is left as it is.

    Args:
        diagram: What was run.
        run: What came out; `diverged` afterwards if a joint left its range.
    """
    robot = diagram.GetSubsystemByName("robot")
    if not (isinstance(robot, Diagram) and robot.HasSubsystemNamed("plant")):
        return
    plant, q = robot.GetSubsystemByName("plant"), run.signals.get("joint_position")
    if not isinstance(plant, MultibodyPlant) or q is None or len(q) < 2:
        return
    lower = plant.GetPositionLowerLimits() - _TOLERANCE
    upper = plant.GetPositionUpperLimits() + _TOLERANCE
    outside = np.argwhere((q < lower) | (q > upper))
    if len(outside) == 0 or outside[0, 0] == 0:
        return
    last, joint = (int(i) for i in outside[0])
    end = find_crossing(
        run.times,
        q[:, joint : joint + 1],
        last - 1,
        lambda x: not lower[joint] <= x[0] <= upper[joint],
    )
    values = {
        name: interpolate(run.times, x, np.array([end]))
        for name, x in run.signals.items()
    }
    run.times = np.append(run.times[:last], end)
    run.signals = {
        name: np.vstack([x[:last], values[name]]) for name, x in run.signals.items()
    }
    name = plant.GetPositionNames(
        add_model_instance_prefix=False, always_add_suffix=False
    )[joint]
    run.termination, run.is_too_fast = "diverged", False
    run.reason = (
        f"joint {name} leaves its range, {lower[joint]:.4g} to {upper[joint]:.4g}"
    )
