"""The bodies and joints of a MultibodyPlant as flat arrays."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody import tree as multibody
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from teleop_drake.laws.task_space import Tool
from teleop_drake.numerics.rigid_body import RigidBodyTree
from teleop_drake.validation import ScenarioError

_JOINTS = (multibody.WeldJoint, multibody.RevoluteJoint, multibody.PrismaticJoint)


@dataclass(frozen=True, kw_only=True)
class PlantTree:
    """A plant as a tree of links: bodies welded to each other are one link.

    Link i moves with the plant's q_i and v_i.

    Attributes:
        tree: The links.
        poses: Which link a body belongs to (-1: the world), and its pose X_LB in that
            link's frame, by the body's index.
        actuated: The velocity that each actuator acts on, in the order of the plant's
            actuation.
        effort_limits: Limit of each actuator, N m or N.
    """

    tree: RigidBodyTree
    poses: dict[int, tuple[int, RigidTransform]]
    actuated: np.ndarray
    effort_limits: np.ndarray


def ReadPlantTree(plant: MultibodyPlant, context: Context) -> PlantTree:
    """Reads a plant whose joints are welds, revolute and prismatic.

    It has neither forces other than gravity, nor constraints, nor contact.

    Args:
        context: Its context, which has the parameters.

    Raises:
        ScenarioError: If a joint is another one, or gravity does not act on all.
    """
    for reason in NoTree(plant):
        raise ScenarioError(f"plant {plant.get_name()}: {reason}")
    n = plant.num_velocities()
    with_gravity, _ = _Instances(plant)
    gravity = np.array(plant.gravity_field().gravity_vector())
    tree = RigidBodyTree(
        parents=np.zeros(n, np.int64),
        is_prismatic=np.zeros(n, np.int64),
        frames=np.zeros((n, 3, 4)),
        axes=np.zeros((n, 3)),
        masses=np.zeros(n),
        moments=np.zeros((n, 3)),
        inertias=np.zeros((n, 3, 3)),
        rotor_inertias=np.zeros(n),
        damping=np.zeros(n),
        gravity=gravity if with_gravity else np.zeros(3),
    )
    poses = {int(plant.world_body().index()): (-1, RigidTransform())}
    pending = [plant.get_joint(index) for index in plant.GetJointIndices()]
    while pending:  # From the world outward.
        joint = next(joint for joint in pending if _IsReached(joint, poses))
        pending.remove(joint)
        _AddLink(tree, poses, joint, context)
    for index, (link, X_LB) in poses.items():
        if link >= 0:
            body = plant.get_body(multibody.BodyIndex(index))
            M_B = body.CalcSpatialInertiaInBodyFrame(context)
            M = M_B.ReExpress(X_LB.rotation()).Shift(-X_LB.translation())
            tree.masses[link] += M.get_mass()
            tree.moments[link] += M.CalcComMoment()
            tree.inertias[link] += M.CalcRotationalInertia().CopyToFullMatrix3()
    motors = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]
    actuated = [motor.joint().velocity_start() for motor in motors]
    for i, motor in zip(actuated, motors, strict=True):
        tree.rotor_inertias[i] += motor.calc_reflected_inertia(context)
    return PlantTree(
        tree=tree,
        poses=poses,
        actuated=np.array(actuated, np.int64),
        effort_limits=np.array([motor.effort_limit() for motor in motors], float),
    )


def ReadTool(plant: MultibodyPlant, body_name: str, num_axes: int) -> Tool:
    """Returns the tool at a body's origin, which n axes of the world move.

    Raises:
        ScenarioError: If ReadPlantTree() cannot read the plant.
    """
    read = ReadPlantTree(plant, plant.CreateDefaultContext())
    link, X_LT = read.poses[int(plant.GetBodyByName(body_name).index())]
    return Tool(read.tree, link, X_LT.GetAsMatrix34(), num_axes)


def _IsReached(joint: multibody.Joint, poses: dict[int, Any]) -> bool:
    bodies = (joint.parent_body(), joint.child_body())
    return any(int(body.index()) in poses for body in bodies)


def _AddLink(
    tree: RigidBodyTree,
    poses: dict[int, tuple[int, RigidTransform]],
    joint: Any,
    context: Context,
) -> None:
    """Adds the link that hangs on a joint, or a body that is welded to a link.

    Args:
        poses: Those of the bodies that were reached, as in PlantTree.
    """
    inboard = joint.frame_on_parent()
    outboard = joint.frame_on_child()
    is_reversed = int(inboard.body().index()) not in poses
    if is_reversed:
        inboard, outboard = outboard, inboard
    link, X_LB = poses[int(inboard.body().index())]
    X_LF = X_LB @ inboard.CalcPoseInBodyFrame(context)
    X_MB = outboard.CalcPoseInBodyFrame(context).inverse()
    outer = int(outboard.body().index())
    if isinstance(joint, multibody.WeldJoint):
        X_FM = joint.X_FM().inverse() if is_reversed else joint.X_FM()
        poses[outer] = link, X_LF @ X_FM @ X_MB
        return
    # Drake counts velocities from the world outward.
    i = joint.velocity_start()
    is_prismatic = isinstance(joint, multibody.PrismaticJoint)
    axis = joint.translation_axis() if is_prismatic else joint.revolute_axis()
    tree.parents[i] = link
    tree.is_prismatic[i] = is_prismatic
    tree.frames[i] = X_LF.GetAsMatrix34()
    tree.axes[i] = -axis if is_reversed else axis
    tree.damping[i] = joint.GetDamping(context)
    poses[outer] = i, X_MB


def NoTree(plant: MultibodyPlant) -> Iterator[str]:
    """Yields what a plant has besides a tree of revolute and prismatic joints."""
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if not isinstance(joint, _JOINTS):
            yield (
                f"joint {joint.name()} is {joint.type_name()}; supported are weld, "
                "revolute and prismatic"
            )
    with_gravity, without = _Instances(plant)
    if with_gravity and without:
        yield f"model instance {plant.GetModelInstanceName(without[0])} has no gravity"


def _Instances(plant: MultibodyPlant) -> tuple[list[Any], list[Any]]:
    """Returns the model instances with bodies: those with gravity, those without."""
    bodies = map(multibody.BodyIndex, range(1, plant.num_bodies()))
    instances = dict.fromkeys(plant.get_body(i).model_instance() for i in bodies)
    is_enabled = plant.gravity_field().is_enabled
    return (
        [instance for instance in instances if is_enabled(instance)],
        [instance for instance in instances if not is_enabled(instance)],
    )
