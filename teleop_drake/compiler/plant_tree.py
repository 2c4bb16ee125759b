"""What a MultibodyPlant is made of, read out once into flat arrays."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    ForceElementIndex,
    Frame,
    Joint,
    JointActuatorIndex,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    UniformGravityFieldElement,
    WeldJoint,
)
from pydrake.systems.framework import Context

from teleop_drake.compiler.unsupported import UnsupportedSystem
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
        plant: A finalized, continuous plant.
        context: Its context, which has the parameters.

    Raises:
        UnsupportedSystem: If something in the plant moves or acts in another way.
    """
    _CheckForces(plant)
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    poses: dict[int, tuple[int, RigidTransform]] = {
        int(plant.world_body().index()): (-1, RigidTransform())
    }
    n = plant.num_velocities()
    parents, is_prismatic = np.zeros(n, np.int64), np.zeros(n, np.int64)
    frames, axes = np.zeros((n, 12)), np.zeros((n, 3))
    damping = np.zeros(n)
    # From the world outward: each round reaches the joints next to known bodies.
    pending = joints
    while pending:
        reached = [joint for joint in pending if _IsReached(joint, poses)]
        for joint in reached:
            inboard, outboard, sign = _Ends(joint, poses)
            link, X_LB = poses[int(inboard.body().index())]
            X_LF = X_LB @ inboard.CalcPoseInBodyFrame(context)
            X_MB = outboard.CalcPoseInBodyFrame(context).inverse()
            body = int(outboard.body().index())
            if isinstance(joint, WeldJoint):
                X_FM = joint.X_FM() if sign > 0 else joint.X_FM().inverse()
                poses[body] = link, X_LF @ X_FM @ X_MB
                continue
            axis = _Axis(plant, joint)
            i = joint.velocity_start()
            if joint.position_start() != i or link >= i:
                raise UnsupportedSystem(
                    plant, f"the velocity of joint {joint.name()} is out of order"
                )
            parents[i], is_prismatic[i] = link, isinstance(joint, PrismaticJoint)
            frames[i, :9] = X_LF.rotation().matrix().ravel()
            frames[i, 9:] = X_LF.translation()
            axes[i] = sign * axis
            damping[i] = joint.GetDamping(context)
            poses[body] = i, X_MB
        pending = [joint for joint in pending if joint not in reached]
    rotor_inertias = np.zeros(n)
    actuated, limits = [], []
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(JointActuatorIndex(index))
        actuated.append(actuator.joint().velocity_start())
        limits.append(actuator.effort_limit())
        rotor_inertias[actuated[-1]] += actuator.calc_reflected_inertia(context)
    return PlantTree(
        tree=RigidBodyTree(
            parents=parents,
            is_prismatic=is_prismatic,
            frames=frames,
            axes=axes,
            inertias=_LinkInertias(plant, context, poses),
            rotor_inertias=rotor_inertias,
            damping=damping,
            gravity=np.array(_Gravity(plant).gravity_vector()),
        ),
        poses=poses,
        actuated=np.array(actuated, np.int64),
        effort_limits=np.array(limits, float),
    )


def _IsReached(joint: Joint, poses: dict[int, Any]) -> bool:
    bodies = (joint.parent_body(), joint.child_body())
    return any(int(body.index()) in poses for body in bodies)


def _Ends(joint: Joint, poses: dict[int, Any]) -> tuple[Frame, Frame, float]:
    """Returns a joint's inboard and outboard frame, and the sense of its motion."""
    if int(joint.parent_body().index()) in poses:
        return joint.frame_on_parent(), joint.frame_on_child(), 1.0
    return joint.frame_on_child(), joint.frame_on_parent(), -1.0


def _Axis(plant: MultibodyPlant, joint: Joint) -> np.ndarray:
    if isinstance(joint, RevoluteJoint):
        return np.asarray(joint.revolute_axis())
    if isinstance(joint, PrismaticJoint):
        return np.asarray(joint.translation_axis())
    raise UnsupportedSystem(
        plant,
        f"joint {joint.name()} is {joint.type_name()}; supported are weld, revolute "
        "and prismatic",
    )


def _Gravity(plant: MultibodyPlant) -> UniformGravityFieldElement:
    return plant.get_force_element(ForceElementIndex(0))


def _CheckForces(plant: MultibodyPlant) -> None:
    """Raises UnsupportedSystem on forces other than gravity."""
    if plant.time_step() > 0:
        raise UnsupportedSystem(plant, "it is discrete; make it with time_step=0")
    for i in range(plant.num_force_elements()):
        element = plant.get_force_element(ForceElementIndex(i))
        if not isinstance(element, UniformGravityFieldElement):
            raise UnsupportedSystem(
                plant, f"force element {i} is a {type(element).__name__}, not gravity"
            )
    gravity = _Gravity(plant)
    for i in range(plant.num_model_instances()):
        if not gravity.is_enabled(ModelInstanceIndex(i)):
            name = plant.GetModelInstanceName(ModelInstanceIndex(i))
            raise UnsupportedSystem(plant, f"model instance {name} has no gravity")
    if plant.num_constraints() > 0:
        raise UnsupportedSystem(plant, "it has constraints")
    if plant.num_collision_geometries() > 0:
        raise UnsupportedSystem(plant, "its bodies can collide")


def _LinkInertias(
    plant: MultibodyPlant,
    context: Context,
    poses: dict[int, tuple[int, RigidTransform]],
) -> np.ndarray:
    """Returns mass, first moment and inertia of each link, as RigidBodyTree has it."""
    inertias = np.zeros((plant.num_velocities(), 10))
    for index in plant.GetBodyIndices(ModelInstanceIndex(0)) + [
        body
        for i in range(1, plant.num_model_instances())
        for body in plant.GetBodyIndices(ModelInstanceIndex(i))
    ]:
        body: RigidBody = plant.get_body(index)
        link, X_LB = poses[int(index)]
        if link < 0:
            continue
        M_B = body.CalcSpatialInertiaInBodyFrame(context)
        m = M_B.get_mass()
        R_LB, p_LB = X_LB.rotation().matrix(), X_LB.translation()
        h_B = R_LB @ (m * M_B.get_com())
        # About the body's origin, then shifted to the link's.
        rotational = M_B.CalcRotationalInertia().CopyToFullMatrix3()
        I_L = R_LB @ rotational @ R_LB.T + (
            (m * p_LB @ p_LB + 2 * p_LB @ h_B) * np.eye(3)
            - m * np.outer(p_LB, p_LB)
            - np.outer(p_LB, h_B)
            - np.outer(h_B, p_LB)
        )
        inertias[link, 0] += m
        inertias[link, 1:4] += h_B + m * p_LB
        inertias[link, 4:] += [
            *np.diag(I_L),
            I_L[0, 1],
            I_L[0, 2],
            I_L[1, 2],
        ]
    return inertias
