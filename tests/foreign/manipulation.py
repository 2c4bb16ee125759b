"""Examples of the course "Robotic Manipulation": what each is made of."""

import numpy as np
from foreign.wiring import Add, Own, Published, SerialArm
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PlanarJoint, RevoluteJoint, SpatialInertia
from pydrake.systems import primitives as drake
from pydrake.systems.controllers import (
    InverseDynamics,
    InverseDynamicsController,
    JointStiffnessController,
    PidController,
)

LENGTHS = [0.4, 0.3]
START = [0.5, -0.3, 0.0, 0.0]


def Follow(builder, plant, controller, wish):
    """Closes the loop of a plant and a controller of its state."""
    Add(builder, "controller", controller)
    source = Add(builder, "wish", drake.ConstantVectorSource(wish))
    builder.Connect(
        plant.get_state_output_port(), controller.get_input_port_estimated_state()
    )
    builder.Connect(source.get_output_port(), controller.get_input_port_desired_state())
    builder.Connect(controller.get_output_port(0), plant.get_actuation_input_port())


def ArmWithPid(builder):
    plant = Add(builder, "plant", SerialArm(LENGTHS))
    gains = [50.0, 30.0], [5.0, 3.0], [5.0, 3.0]
    Follow(builder, plant, PidController(*gains), [0.3, 0.2, 0.0, 0.0])
    return {plant: START}


def ArmWithPidInSteps(builder):
    """The controller is continuous, the plant takes steps of 2 ms."""
    plant = Add(builder, "plant", SerialArm(LENGTHS, time_step=0.002))
    builder.ExportOutput(plant.get_state_output_port(), "state")
    gains = [50.0, 30.0], [5.0, 3.0], [5.0, 3.0]
    Follow(builder, plant, PidController(*gains), [0.3, 0.2, 0.0, 0.0])
    return {plant: START}


def ArmOfSevenJoints(builder):
    """As long a chain as the iiwa's, with a PID controller."""
    plant = Add(builder, "plant", SerialArm([0.3] * 7))
    gains = [100.0] * 7, [1.0] * 7, [10.0] * 7
    Follow(builder, plant, PidController(*gains), np.zeros(14))
    return {plant: [0.1, 0.2, 0.1, -0.2, 0.1, 0.1, -0.1, *np.zeros(7)]}


def ArmOfAModelInstance(builder):
    """The ports are those of the model instance."""
    plant = Add(builder, "plant", SerialArm(LENGTHS))
    arm = plant.GetModelInstanceByName("arm")
    controller = Add(builder, "law", PidController([9.0] * 2, [1.0] * 2, [2.0] * 2))
    wish = Add(builder, "wish", drake.ConstantVectorSource([0.3, 0.2, 0.0, 0.0]))
    builder.Connect(
        plant.get_state_output_port(arm), controller.get_input_port_estimated_state()
    )
    builder.Connect(wish.get_output_port(), controller.get_input_port_desired_state())
    builder.Connect(
        controller.get_output_port_control(), plant.get_actuation_input_port(arm)
    )
    return {plant: START}


def ArmWithLimits(builder):
    plant = Add(builder, "plant", SerialArm(LENGTHS, time_step=0.001, limits=(-2, 2)))
    builder.ExportOutput(plant.get_state_output_port(), "state")
    return {plant: START}


def ArmWithInverseDynamics(builder):
    plant = Add(builder, "plant", SerialArm(LENGTHS))
    controller = InverseDynamicsController(
        plant, [40.0] * 2, [1.0] * 2, [12.0] * 2, False
    )
    Follow(builder, plant, controller, [0.3, 0.2, 0.0, 0.0])
    return {plant: START}


def ArmWithoutWeight(builder):
    plant = Add(builder, "plant", SerialArm(LENGTHS))
    law = InverseDynamics(
        plant, InverseDynamics.InverseDynamicsMode.kGravityCompensation
    )
    Add(builder, "law", law)
    builder.Connect(plant.get_state_output_port(), law.get_input_port_estimated_state())
    builder.Connect(
        law.get_output_port_generalized_force(), plant.get_actuation_input_port()
    )
    return {plant: START}


def StiffArm(builder):
    plant = Add(builder, "plant", SerialArm(LENGTHS))
    law = JointStiffnessController(plant, [40.0] * 2, [8.0] * 2)
    Follow(builder, plant, law, [0.3, 0.2, 0.0, 0.0])
    return {plant: START}


def ArmWithOwnLaw(builder):
    """A stiffness in joint space, written in Python."""
    plant = Add(builder, "plant", SerialArm(LENGTHS))

    def Torque(t, x, u):
        return 20.0 * (np.array([0.3, 0.2]) - u[:2]) - 2.0 * u[2:]

    law = Add(builder, "law", Own((4, 0, 2), Torque))
    builder.Connect(plant.get_state_output_port(), law.get_input_port())
    builder.Connect(law.get_output_port(), plant.get_actuation_input_port())
    return {plant: START}


def PositionInterface(builder):
    """A commanded position becomes a desired state, as in a hardware station."""
    plant = Add(builder, "plant", SerialArm(LENGTHS))
    controller = Add(builder, "law", PidController([9.0] * 2, [1.0] * 2, [2.0] * 2))
    command = Add(
        builder, "command", drake.Sine([0.3, 0.2], [2.0, 3.0], [0.0, 0.5], True)
    )
    desired = drake.StateInterpolatorWithDiscreteDerivative(2, 0.005, True)
    Add(builder, "desired", desired)
    builder.Connect(command.get_output_port(0), desired.get_input_port())
    builder.Connect(
        desired.get_output_port(), controller.get_input_port_desired_state()
    )
    builder.Connect(
        plant.get_state_output_port(), controller.get_input_port_estimated_state()
    )
    builder.Connect(
        controller.get_output_port_control(), plant.get_actuation_input_port()
    )
    return {plant: START}


def PushedDisc(builder):
    """A disc that slides and turns on a plane, and carries an arm with a motor."""
    plant = Add(builder, "plant", MultibodyPlant(0.001))
    plant.set_name("plant")
    inertia = SpatialInertia.SolidCylinderWithMass(2.0, 0.2, 0.1, [0.0, 0.0, 1.0])
    disc = plant.AddRigidBody("disc", inertia)
    plant.AddJoint(
        PlanarJoint("plane", plant.world_frame(), disc.body_frame(), [0.5, 0.5, 0.1])
    )
    link = plant.AddRigidBody("link", inertia)
    hinge = RevoluteJoint("hinge", disc.body_frame(), link.body_frame(), [0, 1, 0])
    plant.AddJointActuator("motor", plant.AddJoint(hinge))
    plant.Finalize()
    command = Add(builder, "command", drake.Sine(2.0, 3.0, 0.0, 1))
    builder.Connect(command.get_output_port(0), plant.get_actuation_input_port())
    return {plant: [0.0, 0.0, 0.3, 0.5, 0.4, -0.2, 2.0, 0.0]}


MANIPULATION = [
    Published("arm with PID", ArmWithPid, "a plant with motors"),
    Published(
        "arm in steps with PID",
        ArmWithPidInSteps,
        "a discrete plant in a continuous loop",
    ),
    Published("arm of seven joints", ArmOfSevenJoints, "a long chain"),
    Published("arm of a model instance", ArmOfAModelInstance, "ports of an instance"),
    Published(
        "arm with limits",
        ArmWithLimits,
        "joints with limits in a discrete plant",
        "it is discrete, and joint joint 0 has limits",
    ),
    Published(
        "inverse dynamics", ArmWithInverseDynamics, "`InverseDynamicsController`"
    ),
    Published("gravity compensation", ArmWithoutWeight, "`InverseDynamics`"),
    Published("joint stiffness", StiffArm, "`JointStiffnessController`"),
    Published("own law", ArmWithOwnLaw, "a law in Python"),
    Published(
        "position interface",
        PositionInterface,
        "`StateInterpolatorWithDiscreteDerivative`",
    ),
    Published("pushed disc", PushedDisc, "a planar joint"),
]
