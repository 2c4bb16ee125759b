"""The bodies and joints of a MultibodyPlant as flat arrays."""

from dataclasses import dataclass
from typing import Any, NamedTuple

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
    links = _ReadLinks(plant, context)
    inertias = _ReadInertias(plant, context, links.poses)
    motors = _ReadMotors(plant, context)
    return PlantTree(
        tree=RigidBodyTree(
            parents=links.parents,
            is_prismatic=links.is_prismatic,
            frames=links.frames,
            axes=links.axes,
            masses=inertias.masses,
            moments=inertias.moments,
            inertias=inertias.inertias,
            rotor_inertias=motors.rotor_inertias,
            damping=links.damping,
            gravity=np.array(_Gravity(plant).gravity_vector()),
        ),
        poses=links.poses,
        actuated=motors.actuated,
        effort_limits=motors.effort_limits,
    )


class _Links(NamedTuple):
    """The links of a plant, n of them, without their inertias.

    Attributes:
        poses: As in PlantTree.
        parents: The link that each link hangs on, -1 for the world (n).
        is_prismatic: Whether a link slides instead of turning (n).
        frames: Pose of the joint's frame in the parent's frame (n, 3, 4).
        axes: Unit vector of the joint in that frame (n, 3).
        damping: Of the joint, N m s/rad or N s/m (n).
    """

    poses: dict[int, tuple[int, RigidTransform]]
    parents: np.ndarray
    is_prismatic: np.ndarray
    frames: np.ndarray
    axes: np.ndarray
    damping: np.ndarray


def _ReadLinks(plant: MultibodyPlant, context: Context) -> _Links:
    """Reads the joints of a plant, from the world outward."""
    n = plant.num_velocities()
    links = _Links(
        poses={int(plant.world_body().index()): (-1, RigidTransform())},
        parents=np.zeros(n, np.int64),
        is_prismatic=np.zeros(n, np.int64),
        frames=np.zeros((n, 3, 4)),
        axes=np.zeros((n, 3)),
        damping=np.zeros(n),
    )
    # Each round reaches the joints next to known bodies.
    pending = [plant.get_joint(index) for index in plant.GetJointIndices()]
    while pending:
        reached = [joint for joint in pending if _IsReached(joint, links.poses)]
        for joint in reached:
            _AddLink(links, plant, joint, context)
        pending = [joint for joint in pending if joint not in reached]
    return links


def _AddLink(
    links: _Links, plant: MultibodyPlant, joint: Any, context: Context
) -> None:
    """Adds the link that hangs on a joint, or a body that is welded to a link."""
    inboard, outboard, sign = _Ends(joint, links.poses)
    link, X_LB = links.poses[int(inboard.body().index())]
    X_LF = X_LB @ inboard.CalcPoseInBodyFrame(context)
    X_MB = outboard.CalcPoseInBodyFrame(context).inverse()
    outer = int(outboard.body().index())
    if isinstance(joint, multibody.WeldJoint):
        X_FM = joint.X_FM() if sign > 0 else joint.X_FM().inverse()
        links.poses[outer] = link, X_LF @ X_FM @ X_MB
        return
    axis = _Axis(plant, joint)
    i = joint.velocity_start()
    if joint.position_start() != i or link >= i:
        raise UnsupportedSystem(
            plant, f"the velocity of joint {joint.name()} is out of order"
        )
    links.parents[i] = link
    links.is_prismatic[i] = isinstance(joint, multibody.PrismaticJoint)
    links.frames[i] = X_LF.GetAsMatrix34()
    links.axes[i] = sign * axis
    links.damping[i] = joint.GetDamping(context)
    links.poses[outer] = i, X_MB


class _Inertias(NamedTuple):
    """Of each of n links, in its frame: mass, first moment and rotational inertia."""

    masses: np.ndarray
    moments: np.ndarray
    inertias: np.ndarray


def _ReadInertias(
    plant: MultibodyPlant,
    context: Context,
    poses: dict[int, tuple[int, RigidTransform]],
) -> _Inertias:
    """Adds up the inertias of the bodies that make a link."""
    n = plant.num_velocities()
    sums = _Inertias(np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3)))
    for index, (link, X_LB) in poses.items():
        if link < 0:
            continue
        body = plant.get_body(multibody.BodyIndex(index))
        M_B = body.CalcSpatialInertiaInBodyFrame(context)
        M = M_B.ReExpress(X_LB.rotation()).Shift(-X_LB.translation())
        sums.masses[link] += M.get_mass()
        sums.moments[link] += M.CalcComMoment()
        sums.inertias[link] += M.CalcRotationalInertia().CopyToFullMatrix3()
    return sums


class _Motors(NamedTuple):
    """The actuators: as in PlantTree, and the inertia of rotors at each joint (n)."""

    actuated: np.ndarray
    effort_limits: np.ndarray
    rotor_inertias: np.ndarray


def _ReadMotors(plant: MultibodyPlant, context: Context) -> _Motors:
    actuated = []
    limits = []
    rotor_inertias = np.zeros(plant.num_velocities())
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(multibody.JointActuatorIndex(index))
        actuated.append(actuator.joint().velocity_start())
        limits.append(actuator.effort_limit())
        rotor_inertias[actuated[-1]] += actuator.calc_reflected_inertia(context)
    return _Motors(
        np.array(actuated, np.int64), np.array(limits, float), rotor_inertias
    )


def _IsReached(joint: multibody.Joint, poses: dict[int, Any]) -> bool:
    bodies = (joint.parent_body(), joint.child_body())
    return any(int(body.index()) in poses for body in bodies)


def _Ends(
    joint: multibody.Joint, poses: dict[int, Any]
) -> tuple[multibody.Frame, multibody.Frame, float]:
    """Returns a joint's inboard and outboard frame, and the sense of its motion."""
    if int(joint.parent_body().index()) in poses:
        return joint.frame_on_parent(), joint.frame_on_child(), 1.0
    return joint.frame_on_child(), joint.frame_on_parent(), -1.0


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
