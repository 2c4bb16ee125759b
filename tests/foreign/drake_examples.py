"""Drake's examples and tutorials: what each is made of."""

import numpy as np
from foreign.wiring import (
    Add,
    Chain,
    Feed,
    Loop,
    Own,
    Published,
    SerialArm,
    StateFeedback,
)
from pydrake.common import FindResourceOrThrow, RandomDistribution
from pydrake.examples import (
    AcrobotGeometry,
    AcrobotPlant,
    AcrobotSpongController,
    CompassGait,
    PendulumGeometry,
    PendulumPlant,
    QuadrotorPlant,
    RimlessWheel,
    StabilizingLQRController,
    VanDerPolOscillator,
)
from pydrake.geometry import HalfSpace, SceneGraph, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    LinearSpringDamper,
    PrismaticJoint,
    PrismaticSpring,
    SpatialInertia,
    UnitInertia,
)
from pydrake.symbolic import Variable
from pydrake.systems import primitives as drake
from pydrake.systems.controllers import PidControlledSystem, PidController
from pydrake.systems.estimators import LuenbergerObserver, SteadyStateKalmanFilter
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial


def PassivePendulum(builder):
    plant = Add(builder, "plant", PendulumPlant())
    Feed(builder, plant, [0.0])
    return {plant: [1.0, 0.0]}


def PendulumWithPid(builder):
    """The tutorial on dynamical systems: to pi, from 0.2 rad above hanging."""
    plant = Add(builder, "plant", PendulumPlant())
    controller = Add(builder, "controller", PidController([10.0], [1.0], [1.0]))
    wish = Add(builder, "wish", drake.ConstantVectorSource([np.pi, 0.0]))
    Loop(builder, controller, plant)
    builder.Connect(wish.get_output_port(), controller.get_input_port_desired_state())
    drake.LogVectorOutput(plant.get_state_output_port(), builder).set_name("log")
    return {plant: [np.pi + 0.1, 0.2]}


def PendulumDrawn(builder):
    plant = Add(builder, "plant", PendulumPlant())
    scene = Add(builder, "scene_graph", SceneGraph())
    Feed(builder, plant, [0.0])
    PendulumGeometry.AddToBuilder(builder, plant.get_state_output_port(), scene)
    return {plant: [1.0, 0.0]}


def PassiveAcrobot(builder):
    plant = Add(builder, "plant", AcrobotPlant())
    Feed(builder, plant, [0.0])
    return {plant: [1.0, 1.0, 0.0, 0.0]}


def AcrobotDrawn(builder):
    plant = Add(builder, "plant", AcrobotPlant())
    scene = Add(builder, "scene_graph", SceneGraph())
    Feed(builder, plant, [0.0])
    AcrobotGeometry.AddToBuilder(builder, plant.get_output_port(0), scene)
    return {plant: [1.0, 1.0, 0.0, 0.0]}


def AcrobotWithSpong(builder):
    plant = Add(builder, "plant", AcrobotPlant())
    Loop(builder, Add(builder, "controller", AcrobotSpongController()), plant)
    return {plant: [0.1, 0.1, 0.0, 0.02]}


def AcrobotFromUrdf(builder):
    plant = Add(builder, "plant", MultibodyPlant(0.0))
    url = FindResourceOrThrow("drake/examples/acrobot/Acrobot.urdf")
    Parser(plant).AddModels(url)
    plant.Finalize()
    return {plant: [1.0, 0.5, 0.0, 0.0]}


def CartPoleFromSdf(builder):
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    url = FindResourceOrThrow("drake/examples/multibody/cart_pole/cart_pole.sdf")
    Parser(plant).AddModels(url)
    plant.Finalize()
    return {plant: [0.0, 2.0, 0.0, 0.0]}


def PendulumFromUrdf(builder):
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    url = FindResourceOrThrow("drake/examples/pendulum/Pendulum.urdf")
    Parser(plant).AddModels(url)
    plant.Finalize()
    return {plant: [1.0, 0.0]}


def VanDerPol(builder):
    return {Add(builder, "oscillator", VanDerPolOscillator()): [-0.1, -0.2]}


def QuadrotorAtRest(builder):
    plant = Add(builder, "plant", QuadrotorPlant())
    controller = StabilizingLQRController(plant, [0.0, 0.0, 1.0])
    Loop(builder, Add(builder, "controller", controller), plant)
    return {plant: 0.05 * np.arange(12.0)}


def RimlessWheelWalks(builder):
    return {Add(builder, "wheel", RimlessWheel()): [0.0, 1.5]}


def CompassGaitWalks(builder):
    plant = Add(builder, "gait", CompassGait())
    Feed(builder, plant, [0.0])
    return {plant: [0.0, 0.0, 0.4, -2.0]}


def SymbolicCubic(builder):
    """The tutorial on dynamical systems: dx/dt = -x + x^3."""
    x = Variable("x")
    system = drake.SymbolicVectorSystem(state=[x], dynamics=[-x + x**3], output=[x])
    return {Add(builder, "cubic", system): [0.9]}


def SymbolicCubicInSteps(builder):
    x = Variable("x")
    system = drake.SymbolicVectorSystem(
        state=[x], dynamics=[x**3], output=[x], time_period=0.1
    )
    return {Add(builder, "cubic", system): [0.9]}


def LeafCubic(builder):
    """The tutorial on leaf systems."""
    system = Own((0, 1, 1), lambda t, x, u: x, lambda t, x, u: -x + x**3)
    return {Add(builder, "cubic", system): [0.9]}


def LeafCubicInSteps(builder):
    system = Own((0, 1, 1), lambda t, x, u: x, lambda t, x, u: x**3, period=0.1)
    return {Add(builder, "cubic", system): [0.9]}


def LeafAdder(builder):
    """The tutorial on leaf systems: a block without state, fed by a sine."""
    system = Add(builder, "sum", Own((2, 0, 1), lambda t, x, u: [u[0] + u[1]]))
    wave = drake.Sine([1.0, 2.0], [3.0, 1.0], [0.0, 0.5], True)
    Chain(builder, Add(builder, "wave", wave), system)
    return {}


def NestedPid(builder):
    """The tutorial on diagrams: a controlled pendulum as a part of another diagram."""
    inner = DiagramBuilder()
    plant = Add(inner, "plant", PendulumPlant())
    controller = Add(inner, "controller", PidController([10.0], [1.0], [1.0]))
    Loop(inner, controller, plant)
    inner.ExportInput(controller.get_input_port_desired_state(), "desired_state")
    inner.ExportOutput(plant.get_state_output_port(), "state")
    part = inner.Build()
    part.set_name("controlled")
    Add(builder, "controlled", part)
    Feed(builder, part, [1.0, 0.0])
    return {plant: [0.2, 0.0]}


def DoubleIntegratorWithPid(builder):
    plant = drake.LinearSystem(
        [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), np.zeros((2, 1))
    )
    plant.set_name("plant")
    loop = PidControlledSystem(plant, 3.0, 0.2, 2.0)
    Add(builder, "loop", loop)
    zero = Add(builder, "zero", drake.ConstantVectorSource([0.0]))
    wish = Add(builder, "wish", drake.ConstantVectorSource([1.0, 0.0]))
    builder.Connect(zero.get_output_port(), loop.get_input_port(0))
    builder.Connect(wish.get_output_port(), loop.get_input_port(1))
    return {plant: [0.3, -0.2]}


def LuenbergerOfALinearSystem(builder):
    plant = drake.LinearSystem(
        [[0.0, 1.0], [-2.0, -0.1]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
    )
    observer = LuenbergerObserver(plant, plant.CreateDefaultContext(), [[3.0], [2.0]])
    return _Observed(builder, plant, observer)


def KalmanOfALinearSystem(builder):
    plant = drake.LinearSystem(
        [[0.0, 1.0], [-2.0, -0.1]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
    )
    return _Observed(builder, plant, SteadyStateKalmanFilter(plant, np.eye(2), [[0.1]]))


def _Observed(builder, plant, observer):
    Add(builder, "plant", plant)
    Add(builder, "observer", observer)
    wave = Add(builder, "wave", drake.Sine(1.0, 2.0, 0.3, 1, True))
    Chain(builder, wave, plant, observer)
    builder.Connect(wave.get_output_port(0), observer.get_input_port(1))
    return {plant: [1.0, 0.5]}


def FilteredSine(builder):
    wave = Add(builder, "wave", drake.Sine([1.0, 2.0], [3.0, 7.0], [0.0, 0.3], True))
    Chain(builder, wave, Add(builder, "filter", drake.FirstOrderLowPassFilter(0.1, 2)))
    return {}


def DelayedSine(builder):
    wave = Add(builder, "wave", drake.Sine(1.0, 3.0, 0.1, 1, True))
    delay = Add(builder, "delay", drake.DiscreteTimeDelay(0.05, 3, 1))
    Chain(builder, wave, delay, Add(builder, "integral", drake.Integrator(1)))
    return {}


def HeldPendulum(builder):
    """A pendulum whose torque is a sampled feedback."""
    plant = Add(builder, "plant", PendulumPlant())
    hold = Add(builder, "hold", drake.ZeroOrderHold(0.02, 2))
    law = Add(builder, "law", StateFeedback([[5.0, 1.0]], [0.5, 0.0], [0.0]))
    Loop(builder, plant, hold, law)
    return {plant: [0.2, 0.0]}


def TrackedTrajectory(builder):
    plant = Add(builder, "plant", PendulumPlant())
    controller = Add(builder, "controller", PidController([10.0], [1.0], [1.0]))
    path = PiecewisePolynomial.CubicShapePreserving([0.0, 1.0, 2.0], [[0.0, 1.0, 0.5]])
    source = Add(builder, "path", drake.TrajectorySource(path, 1))
    Loop(builder, controller, plant)
    builder.Connect(source.get_output_port(), controller.get_input_port_desired_state())
    return {plant: [0.2, 0.0]}


def NoisyFilter(builder):
    noise = drake.RandomSource(RandomDistribution.kGaussian, 1, 0.01)
    system = Add(builder, "filter", drake.FirstOrderLowPassFilter(0.1, 1))
    Chain(builder, Add(builder, "noise", noise), system)
    return {}


def FallingBody(builder):
    plant = Add(builder, "plant", MultibodyPlant(0.0))
    inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidBox(0.1, 0.2, 0.3))
    plant.AddRigidBody("body", inertia)
    plant.Finalize()
    return {plant: [1.0, *np.zeros(5), 1.0, *np.zeros(6)]}


def DoublePendulum(builder):
    plant = Add(builder, "plant", SerialArm([0.5, 0.5], actuated=()))
    return {plant: [1.0, 0.3, 0.0, 0.0]}


def DoublePendulumInSteps(builder):
    plant = Add(builder, "plant", SerialArm([0.5, 0.5], time_step=0.001, actuated=()))
    builder.ExportOutput(plant.get_state_output_port(), "state")
    return {plant: [1.0, 0.3, 0.0, 0.0]}


def SprungMasses(builder):
    """Two masses on a rail: one hangs on a spring, the other on a spring and damper."""
    plant = MultibodyPlant(0.0)
    first = Slider(plant, "first")
    second = Slider(plant, "second", first)
    rail = plant.GetJointByName("rail of first")
    plant.AddForceElement(PrismaticSpring(rail, 0.1, 30.0))
    ends = first, [0.0, 0.0, 0.0], second, [0.0, 0.0, -0.5]
    plant.AddForceElement(LinearSpringDamper(*ends, 0.3, 10.0, 0.4))
    plant.Finalize()
    return {Add(builder, "plant", plant): [0.1, 0.2, 0.0, 0.0]}


def FallingBall(builder):
    """A ball falls along a rail onto the ground."""
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
    plant.set_name("plant")
    ball = Slider(plant, "ball")
    friction = CoulombFriction(0.5, 0.5)
    for body, shape, name in [
        (ball, Sphere(0.1), "skin"),
        (plant.world_body(), HalfSpace(), "ground"),
    ]:
        plant.RegisterCollisionGeometry(body, RigidTransform(), shape, name, friction)
    plant.Finalize()
    builder.ExportOutput(plant.get_state_output_port(), "state")
    return {plant: [0.5, 0.0]}


def Slider(plant, name, parent=None):
    """Adds a mass that slides up and down, on the world or on another body."""
    inertia = UnitInertia.SolidSphere(0.1)
    body = plant.AddRigidBody(name, SpatialInertia(1.0, np.zeros(3), inertia))
    frame = plant.world_frame() if parent is None else parent.body_frame()
    up = [0.0, 0.0, 1.0]
    plant.AddJoint(PrismaticJoint(f"rail of {name}", frame, body.body_frame(), up))
    return body


DRAKE = [
    Published("pendulum", PassivePendulum, "an example plant"),
    Published("pendulum with PID", PendulumWithPid, "`PidController`"),
    Published("pendulum with geometry", PendulumDrawn, "`SceneGraph`"),
    Published("acrobot", PassiveAcrobot, "an example plant"),
    Published("acrobot with geometry", AcrobotDrawn, "`SceneGraph`"),
    Published(
        "acrobot with Spong's controller",
        AcrobotWithSpong,
        "an example controller",
        "Drake has no symbolic form of it",
    ),
    Published("acrobot from URDF", AcrobotFromUrdf, "URDF"),
    Published("cart-pole from SDF", CartPoleFromSdf, "SDF"),
    Published("pendulum from URDF", PendulumFromUrdf, "URDF, a limited joint"),
    Published("Van der Pol", VanDerPol, "an example plant"),
    Published("quadrotor with LQR", QuadrotorAtRest, "rotations in three dimensions"),
    Published(
        "rimless wheel",
        RimlessWheelWalks,
        "impacts",
        "Drake has no symbolic form of it",
    ),
    Published(
        "compass gait",
        CompassGaitWalks,
        "impacts",
        "it has a state or parameter that is not a vector",
    ),
    Published("cubic", SymbolicCubic, "`SymbolicVectorSystem`"),
    Published("cubic in steps", SymbolicCubicInSteps, "the same with a period"),
    Published("cubic in Python", LeafCubic, "`LeafSystem`"),
    Published(
        "cubic in steps in Python", LeafCubicInSteps, "`LeafSystem` with a period"
    ),
    Published("adder in Python", LeafAdder, "`LeafSystem` without state"),
    Published("nested PID", NestedPid, "nested Diagrams"),
    Published("double integrator with PID", DoubleIntegratorWithPid, "exported ports"),
    Published("Luenberger observer", LuenbergerOfALinearSystem, "`LuenbergerObserver`"),
    Published("Kalman filter", KalmanOfALinearSystem, "`SteadyStateKalmanFilter`"),
    Published("filtered sine", FilteredSine, "`FirstOrderLowPassFilter`"),
    Published("delayed sine", DelayedSine, "`DiscreteTimeDelay`"),
    Published("sampled pendulum", HeldPendulum, "`ZeroOrderHold`"),
    Published(
        "tracked trajectory",
        TrackedTrajectory,
        "`TrajectorySource`",
        "pydrake does not tell its trajectory",
    ),
    Published("noisy filter", NoisyFilter, "`RandomSource`"),
    Published(
        "falling body",
        FallingBody,
        "a floating body",
        "joint body is quaternion_floating",
    ),
    Published("double pendulum", DoublePendulum, "`MultibodyPlant`"),
    Published("double pendulum in steps", DoublePendulumInSteps, "a discrete plant"),
    Published("sprung masses", SprungMasses, "springs and dampers"),
    Published("falling ball", FallingBall, "contact", "its bodies can collide"),
]
