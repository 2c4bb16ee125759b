"""The rigid-body pass against MultibodyPlant, over random trees."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BallRpyJoint,
    BodyIndex,
    FixedOffsetFrame,
    JacobianWrtVariable,
    PlanarJoint,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
    UniversalJoint,
    WeldJoint,
)

from teleop_drake.loops.engine.plant_tree import ReadPlantTree
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.loops.numerics.rigid_body import (
    calc_bias_acceleration,
    calc_jacobian,
    calc_joint_accelerations,
    calc_motion,
)

KINDS = {
    "r": RevoluteJoint,
    "p": PrismaticJoint,
    "w": WeldJoint,
    "l": PlanarJoint,
    "u": UniversalJoint,
}


def random_pose(rng):
    q = rng.normal(size=4)
    rotation = RotationMatrix(Quaternion(q / np.linalg.norm(q)))
    return RigidTransform(rotation, rng.uniform(-0.5, 0.5, 3))


def random_body(plant, name, rng):
    half = rng.uniform(0.1, 0.5, 3)
    return plant.AddRigidBody(
        name,
        SpatialInertia(
            mass=rng.uniform(0.3, 2),
            p_PScm_E=(com := rng.uniform(-0.3, 0.3, 3)),
            G_SP_E=UnitInertia.SolidBox(*half).ShiftFromCenterOfMass(com),
        ),
    )


def random_plant(seed, kinds):
    """A tree of joints of the kinds in KINDS, some of them upside down."""
    rng = np.random.default_rng(seed)
    plant = MultibodyPlant(0.0)
    plant.set_name("plant")
    bodies = [plant.world_body()]
    for i, kind in enumerate(kinds):
        body = random_body(plant, f"body{i}", rng)
        parent = bodies[rng.integers(len(bodies))]
        ends = (parent, random_pose(rng), body, random_pose(rng))
        if rng.random() < 0.3 and kind in "rpw":  # Drake turns no others.
            ends = (body, ends[1], parent, ends[3])
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        damping = rng.uniform(0, 1)
        if kind == "w":
            plant.AddJoint(
                KINDS[kind](f"joint{i}", *_frames(plant, ends), random_pose(rng))
            )
        elif kind in "lu":
            several = damping if kind == "u" else rng.uniform(0, 1, 3)
            joint = KINDS[kind](f"joint{i}", *_frames(plant, ends), damping=several)
            plant.AddJoint(joint)
        else:
            joint = plant.AddJoint(
                KINDS[kind](f"joint{i}", *_frames(plant, ends), axis, damping=damping)
            )
            if rng.random() < 0.7:
                actuator = plant.AddJointActuator(f"motor{i}", joint, 20.0)
                actuator.set_default_rotor_inertia(rng.uniform(0, 0.1))
                actuator.set_default_gear_ratio(rng.uniform(1, 5))
        bodies.append(body)
    plant.mutable_gravity_field().set_gravity_vector(rng.normal(size=3) * 5)
    plant.Finalize()
    return plant, rng


def _frames(plant, ends):
    parent, X_PF, child, X_CM = ends
    i = plant.num_joints()
    return (
        plant.AddFrame(FixedOffsetFrame(f"F{i}", parent.body_frame(), X_PF)),
        plant.AddFrame(FixedOffsetFrame(f"M{i}", child.body_frame(), X_CM)),
    )


@pytest.mark.slow
@given(
    st.integers(0, 2**31),
    st.lists(st.sampled_from("rrppwlu"), min_size=1, max_size=10),
)
def test_a_random_tree_moves_as_its_plant(seed, kinds):
    check_motion(seed, kinds)


@pytest.mark.parametrize(("seed", "kinds"), [(1, "l"), (2, "u"), (3, "wlurp")])
def test_joints_with_several_velocities(seed, kinds):
    check_motion(seed, kinds)


def check_motion(seed, kinds):
    """Compares accelerations, poses and Jacobians with the plant's."""
    plant, rng = random_plant(seed, kinds)
    context = plant.CreateDefaultContext()
    n = plant.num_velocities()
    read = ReadPlantTree(plant, context)
    for _ in range(3):
        q, v, forces = (rng.normal(size=n) for _ in range(3))
        plant.SetPositionsAndVelocities(context, np.concatenate([q, v]))
        plant.get_applied_generalized_force_input_port().FixValue(context, forces)
        plant.get_actuation_input_port().FixValue(
            context, np.zeros(plant.num_actuators())
        )
        expected = plant.EvalTimeDerivatives(context).CopyToVector()[n:]
        v_dot = calc_joint_accelerations(read.tree, q, v, forces)
        assert_allclose(v_dot, expected, atol=_tolerance(expected))
        A = plant.get_body_spatial_accelerations_output_port().Eval(context)
        motion = calc_motion(read.tree, q, v)
        for index, (link, X_LB) in read.poses.items():
            frame = plant.get_body(BodyIndex(index)).body_frame()
            point = X_LB.translation()
            p, J = calc_jacobian(read.tree, motion, link, point)
            a = J @ v_dot + calc_bias_acceleration(motion, link, point)
            J_drake = plant.CalcJacobianSpatialVelocity(
                context,
                JacobianWrtVariable.kV,
                frame,
                np.zeros(3),
                plant.world_frame(),
                plant.world_frame(),
            )
            X_WB = frame.CalcPoseInWorld(context)
            R = motion.R[link + 1] @ X_LB.rotation().matrix()
            assert_allclose(R, X_WB.rotation().matrix(), atol=1e-10)
            assert_allclose(p, X_WB.translation(), atol=1e-10)
            assert_allclose(J, J_drake, atol=1e-10)
            a_drake = np.append(A[index].rotational(), A[index].translational())
            assert_allclose(a, a_drake, atol=_tolerance(a_drake))


def _tolerance(x):
    return 1e-10 * max(1.0, np.abs(x).max(initial=0.0))


def ball(plant, rng):
    body = random_body(plant, "ball", rng)
    plant.AddJoint(BallRpyJoint("shoulder", plant.world_frame(), body.body_frame()))


def free(plant, rng):
    random_body(plant, "ball", rng)


@pytest.mark.parametrize(
    ("add", "message"),
    [(ball, "joint shoulder is ball_rpy"), (free, "quaternion_floating")],
)
def test_other_joints_are_refused_by_name(add, message):
    plant = MultibodyPlant(0.0)
    add(plant, np.random.default_rng(1))
    plant.Finalize()
    with pytest.raises(ScenarioError, match=message):
        ReadPlantTree(plant, plant.CreateDefaultContext())


def test_gravity_acts_on_all_instances_or_on_none():
    plant = MultibodyPlant(0.0)
    rng = np.random.default_rng(1)
    field = plant.mutable_gravity_field()
    for name in ("left", "right"):
        instance = plant.AddModelInstance(name)
        inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
        frame = plant.AddRigidBody("link", instance, inertia).body_frame()
        plant.AddJoint(RevoluteJoint(name, plant.world_frame(), frame, [0, 0, 1]))
        field.set_enabled(instance, False)
    field.set_gravity_vector(rng.normal(size=3))
    context = plant.Finalize() or plant.CreateDefaultContext()
    assert not ReadPlantTree(plant, context).tree.gravity.any()


def test_gravity_on_one_of_two_instances_is_refused():
    plant = MultibodyPlant(0.0)
    for name in ("left", "right"):
        instance = plant.AddModelInstance(name)
        inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
        frame = plant.AddRigidBody("link", instance, inertia).body_frame()
        plant.AddJoint(RevoluteJoint(name, plant.world_frame(), frame, [0, 0, 1]))
    plant.mutable_gravity_field().set_enabled(instance, False)
    plant.Finalize()
    with pytest.raises(ScenarioError, match="model instance right has no gravity"):
        ReadPlantTree(plant, plant.CreateDefaultContext())
