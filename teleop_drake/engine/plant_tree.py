"""The bodies and joints of a MultibodyPlant as flat arrays."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody import tree as multibody
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from teleop_drake.engine.flatten import UnsupportedSystem
from teleop_drake.numerics.rigid_body import RigidBodyTree


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

    Args:
        context: Its context, which has the parameters.

    Raises:
        UnsupportedSystem: If something in the plant moves or acts in another way.
    """
    for reason in _Obstacles(plant, context):
        raise UnsupportedSystem(plant, reason)
    n = plant.num_velocities()
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
        gravity=np.array(plant.gravity_field().gravity_vector()),
    )
    poses = {int(plant.world_body().index()): (-1, RigidTransform())}
    pending = [plant.get_joint(index) for index in plant.GetJointIndices()]
    while pending:  # From the world outward.
        joint = next(joint for joint in pending if _IsReached(joint, poses))
        pending.remove(joint)
        _AddLink(tree, poses, plant, joint, context)
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


def _IsReached(joint: multibody.Joint, poses: dict[int, Any]) -> bool:
    bodies = (joint.parent_body(), joint.child_body())
    return any(int(body.index()) in poses for body in bodies)


def _AddLink(
    tree: RigidBodyTree,
    poses: dict[int, tuple[int, RigidTransform]],
    plant: MultibodyPlant,
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
    axis = _Axis(plant, joint)
    i = joint.velocity_start()
    if joint.position_start() != i or link >= i:
        raise UnsupportedSystem(
            plant, f"the velocity of joint {joint.name()} is out of order"
        )
    tree.parents[i] = link
    tree.is_prismatic[i] = isinstance(joint, multibody.PrismaticJoint)
    tree.frames[i] = X_LF.GetAsMatrix34()
    tree.axes[i] = -axis if is_reversed else axis
    tree.damping[i] = joint.GetDamping(context)
    poses[outer] = i, X_MB


def _Axis(plant: MultibodyPlant, joint: multibody.Joint) -> np.ndarray:
    if isinstance(joint, multibody.RevoluteJoint):
        return joint.revolute_axis()
    if isinstance(joint, multibody.PrismaticJoint):
        return joint.translation_axis()
    raise UnsupportedSystem(
        plant,
        f"joint {joint.name()} is {joint.type_name()}; supported are weld, revolute "
        "and prismatic",
    )


def _Obstacles(plant: MultibodyPlant, context: Context) -> Iterator[str]:
    """Yields why a plant moves in another way than its tree does."""
    is_discrete = plant.time_step() > 0
    for i in range(plant.num_force_elements()):
        element = plant.get_force_element(multibody.ForceElementIndex(i))
        if not isinstance(element, multibody.UniformGravityFieldElement):
            yield f"force element {i} is a {type(element).__name__}, not gravity"
    instances = range(plant.num_model_instances())
    for instance in map(multibody.ModelInstanceIndex, instances):
        if not plant.gravity_field().is_enabled(instance):
            name = plant.GetModelInstanceName(instance)
            yield f"model instance {name} has no gravity"
    if plant.num_constraints() > 0:
        yield "it has constraints"
    if plant.num_collision_geometries() > 0:
        # Of a SceneGraph, pairs of bodies may not be among those that can collide.
        port = plant.get_geometry_query_input_port()
        is_known = port.HasValue(context)
        if not is_known or port.Eval(context).inspector().GetCollisionCandidates():
            yield "its bodies can collide"
    for joint_index in plant.GetJointIndices():
        joint = plant.get_joint(joint_index)
        limits = joint.position_lower_limits(), joint.position_upper_limits()
        # A continuous plant ignores the limits of its joints.
        if is_discrete and np.isfinite(limits).any():
            yield f"it is discrete, and joint {joint.name()} has limits"
        if joint.is_locked(context):
            yield f"joint {joint.name()} is locked"
    for actuator_index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(actuator_index)
        if actuator.has_controller():
            yield f"actuator {actuator.name()} has a controller"
