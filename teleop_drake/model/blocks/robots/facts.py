"""Facts of a robot, computed from its system in the diagram."""

import functools
import pickle
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FrameIndex
from pydrake.systems.framework import Context, System

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.model.blocks.robots.base import RobotConfig
from teleop_drake.model.blocks.robots.inertias import LinkWithoutInertia
from teleop_drake.model.blocks.robots.inverse_kinematics import TOOL, ToolJacobian


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotFacts:
    """The facts of a robot from which defaults derive.

    Attributes:
        start: p_WT at the start, m (n).
        inertia: M_r = (J M^-1 J^T)^-1, (2.8), the apparent inertia at the tool at the
            start, kg (n, n); None: not known.
        damping: The apparent damping at the tool at the start due to the viscous
            damping of the joints, N s/m (n, n); None: not known.
    """

    start: Array
    inertia: Array | None
    damping: Array | None


def FactsOfRobot(robot: System) -> RobotFacts:
    """Returns the facts of a robot at the pose of its default Context.

    Inertia and damping are computed from the MultibodyPlant inside the robot that has a
    frame `tool` at tool_position. They are None if there is no such plant, or if its
    pose is singular.

    Args:
        robot: A system with the ports of robot_diagram.MakeRobotDiagram, of which
            tool_position is needed.
    """
    context = robot.CreateDefaultContext()
    start = np.array(robot.GetOutputPort("tool_position").Eval(context))
    inertia = damping = None
    for plant, plant_context in ContextsIn(robot, context).items():
        if isinstance(plant, MultibodyPlant) and _IsTool(plant, plant_context, start):
            inertia, damping = _ToolInertiaAndDamping(plant, plant_context, len(start))
            break
    return RobotFacts(start=start, inertia=inertia, damping=damping)


def FactsOfConfig(robot: RobotConfig) -> RobotFacts:
    """Returns the facts of the robot that a config makes.

    Making the robot takes as long as a compiled run, and a sweep needs the facts of the
    same robot many times. They are therefore cached, but only for kinds of the package
    and only if no field names a file.
    """
    if robot.file_fields or not type(robot).__module__.startswith("teleop_drake."):
        return FactsOfRobot(robot.MakeRobot())
    return _Remembered(pickle.dumps(robot))


@functools.lru_cache(maxsize=64)
def _Remembered(robot: bytes) -> RobotFacts:
    return FactsOfRobot(pickle.loads(robot).MakeRobot())


def _IsTool(plant: MultibodyPlant, context: Context, p_WT: Array) -> bool:
    """Returns whether the plant has exactly one frame `tool`, and it is at p_WT."""
    frames = [plant.get_frame(FrameIndex(i)) for i in range(plant.num_frames())]
    tools = [frame for frame in frames if frame.name() == TOOL]
    if len(tools) != 1:
        return False
    position = tools[0].CalcPoseInWorld(context).translation()
    place = p_WT[:3]
    return bool(np.allclose(position[: place.size], place, rtol=0, atol=1e-9))


def _ToolInertiaAndDamping(
    plant: MultibodyPlant, context: Context, num_axes: int
) -> tuple[Array | None, Array | None]:
    """Returns M_r and the damping at the tool, None at a singular pose.

    Raises:
        ScenarioError: If a joint moves a link without inertia.
    """
    link = LinkWithoutInertia(plant, context)
    if link:
        allowed = f"one with mass and inertia of the link {link!r}, which a joint moves"
        Refuse("plant", plant.get_name(), allowed)
    M: Array = plant.CalcMassMatrix(context)
    J = ToolJacobian(plant, context, num_axes)
    mobility = J @ np.linalg.solve(M, J.T)
    if not np.linalg.cond(mobility) < 1e12:
        return None, None
    inertia: Array = np.linalg.inv(mobility)
    # The dynamically consistent inverse of J, which is J^-1 where there is one.
    J_inverse = np.linalg.solve(M, J.T) @ inertia
    damping: Array = J_inverse.T @ _JointDamping(plant, context) @ J_inverse
    return inertia, damping


def _JointDamping(plant: MultibodyPlant, context: Context) -> Array:
    """Returns the viscous damping of the joints (nv, nv)."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    joints.sort(key=lambda joint: joint.velocity_start())
    vectors = [joint.GetDampingVector(context) for joint in joints]
    return np.diag(np.concatenate(vectors))
