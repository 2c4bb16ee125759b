"""Changes the joints of a parsed model: locks them, moves its base, adds motors.

Each function takes a plant that is not finalized, and a model of it.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Joint,
    JointActuator,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    WeldJoint,
)

from teleop_drake.loops.framework.validation import Refuse


def CoupledJoints(text: str) -> list[str]:
    """Returns the joints that a URDF, SDF or MJCF model couples with others.

    Drake ignores the couplings, which a continuous plant does not support. They have
    no effect among locked joints.
    """
    if not re.search(r"<(drake:)?(mimic|equality|tendon)\b", text):
        return []
    root = ElementTree.fromstring(re.sub(r"(</?)drake:", r"\1", text))
    names: list[str | None] = []
    for joint in root.iter("joint"):
        for mimic in joint.iter("mimic"):
            names += [joint.get("name"), mimic.get("joint")]
    for tag in ("equality", "tendon"):
        for coupling in root.iterfind(f".//{tag}//joint"):
            names += map(coupling.get, ("joint", "joint1", "joint2"))
    return sorted({name for name in names if name})


def LockJoints(
    plant: MultibodyPlant, model: ModelInstanceIndex, names: Sequence[str]
) -> None:
    """Welds joints at their default positions.

    Raises:
        ScenarioError: If the model has no such joint that moves.
    """
    for name in names:
        joints = {
            joint.name(): joint
            for joint in _Joints(plant, model)
            if isinstance(joint, (PrismaticJoint, RevoluteJoint))
        }
        if name not in joints:
            Refuse("locked", name, f"names of joints: {', '.join(joints)}")
        joint = joints[name]
        frames = joint.frame_on_parent(), joint.frame_on_child()
        weld = WeldJoint(name, *frames, _DefaultPose(joint))
        for motor in _Motors(plant, joint):
            plant.RemoveJointActuator(motor)
        plant.RemoveJoint(joint)
        plant.AddJoint(weld)


def PlaceBase(
    plant: MultibodyPlant, model: ModelInstanceIndex, X_WB: RigidTransform
) -> None:
    """Moves a model by X_WB, and welds it to the world unless a joint connects it.

    Raises:
        ScenarioError: If a joint to the world is of a kind that cannot be moved.
    """
    joints = _Joints(plant, model)
    roots = [joint for joint in joints if joint.parent_body().index() == 0]
    children = {joint.child_body().index() for joint in joints}
    bases = [i for i in plant.GetBodyIndices(model) if i not in children]
    if not roots and len(bases) == 1:
        base = plant.get_body(bases[0]).body_frame()
        plant.WeldFrames(plant.world_frame(), base, X_WB)
    if not X_WB.IsExactlyIdentity():
        for joint in roots:
            _MoveRoot(plant, joint, X_WB)


def AddMotors(plant: MultibodyPlant, model: ModelInstanceIndex) -> None:
    """Gives each joint one motor, in place of a position controller if it has one."""
    for joint in _Joints(plant, model):
        motors = _Motors(plant, joint)
        for motor in motors:
            if motor.has_controller():
                _Take(plant, motor).AddTo(plant, joint)
        if not motors and joint.num_velocities() == 1:
            plant.AddJointActuator(f"{joint.name()}_motor", joint)


def _Joints(plant: MultibodyPlant, model: ModelInstanceIndex) -> list[Joint]:
    return [plant.get_joint(i) for i in plant.GetJointIndices(model)]


def _Motors(plant: MultibodyPlant, joint: Joint) -> list[JointActuator]:
    motors = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    return [motor for motor in motors if motor.joint().index() == joint.index()]


def _DefaultPose(joint: Joint) -> RigidTransform:
    """Returns the default pose X_FM of a revolute or prismatic joint."""
    position = joint.default_positions()[0]
    if isinstance(joint, RevoluteJoint):
        turn = AngleAxis(position, joint.revolute_axis())
        return RigidTransform(turn, np.zeros(3))
    assert isinstance(joint, PrismaticJoint)
    return RigidTransform(position * joint.translation_axis())


def _MoveRoot(plant: MultibodyPlant, joint: Joint, X_WB: RigidTransform) -> None:
    """Moves the frame in the world of a joint that connects a model to it."""
    name = joint.name()
    world = plant.world_frame()
    X_WF = X_WB @ joint.frame_on_parent().GetFixedPoseInBodyFrame()
    model = joint.model_instance()
    parent = plant.AddFrame(FixedOffsetFrame(f"{name}_base", world, X_WF, model))
    frames = parent, joint.frame_on_child()
    moved: Joint
    if isinstance(joint, WeldJoint):
        moved = WeldJoint(name, *frames, joint.X_FM())
    elif isinstance(joint, RevoluteJoint):
        moved = RevoluteJoint(name, *frames, joint.revolute_axis(), *_Limits(joint))
    elif isinstance(joint, PrismaticJoint):
        moved = PrismaticJoint(name, *frames, joint.translation_axis(), *_Limits(joint))
    else:
        kind = joint.type_name()
        Refuse("base", X_WB.translation(), f"null for a model on a {kind} joint")
    moved.set_default_positions(joint.default_positions())
    motors = [_Take(plant, motor) for motor in _Motors(plant, joint)]
    plant.RemoveJoint(joint)
    moved = plant.AddJoint(moved)
    for motor in motors:
        motor.AddTo(plant, moved)


def _Limits(joint: Joint) -> tuple[float, float, float]:
    """Returns the limits of the position and the damping of a joint of one degree."""
    lower = joint.position_lower_limits()[0]
    upper = joint.position_upper_limits()[0]
    return lower, upper, joint.default_damping_vector()[0]


class _Motor(NamedTuple):
    """A motor without a position controller; see Drake's JointActuator."""

    name: str
    effort_limit: float
    rotor_inertia: float
    gear_ratio: float

    def AddTo(self, plant: MultibodyPlant, joint: Joint) -> None:
        motor = plant.AddJointActuator(self.name, joint, self.effort_limit)
        motor.set_default_rotor_inertia(self.rotor_inertia)
        motor.set_default_gear_ratio(self.gear_ratio)


def _Take(plant: MultibodyPlant, motor: JointActuator) -> _Motor:
    """Removes a motor from a plant, and returns it."""
    taken = _Motor(
        motor.name(),
        motor.effort_limit(),
        motor.default_rotor_inertia(),
        motor.default_gear_ratio(),
    )
    plant.RemoveJointActuator(motor)
    return taken
