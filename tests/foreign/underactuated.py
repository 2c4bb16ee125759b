"""Examples of the course "Underactuated Robotics": what each is made of."""

import numpy as np
from foreign.wiring import (
    Add,
    Chain,
    Loop,
    Own,
    Published,
    SerialArm,
    StateFeedback,
)
from pydrake.common import FindResourceOrThrow
from pydrake.examples import AcrobotPlant, PendulumGeometry, PendulumPlant
from pydrake.geometry import SceneGraph
from pydrake.math import BarycentricMesh
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.symbolic import Variable, cos, sin, tanh
from pydrake.systems import primitives as drake
from pydrake.systems.controllers import (
    DiscreteTimeLinearQuadraticRegulator,
    FiniteHorizonLinearQuadraticRegulator,
    LinearQuadraticRegulator,
    MakeFiniteHorizonLinearQuadraticRegulator,
)
from pydrake.systems.framework import LeafSystem, WitnessFunctionDirection
from pydrake.systems.planar_scenegraph_visualizer import (
    ConnectPlanarSceneGraphVisualizer,
)
from pydrake.systems.pyplot_visualizer import PyPlotVisualizer


def Regulator(plant, x0, u0, Q, R, actuation=None, state=None):
    """Returns the LQR of a plant about a fixed point.

    Args:
        actuation: The input port; None: the only one.
        state: The output port of the state; None: the first one.
    """
    actuation = actuation or plant.get_input_port()
    state = state or plant.get_output_port(0)
    context = plant.CreateDefaultContext()
    context.SetContinuousState(x0)
    actuation.FixValue(context, u0)
    linear = drake.Linearize(plant, context, actuation.get_index(), state.get_index())
    K, _ = LinearQuadraticRegulator(linear.A(), linear.B(), Q, R)
    return StateFeedback(K, x0, u0)


def PendulumWithLqr(builder):
    plant = Add(builder, "plant", PendulumPlant())
    law = Regulator(plant, [np.pi, 0.0], [0.0], np.diag([10.0, 1.0]), [[1.0]])
    Loop(builder, plant, Add(builder, "law", law))
    return {plant: [np.pi + 0.2, 0.1]}


def PendulumWithWrappedLqr(builder):
    plant = Add(builder, "plant", PendulumPlant())
    law = Regulator(plant, [np.pi, 0.0], [0.0], np.diag([10.0, 1.0]), [[1.0]])
    wrap = drake.WrapToSystem(2)
    wrap.set_interval(0, 0.0, 2 * np.pi)
    Loop(builder, plant, Add(builder, "wrap", wrap), Add(builder, "law", law))
    return {plant: [np.pi + 0.2, 0.1]}


def PendulumWithPolicy(builder):
    """A policy on a mesh of angle and rate, as value iteration leaves it."""
    plant = Add(builder, "plant", PendulumPlant())
    wrap = drake.WrapToSystem(2)
    wrap.set_interval(0, 0.0, 2 * np.pi)
    mesh = BarycentricMesh(
        [set(np.linspace(0.0, 2 * np.pi, 51)), set(np.linspace(-10.0, 10.0, 41))]
    )
    points = mesh.get_all_mesh_points()
    torques = np.clip(10 * (np.pi - points[0]) - 3 * points[1], -3.0, 3.0)
    policy = drake.BarycentricMeshSystem(mesh, torques[np.newaxis])
    Loop(builder, plant, Add(builder, "wrap", wrap), Add(builder, "policy", policy))
    return {plant: [0.1, 0.0]}


def PendulumSwingsUp(builder):
    """Energy shaping in Python."""
    plant = Add(builder, "plant", PendulumPlant())

    def Torque(t, x, u):
        energy = 0.125 * u[1] ** 2 - 9.81 * 0.5 * np.cos(u[0])
        return [0.1 * u[1] - u[1] * (energy - 4.905)]

    Loop(builder, plant, Add(builder, "law", Own((2, 0, 1), Torque)))
    return {plant: [0.1, 0.0]}


def PendulumWithLimitedTorque(builder):
    plant = Add(builder, "plant", PendulumPlant())
    law = Regulator(plant, [np.pi, 0.0], [0.0], np.diag([10.0, 1.0]), [[1.0]])
    limit = Add(builder, "limit", drake.Saturation([-1.0], [1.0]))
    Loop(builder, plant, Add(builder, "law", law), limit)
    return {plant: [np.pi + 0.4, 0.1]}


def PendulumWithNetwork(builder):
    """A policy that is a multilayer perceptron."""
    plant = Add(builder, "plant", PendulumPlant())
    policy = drake.MultilayerPerceptron([2, 8, 1])
    Loop(builder, plant, Add(builder, "policy", policy))
    return {plant: [1.0, 0.0]}


def AcrobotWithLqr(builder):
    plant = Add(builder, "plant", AcrobotPlant())
    top = [np.pi, 0.0, 0.0, 0.0]
    law = Regulator(plant, top, [0.0], np.diag([10.0, 10.0, 1.0, 1.0]), [[1.0]])
    Loop(builder, plant, Add(builder, "law", law))
    return {plant: [np.pi + 0.02, 0.01, 0.0, 0.0]}


def CartPoleWithLqr(builder):
    plant = MultibodyPlant(0.0)
    plant.set_name("plant")
    url = FindResourceOrThrow("drake/examples/multibody/cart_pole/cart_pole.sdf")
    Parser(plant).AddModels(url)
    plant.Finalize()
    builder.AddSystem(plant)
    ports = plant.get_actuation_input_port(), plant.get_state_output_port()
    top = [0.0, np.pi, 0.0, 0.0]
    Q = np.diag([10.0, 10.0, 1.0, 1.0])
    law = Add(builder, "law", Regulator(plant, top, [0.0], Q, [[1.0]], *ports))
    builder.Connect(plant.get_state_output_port(), law.get_input_port())
    builder.Connect(law.get_output_port(), plant.get_actuation_input_port())
    return {plant: [0.0, np.pi + 0.1, 0.0, 0.0]}


def Lorenz(builder):
    x, y, z = (Variable(name) for name in "xyz")
    system = drake.SymbolicVectorSystem(
        state=[x, y, z],
        dynamics=[10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z],
        output=[x, y, z],
    )
    return {Add(builder, "attractor", system): [1.0, 1.0, 20.0]}


def Autapse(builder):
    """One neuron that feeds itself."""
    x = Variable("x")
    u = Variable("u")
    system = drake.SymbolicVectorSystem(
        state=[x], input=[u], dynamics=[-x + tanh(2 * x + u)], output=[x]
    )
    Add(builder, "neuron", system)
    wave = Add(builder, "wave", drake.Sine(0.5, 2.0, 0.0, 1, True))
    Chain(builder, wave, system)
    return {system: [0.1]}


def PlanarQuadrotor(builder):
    """The planar quadrotor, in symbols, hovering by LQR."""
    q = [Variable(name) for name in ("x", "y", "theta", "vx", "vy", "w")]
    u = [Variable("u0"), Variable("u1")]
    thrust = (u[0] + u[1]) / 0.486
    plant = drake.SymbolicVectorSystem(
        state=q,
        input=u,
        dynamics=[
            *q[3:],
            -thrust * sin(q[2]),
            thrust * cos(q[2]) - 9.81,
            0.25 / 0.00383 * (u[0] - u[1]),
        ],
        output=q,
    )
    Add(builder, "plant", plant)
    hover = [0.486 * 9.81 / 2] * 2
    Q = np.diag([10.0, 10.0, 10.0, 1.0, 1.0, 0.025])
    law = Regulator(plant, np.zeros(6), hover, Q, 0.1 * np.eye(2))
    Loop(builder, plant, Add(builder, "law", law))
    return {plant: [0.3, -0.2, 0.1, 0.0, 0.0, 0.0]}


def DubinsCar(builder):
    x, y, heading, turn = (Variable(name) for name in ("x", "y", "heading", "turn"))
    car = drake.SymbolicVectorSystem(
        state=[x, y, heading],
        input=[turn],
        dynamics=[cos(heading), sin(heading), turn],
        output=[x, y, heading],
    )
    wave = Add(builder, "wave", drake.Sine(1.0, 2.0, 0.0, 1, True))
    Chain(builder, wave, Add(builder, "car", car))
    return {car: [0.0, 0.0, 0.3]}


def DoubleIntegrator():
    return drake.LinearSystem(
        [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), np.zeros((2, 1))
    )


def DoubleIntegratorWithLqr(builder):
    plant = Add(builder, "plant", DoubleIntegrator())
    law = Regulator(plant, [0.0, 0.0], [0.0], np.eye(2), [[1.0]])
    Loop(builder, plant, Add(builder, "law", law))
    return {plant: [1.0, -0.5]}


def DoubleIntegratorInSteps(builder):
    A = np.array([[1.0, 0.1], [0.0, 1.0]])
    B = np.array([[0.005], [0.1]])
    plant = drake.LinearSystem(A, B, np.eye(2), np.zeros((2, 1)), time_period=0.1)
    K, _ = DiscreteTimeLinearQuadraticRegulator(A, B, np.eye(2), np.eye(1))
    Add(builder, "plant", plant)
    Loop(builder, plant, Add(builder, "law", StateFeedback(K, [0.0, 0.0], [0.0])))
    return {plant: [1.0, -0.5]}


def DoubleIntegratorInMinimalTime(builder):
    """Bang-bang control in Python, smooth about the switching curve."""
    plant = Add(builder, "plant", DoubleIntegrator())

    def Force(t, x, u):
        return [-np.tanh(5 * (u[0] + 0.5 * u[1] * abs(u[1])))]

    Loop(builder, plant, Add(builder, "law", Own((2, 0, 1), Force)))
    return {plant: [1.0, -0.5]}


def DoubleIntegratorWithFiniteHorizon(builder):
    plant = Add(builder, "plant", DoubleIntegrator())
    context = plant.CreateDefaultContext()
    plant.get_input_port().FixValue(context, [0.0])
    law = MakeFiniteHorizonLinearQuadraticRegulator(
        plant, context, 0.0, 1.0, np.eye(2), np.eye(1)
    )
    Loop(builder, plant, Add(builder, "law", law))
    return {plant: [1.0, -0.5]}


class FiniteHorizonLaw(LeafSystem):
    """The regulator of a finite horizon, from the trajectories that Drake finds."""

    def __init__(self, result):
        LeafSystem.__init__(self)
        self.result = result
        self.DeclareVectorInputPort("state", 2)
        self.DeclareVectorOutputPort("control", 1, self.CalcControl)

    def CalcControl(self, context, control):
        t = context.get_time()
        error = self.get_input_port().Eval(context) - self.result.x0.value(t)[:, 0]
        feedback = self.result.K.value(t) @ error + self.result.k0.value(t)[:, 0]
        control.SetFromVector(self.result.u0.value(t)[:, 0] - feedback)


def DoubleIntegratorWithFiniteHorizonInPython(builder):
    plant = Add(builder, "plant", DoubleIntegrator())
    context = plant.CreateDefaultContext()
    plant.get_input_port().FixValue(context, [0.0])
    result = FiniteHorizonLinearQuadraticRegulator(
        plant, context, 0.0, 1.0, np.eye(2), np.eye(1)
    )
    Loop(builder, plant, Add(builder, "law", FiniteHorizonLaw(result)))
    return {plant: [1.0, -0.5]}


def Glider(builder):
    """A glider that perches: a flat plate with a velocity, in Python."""

    def Rate(t, x, u):
        vx, vz, pitch = x[2:]
        attack = pitch - np.arctan2(vz, vx)
        lift = 2.0 * np.sin(attack) * (vx**2 + vz**2)
        return [vx, vz, -lift * np.sin(pitch), lift * np.cos(pitch) - 9.81, -attack]

    system = Own((0, 5, 5), lambda t, x, u: x, Rate)
    return {Add(builder, "glider", system): [-3.5, 0.1, 7.0, 0.0, 0.1]}


def SpringLoadedHopper(builder):
    """A hopper with a leg that is a stiff spring on the ground, in Python."""

    def Rate(t, x, u):
        return [x[1], max(0.0, 1.0 - x[0]) * 500.0 - 9.81]

    system = Own((0, 2, 2), lambda t, x, u: x, Rate)
    return {Add(builder, "hopper", system): [1.01, 0.0]}


def TriplePendulum(builder):
    plant = Add(builder, "plant", SerialArm([0.5, 0.4, 0.3], actuated=(1, 2)))
    builder.ExportOutput(plant.get_state_output_port(), "state")
    return {plant: [1.0, 0.3, -0.2, 0.0, 0.0, 0.0]}


class Picture(PyPlotVisualizer):
    """It draws with matplotlib."""

    def __init__(self):
        PyPlotVisualizer.__init__(self, show=False)
        self.DeclareVectorInputPort("state", 2)

    def draw(self, context):
        self.ax.plot(*self.get_input_port().Eval(context), "k.")


def PendulumInAPicture(builder):
    plant = Add(builder, "plant", PendulumPlant())
    picture = Add(builder, "picture", Picture())
    scene = Add(builder, "scene", SceneGraph())
    PendulumGeometry.AddToBuilder(builder, plant.get_state_output_port(), scene)
    ConnectPlanarSceneGraphVisualizer(builder, scene, show=False)
    torque = Add(builder, "torque", drake.ConstantVectorSource([0.1]))
    builder.Connect(torque.get_output_port(), plant.get_input_port())
    builder.Connect(plant.get_state_output_port(), picture.get_input_port())
    return {plant: [1.0, 0.0]}


class SwingUpAndBalance(LeafSystem):
    """It has two laws inside that are blocks: one swings up, the other balances."""

    def __init__(self, balance):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("state", 2)
        self.DeclareVectorOutputPort("torque", 1, self.CalcTorque)
        self.swing = Own((2, 0, 1), lambda t, x, u: [-0.5 * u[1] * (u[1] ** 2 - 20)])
        self.swing_context = self.swing.CreateDefaultContext()
        self.balance = balance
        self.balance_context = balance.CreateDefaultContext()

    def CalcTorque(self, context, torque):
        state = self.get_input_port().Eval(context)
        error = state - [np.pi, 0.0]
        if error.dot(error) < 0.3:
            self.balance.get_input_port().FixValue(self.balance_context, state)
            port = self.balance.get_output_port()
            torque.SetFromVector(port.Eval(self.balance_context))
        else:
            self.swing.get_input_port().FixValue(self.swing_context, state)
            port = self.swing.get_output_port()
            torque.SetFromVector(port.Eval(self.swing_context))


def PendulumWithTwoLaws(builder):
    plant = Add(builder, "plant", PendulumPlant())
    balance = drake.AffineSystem(D=[[-20.0, -4.0]], y0=[20.0 * np.pi])
    law = Add(builder, "law", SwingUpAndBalance(balance))
    builder.Connect(plant.get_state_output_port(), law.get_input_port())
    builder.Connect(law.get_output_port(), plant.get_input_port())
    return {plant: [2.7, 0.3]}


class CancelledDynamics(LeafSystem):
    """It cancels what its plant does, and lets it swing as a pendulum would."""

    def __init__(self, plant):
        LeafSystem.__init__(self)
        self.plant = plant
        self.own = plant.CreateDefaultContext()
        self.DeclareVectorInputPort("state", 4)
        self.DeclareVectorOutputPort("torque", 2, self.CalcTorque)

    def CalcTorque(self, context, torque):
        state = self.get_input_port().Eval(context)
        self.plant.SetPositionsAndVelocities(self.own, state)
        M = self.plant.CalcMassMatrix(self.own)
        weight = self.plant.CalcGravityGeneralizedForces(self.own)
        wish = [-5 * np.sin(state[0]) - 0.1 * state[2], -state[1] - 0.1 * state[3]]
        torque.SetFromVector(M @ wish + self.plant.CalcBiasTerm(self.own) - weight)


def DoublePendulumLikeAPendulum(builder):
    plant = Add(builder, "plant", SerialArm([0.5, 0.4]))
    law = Add(builder, "law", CancelledDynamics(plant))
    builder.Connect(plant.get_state_output_port(), law.get_input_port())
    builder.Connect(law.get_output_port(), plant.get_actuation_input_port())
    return {plant: [1.0, 0.0, 0.2, 0.0]}


class ReturnMap(LeafSystem):
    """An oscillator with a witness function where it passes a section."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareStateOutputPort("state", self.DeclareContinuousState(2))
        self.section = self.MakeWitnessFunction(
            "section", WitnessFunctionDirection.kNegativeThenNonNegative, self.Height
        )

    def DoCalcTimeDerivatives(self, context, derivatives):
        x, v = context.get_continuous_state_vector().CopyToVector()
        derivatives.get_mutable_vector().SetFromVector([v, (1 - x * x) * v / 5 - x])

    def Height(self, context):
        return context.get_continuous_state_vector()[0]

    def DoGetWitnessFunctions(self, context):
        return [self.section]


def OscillatorWithAReturnMap(builder):
    return {Add(builder, "oscillator", ReturnMap()): [0.1, 1.0]}


UNDERACTUATED = [
    Published("pendulum with LQR", PendulumWithLqr, "`LinearQuadraticRegulator`"),
    Published("pendulum with wrapped LQR", PendulumWithWrappedLqr, "`WrapToSystem`"),
    Published("pendulum with policy", PendulumWithPolicy, "`BarycentricMeshSystem`"),
    Published("pendulum swings up", PendulumSwingsUp, "energy shaping in Python"),
    Published("pendulum, limited torque", PendulumWithLimitedTorque, "`Saturation`"),
    Published("pendulum with network", PendulumWithNetwork, "`MultilayerPerceptron`"),
    Published("acrobot with LQR", AcrobotWithLqr, "`AffineSystem`"),
    Published("cart-pole with LQR", CartPoleWithLqr, "a plant of an instance"),
    Published("Lorenz attractor", Lorenz, "chaos"),
    Published("autapse", Autapse, "`tanh` in Python"),
    Published("planar quadrotor with LQR", PlanarQuadrotor, "trigonometry in symbols"),
    Published("Dubins car", DubinsCar, "a vehicle in Python"),
    Published("double integrator, LQR", DoubleIntegratorWithLqr, "`LinearSystem`"),
    Published(
        "double integrator in steps",
        DoubleIntegratorInSteps,
        "`LinearSystem` with a period",
    ),
    Published("minimal time", DoubleIntegratorInMinimalTime, "branches in Python"),
    Published(
        "finite horizon",
        DoubleIntegratorWithFiniteHorizon,
        "a time-varying regulator",
        "it has no symbolic form",
    ),
    Published(
        "finite horizon in Python",
        DoubleIntegratorWithFiniteHorizonInPython,
        "trajectories in Python",
    ),
    Published("perching glider", Glider, "aerodynamics in Python"),
    Published("spring loaded hopper", SpringLoadedHopper, "a stiff spring in Python"),
    Published("triple pendulum", TriplePendulum, "underactuation"),
    Published("pendulum in a picture", PendulumInAPicture, "`PyPlotVisualizer`"),
    Published(
        "cancelled dynamics",
        DoublePendulumLikeAPendulum,
        "a `MultibodyPlant` inside a law",
    ),
    Published("pendulum with two laws", PendulumWithTwoLaws, "blocks inside a block"),
    Published(
        "return map",
        OscillatorWithAReturnMap,
        "witness functions in Python",
        "it has witness functions",
    ),
]
