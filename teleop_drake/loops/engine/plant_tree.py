"""Conversion of a MultibodyPlant to a tree of links, stored in arrays."""

import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody import tree as multibody
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.loops.numerics.rigid_body import RigidBodyTree

# Each of their velocities turns or moves a link relative to the one before: a planar
# joint is two that slide and one that turns, a universal joint is two that turn.
_JOINTS = (
    multibody.WeldJoint, multibody.RevoluteJoint, multibody.PrismaticJoint,
    multibody.PlanarJoint, multibody.UniversalJoint,
)  # fmt: skip


class PlantTree(NamedTuple):
    """A plant as a tree of links: bodies welded to each other are one link.

    Link i has the velocity v_i relative to its parent. A joint with several velocities
    has links without mass between its bodies.

    Attributes:
        tree: The links.
        poses: The link of each body (-1: the world) and the body's pose X_LB in the
            frame of that link, keyed by the body's index.
    """

    tree: RigidBodyTree
    poses: dict[int, tuple[int, RigidTransform]]


def ReadPlantTree(plant: MultibodyPlant, context: Context) -> PlantTree:
    """Returns the tree of a plant whose joints NoTree() allows.

    The plant must have no forces but gravity and joint damping, no constraints and no
    contact.

    Args:
        plant: The plant.
        context: Its Context, which has the values of its parameters.

    Raises:
        ScenarioError: If a joint is of another type, or gravity acts on some bodies
            only.
    """
    for reason in NoTree(plant):
        raise ScenarioError(f"plant {plant.get_name()}: {reason}")
    n = plant.num_velocities()
    # At q = 0 the two frames of a joint coincide.
    at_zero = plant.CreateDefaultContext()
    at_zero.SetTimeStateAndParametersFrom(context)
    plant.SetPositions(at_zero, np.zeros(n))
    gravity = np.array(plant.gravity_field().gravity_vector())
    if _Weightless(plant):
        gravity = np.zeros(3)
    tree = RigidBodyTree(
        parents=np.full(n, -1),
        is_prismatic=np.zeros(n, np.int64),
        frames=np.zeros((n, 3, 4)),
        axes=np.zeros((n, 3)),
        masses=np.zeros(n),
        moments=np.zeros((n, 3)),
        inertias=np.zeros((n, 3, 3)),
        rotor_inertias=np.zeros(n),
        damping=np.zeros(n),
        gravity=gravity,
    )
    # The poses of the links; the last one is that of the world, which is link -1.
    X_WL = [RigidTransform()] * (n + 1)
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        damping = joint.GetDampingVector(at_zero)
        for i, D in enumerate(damping, joint.velocity_start()):
            X_WL[i] = joint.frame_on_parent().CalcPoseInWorld(at_zero)
            tree.damping[i] = D
    poses = {}
    for body in _Bodies(plant):
        J = SpatialJacobian(plant, at_zero, body.body_frame())
        # The joints that move the body, from the world to its link. Drake numbers them
        # from the world outward.
        path = [-1, *np.flatnonzero(J.any(axis=0))]
        link = int(path[-1])
        X_LB = X_WL[link].inverse() @ plant.EvalBodyPoseInWorld(at_zero, body)
        poses[int(body.index())] = link, X_LB
        if link < 0:
            continue
        for parent, i in itertools.pairwise(path):
            w = J[:3, i]
            tree.parents[i] = parent
            tree.is_prismatic[i] = not w.any()
            axis_W = w if w.any() else J[3:, i]
            tree.axes[i] = X_WL[i].rotation().inverse() @ axis_W
            tree.frames[i] = (X_WL[parent].inverse() @ X_WL[i]).GetAsMatrix34()
        M_B = body.CalcSpatialInertiaInBodyFrame(at_zero)
        M = M_B.ReExpress(X_LB.rotation()).Shift(-X_LB.translation())
        tree.masses[link] += M.get_mass()
        tree.moments[link] += M.CalcComMoment()
        tree.inertias[link] += M.CalcRotationalInertia().CopyToFullMatrix3()
    for motor in map(plant.get_joint_actuator, plant.GetJointActuatorIndices()):
        i = motor.joint().velocity_start()
        tree.rotor_inertias[i] += motor.calc_reflected_inertia(at_zero)
    return PlantTree(tree, poses)


def SpatialJacobian(plant: Any, context: Any, frame: Any) -> Any:
    """Returns Jv_V_WF of a frame of a plant: [w_WF; v_WF] by v (6, nv)."""
    world = plant.world_frame()
    return plant.CalcJacobianSpatialVelocity(
        context, multibody.JacobianWrtVariable.kV, frame, np.zeros(3), world, world
    )


def NoTree(plant: MultibodyPlant) -> Iterator[str]:
    """Yields the reasons, if any, why ReadPlantTree() cannot read a plant."""
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if not isinstance(joint, _JOINTS):
            yield (
                f"joint {joint.name()} is {joint.type_name()}; supported are weld, "
                "revolute, prismatic, planar and universal"
            )
    weightless = _Weightless(plant)
    if 0 < len(weightless) < plant.num_bodies() - 1:
        yield f"model instance {weightless[0]} has no gravity"


def _Bodies(plant: MultibodyPlant) -> list[multibody.RigidBody]:
    """Returns the bodies, the world first."""
    indices = map(multibody.BodyIndex, range(plant.num_bodies()))
    return [plant.get_body(index) for index in indices]


def _Weightless(plant: MultibodyPlant) -> list[str]:
    """Returns the names of the model instances of all bodies without gravity."""
    instances = [body.model_instance() for body in _Bodies(plant)[1:]]
    return [
        plant.GetModelInstanceName(instance)
        for instance in instances
        if not plant.gravity_field().is_enabled(instance)
    ]
