"""The bodies and joints of a MultibodyPlant as flat arrays."""

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
    _CheckForces(plant)
    _CheckCollisions(plant, context)
    _CheckJoints(plant, context)
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
        gravity=np.array(_Gravity(plant).gravity_vector()),
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


def _Gravity(plant: MultibodyPlant) -> multibody.UniformGravityFieldElement:
    return plant.get_force_element(multibody.ForceElementIndex(0))


def _CheckForces(plant: MultibodyPlant) -> None:
    """Raises UnsupportedSystem on forces other than gravity."""
    for i in range(plant.num_force_elements()):
        element = plant.get_force_element(multibody.ForceElementIndex(i))
        if not isinstance(element, multibody.UniformGravityFieldElement):
            raise UnsupportedSystem(
                plant, f"force element {i} is a {type(element).__name__}, not gravity"
            )
    gravity = _Gravity(plant)
    for i in range(plant.num_model_instances()):
        if not gravity.is_enabled(multibody.ModelInstanceIndex(i)):
            name = plant.GetModelInstanceName(multibody.ModelInstanceIndex(i))
            raise UnsupportedSystem(plant, f"model instance {name} has no gravity")
    if plant.num_constraints() > 0:
        raise UnsupportedSystem(plant, "it has constraints")


def _CheckCollisions(plant: MultibodyPlant, context: Context) -> None:
    """Raises UnsupportedSystem if a SceneGraph has pairs of bodies that can collide."""
    if plant.num_collision_geometries() == 0:
        return
    port = plant.get_geometry_query_input_port()
    if port.HasValue(context):
        inspector = port.Eval(context).inspector()
        if not inspector.GetCollisionCandidates():
            return
    raise UnsupportedSystem(plant, "its bodies can collide")


def _CheckJoints(plant: MultibodyPlant, context: Context) -> None:
    """Raises UnsupportedSystem on locked joints, and on limits of a discrete plant.

    A continuous plant ignores the limits of its joints.
    """
    is_discrete = plant.time_step() > 0
    for joint_index in plant.GetJointIndices():
        joint = plant.get_joint(joint_index)
        limits = joint.position_lower_limits(), joint.position_upper_limits()
        if is_discrete and np.isfinite(limits).any():
            reason = f"it is discrete, and joint {joint.name()} has limits"
            raise UnsupportedSystem(plant, reason)
        if joint.is_locked(context):
            raise UnsupportedSystem(plant, f"joint {joint.name()} is locked")
    for actuator_index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(actuator_index)
        if actuator.has_controller():
            reason = f"actuator {actuator.name()} has a controller"
            raise UnsupportedSystem(plant, reason)
