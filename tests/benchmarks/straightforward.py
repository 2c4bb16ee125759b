"""The loop as one who knows Drake and numpy writes it first: the yardstick of speed."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import appendix_a
import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import (
    BasicVector,
    LeafSystem,
    System,
    UnrestrictedUpdateEvent,
    WitnessFunctionDirection,
)
from pydrake.systems.primitives import (
    Adder,
    DiscreteTimeDelay,
    Gain,
    LinearSystem,
    VectorLogSink,
)
from surfaces import Border
from wired import Wired

import teleop_drake
from teleop_drake.model.scenario import Scenario

MODELS = Path(teleop_drake.__file__).parent / "model/models"
ELBOW = {"up": -1.0, "down": 1.0}


class Block(LeafSystem):
    """A LeafSystem with ports of n numbers by their names."""

    def Inputs(self, n, *names):
        for name in names:
            setattr(self, name, self.DeclareVectorInputPort(name, n))

    def Output(self, name, n, compute, *tickets):
        def Set(context, output):
            output.SetFromVector(compute(context))

        self.DeclareVectorOutputPort(name, n, Set, prerequisites_of_calc=set(tickets))

    def Mode(self, context):
        return context.get_discrete_state_vector().value()[0]


class Delay(Block):
    """Delays a signal exactly; samples at the solver's steps, joined by cubics."""

    def __init__(self, delay: float, initial_value: np.ndarray, longest_step: float):
        LeafSystem.__init__(self)
        self.delay = delay
        self.initial_value = np.array(initial_value)
        self.size = len(self.initial_value)
        # Room for the short steps of error control as well.
        self.capacity = 200 + int(1.5 * delay / longest_step)
        self.Inputs(self.size, "signal")
        # Rows [time, value], the newest last.
        rows = np.zeros((self.capacity, 1 + self.size))
        rows[:, 0] = -math.inf
        rows[:, 1:] = self.initial_value
        self.DeclareDiscreteState(rows.ravel())
        tickets = self.time_ticket(), self.xd_ticket()
        self.Output("delayed_signal", self.size, self.CalcOutput, *tickets)
        # The first sees the signal before the events of a step, the second after them.
        self.DeclarePerStepUnrestrictedUpdateEvent(self.RecordBefore)
        self.DeclarePerStepDiscreteUpdateEvent(self.RecordAfter)

    def Rows(self, context):
        return context.get_discrete_state_vector().value().reshape(self.capacity, -1)

    def Pushed(self, context):
        rows = np.roll(self.Rows(context), -1, axis=0)
        rows[-1] = np.r_[context.get_time(), self.signal.Eval(context)]
        return rows.ravel()

    def RecordBefore(self, context, state):
        if context.get_time() > self.Rows(context)[-1, 0]:
            state.get_mutable_discrete_state(0).SetFromVector(self.Pushed(context))

    def RecordAfter(self, context, values):
        if not np.array_equal(self.signal.Eval(context), self.Rows(context)[-1, 1:]):
            values.set_value(0, self.Pushed(context))

    def CalcOutput(self, context):
        rows = self.Rows(context)
        t = context.get_time() - self.delay
        times = rows[:, 0]
        i = np.searchsorted(times, t)
        if t < 0:
            return self.initial_value
        if i == 0:
            raise RuntimeError("the delay's ring buffer is too short")
        if i == len(times) or not np.isfinite(times[i - 1]):
            return rows[min(i, len(times) - 1), 1:]
        # Two samples on either side, or those of them that no jump separates.
        first = i - 1
        last = i
        if np.isfinite(times[first - 1]) and times[first - 1] < times[first]:
            first -= 1
        if last + 1 < len(times) and times[last] < times[last + 1]:
            last += 1
        nodes = times[first : last + 1]
        value = np.zeros(self.size)
        for j in range(len(nodes)):
            others = np.delete(nodes, j)
            weight = np.prod((t - others) / (nodes[j] - others))
            value += weight * rows[first + j, 1:]
        return value


class Operator(Block):
    """Commands a velocity until the returned position is on the bone, then a force."""

    def __init__(self, velocity, contact_force, surface):
        LeafSystem.__init__(self)
        self.velocity = np.array(velocity)
        self.contact_force = contact_force
        self.surface = surface
        n = len(velocity)
        self.Inputs(n, "felt_position", "haptic_force")
        self.DeclareDiscreteState(1)
        mode = self.xd_ticket()
        self.Output("velocity_command", n, self.CalcVelocity, mode)
        tickets = mode, self.haptic_force.ticket()
        self.Output("force_command", n, self.CalcForce, *tickets)
        self.contact = self.MakeWitnessFunction(
            "contact",
            WitnessFunctionDirection.kNegativeThenNonNegative,
            self.PastSurface,
            UnrestrictedUpdateEvent(self.Switch),
        )
        # A position that comes in samples is no witness function's business.
        self.DeclarePerStepDiscreteUpdateEvent(self.Check)

    def DoGetWitnessFunctions(self, context):
        awaits = self.surface is not None and not self.Mode(context)
        return [self.contact] if awaits else []

    def PastSurface(self, context):
        return self.felt_position.Eval(context)[0] - self.surface

    def Switch(self, context, event, state):
        state.get_mutable_discrete_state(0).SetAtIndex(0, 1.0)

    def Check(self, context, values):
        if self.surface is not None and self.PastSurface(context) >= 0:
            values.set_value(0, [1.0])

    def CalcVelocity(self, context):
        return 0 * self.velocity if self.Mode(context) else self.velocity

    def CalcForce(self, context):
        has_contact = self.Mode(context)
        return self.contact_force if has_contact else self.haptic_force.Eval(context)


class AdaptiveBackstepping(Block):
    """(4.2) to (4.53) and (5.2) to (5.53), state [F_c, W1, Psi, W3]."""

    def __init__(self, scenario: Scenario):
        LeafSystem.__init__(self)
        c = scenario.controller
        n = scenario.num_axes
        self.n = n
        self.Lambda, self.G1, self.G2, self.P = (
            np.eye(n) * gain if np.ndim(gain) == 0 else np.array(gain)
            for gain in (c.Lambda, c.G1, c.G2, c.P)
        )
        self.beta = c.adaptation_rate
        self.nu = c.leakage
        self.Upsilon = c.supervision
        self.Psi_min = c.minimum_psi
        self.Psi0 = scenario.initial_psi
        axes = [
            np.linspace(*a)
            for a in zip(c.network.lower, c.network.upper, c.network.count, strict=True)
        ]
        self.means = np.array(np.meshgrid(*axes, indexing="ij")).reshape(n, -1).T
        spacing = np.array([axis[1] - axis[0] for axis in axes])
        self.R_inv = np.diag(1 / (c.network.width * spacing) ** 2)
        self.N = len(self.means)
        self.Inputs(n, "haptic_force", "velocity_command", "position", "velocity")
        self.Inputs(n, "environment_force")
        start = np.r_[
            np.zeros(n), np.zeros(n * self.N), self.Psi0.ravel(), np.zeros(n * self.N)
        ]
        self.DeclareContinuousState(BasicVector(start))
        xc = self.xc_ticket()
        self.Output("control_force", n, lambda x: self.Unpack(x)[0], xc)

    def Unpack(self, context):
        x = context.get_continuous_state_vector().CopyToVector()
        n = self.n
        N = self.N
        F_c, W1, Psi, W3 = np.split(x, np.cumsum([n, n * N, n * n]))
        return F_c, W1.reshape(n, N), Psi.reshape(n, n), W3.reshape(n, N)

    def DoCalcTimeDerivatives(self, context, derivatives):
        F_c, W1, Psi, W3 = self.Unpack(context)
        F_h = self.haptic_force.Eval(context)
        v_d = self.velocity_command.Eval(context)
        r = self.position.Eval(context)
        v = self.velocity.Eval(context)
        F_e = self.environment_force.Eval(context)

        d = r - self.means
        Phi = np.exp(-np.sum(d @ self.R_inv * d, axis=1))
        Phi_dot = -2 * Phi * (d @ self.R_inv @ v)
        Psi_inv = np.linalg.inv(Psi)

        s = (v - v_d) + self.Lambda @ (F_e - F_h)
        y1 = W1 @ Phi
        y3 = W3 @ Phi
        alpha = F_e - Psi_inv @ (y1 + self.G1 @ s)
        z = F_c - alpha
        s_dot = Psi @ (F_c - F_e) + y1
        g = self.P @ s + self.G1.T @ Psi_inv.T @ z
        W1_dot = self.beta * (np.outer(g, Phi) - self.nu * W1)
        W3_dot = self.beta * (-np.outer(z, Phi) - self.nu * W3)
        update = np.outer(g, F_c - F_e) + self.Upsilon * (self.Psi0 - Psi)
        U, sigma, Vt = np.linalg.svd(Psi)
        if sigma[-1] <= self.Psi_min:  # (4.53): no further down
            rate = U[:, -1] @ update @ Vt[-1]
            update -= min(rate, 0.0) * np.outer(U[:, -1], Vt[-1])
        Psi_dot = self.beta * update
        y1_dot = W1_dot @ Phi + W1 @ Phi_dot
        alpha_dot = (
            y3
            + Psi_inv @ Psi_dot @ Psi_inv @ (y1 + self.G1 @ s)
            - Psi_inv @ (y1_dot + self.G1 @ s_dot)
        )
        F_c_dot = alpha_dot - Psi.T @ self.P.T @ s - self.G2 @ z
        derivatives.SetFromVector(
            np.r_[F_c_dot, W1_dot.ravel(), Psi_dot.ravel(), W3_dot.ravel()]
        )


class TaskSpace(Block):
    """Joins the plant to task space: v = J qdot and tau = J^T (F_c - F_e)."""

    def __init__(self, plant: MultibodyPlant, n: int):
        LeafSystem.__init__(self)
        self.plant = plant
        self.n = n
        self.plant_context = plant.CreateDefaultContext()
        self.Inputs(plant.num_multibody_states(), "state")
        self.Inputs(n, "control_force", "environment_force")
        state = self.state.ticket()
        self.Output("position", n, self.CalcPosition, state)
        self.Output("velocity", n, self.CalcVelocity, state)
        forces = self.control_force.ticket(), self.environment_force.ticket()
        size = plant.num_velocities()
        self.Output("torque", size, self.CalcTorque, state, *forces)

    def Jacobian(self, context):
        x = self.state.Eval(context)
        self.plant.SetPositionsAndVelocities(self.plant_context, x)
        world = self.plant.world_frame()
        return self.plant.CalcJacobianTranslationalVelocity(
            self.plant_context,
            JacobianWrtVariable.kV,
            self.plant.GetFrameByName("tool"),
            np.zeros(3),
            world,
            world,
        )[: self.n]

    def CalcPosition(self, context):
        x = self.state.Eval(context)
        self.plant.SetPositionsAndVelocities(self.plant_context, x)
        tool = self.plant.GetBodyByName("tool")
        X_WT = self.plant.EvalBodyPoseInWorld(self.plant_context, tool)
        return X_WT.translation()[: self.n]

    def CalcVelocity(self, context):
        qdot = self.state.Eval(context)[self.plant.num_positions() :]
        return self.Jacobian(context) @ qdot

    def CalcTorque(self, context):
        force = self.control_force.Eval(context) - self.environment_force.Eval(context)
        return self.Jacobian(context).T @ force


class Environment(Block):
    """Layers along x; where the force jumps between two of them, that is located."""

    def __init__(self, layers, n: int):
        LeafSystem.__init__(self)
        self.layers = layers
        self.n = n
        self.Inputs(n, "position", "velocity")
        # The only jump of the thesis's tasks is at the end of the tissue.
        damped = [i for i, layer in enumerate(layers) if layer.damping > 0]
        self.border = layers[damped[-1] + 1].start if damped else None
        self.DeclareDiscreteState(1)  # 1: past the border
        motion = self.position.ticket(), self.velocity.ticket()
        self.Output("force", n, self.CalcForce, *motion, self.xd_ticket())
        self.crossing = self.MakeWitnessFunction(
            "crossing",
            WitnessFunctionDirection.kCrossesZero,
            lambda context: self.position.Eval(context)[0] - self.border,
            UnrestrictedUpdateEvent(self.Cross),
        )

    def DoGetWitnessFunctions(self, context):
        return [] if self.border is None else [self.crossing]

    def Cross(self, context, event, state):
        past = self.Mode(context)
        state.get_mutable_discrete_state(0).SetAtIndex(0, 1.0 - past)

    def CalcForce(self, context):
        x = self.position.Eval(context)[0]
        v = self.velocity.Eval(context)[0]
        past = self.Mode(context) > 0
        # No step straddles the border: its stages have the law of one side.
        side = [
            layer
            for layer in self.layers
            if self.border is None or (layer.start >= self.border) == past
        ]
        layer = [side[0], *(layer for layer in side[1:] if x >= layer.start)][-1]
        force = np.zeros(self.n)
        force[0] = layer.stiffness * (x - layer.reference) + layer.damping * v
        return force


def MakePlant(robot) -> MultibodyPlant:
    """Returns the plant of a robot, which begins where the scenario says."""
    plant = MultibodyPlant(time_step=0.0)
    Parser(plant).AddModels(str(MODELS / f"{robot.kind}.sdf"))
    plant.Finalize()
    q = np.array(robot.start)
    if plant.num_positions() == 2:
        q = appendix_a.joints(q, ELBOW[robot.elbow])
    plant.SetDefaultPositions(q)
    return plant


def MakeDevice(device, n: int) -> LinearSystem:
    """Returns the transfer function of the haptic device, on each of n axes."""
    (b1, b0) = device.numerator
    (_, a1, a0) = device.denominator
    A = np.kron(np.array([[0, 1], [-a0, -a1]]), np.eye(n))
    B = np.kron(np.array([[0], [1]]), np.eye(n))
    C = np.kron(np.array([[b0, b1]]), np.eye(n))
    return LinearSystem(A, B, C, np.zeros((n, n)))


def MakeOperator(scenario: Scenario) -> Operator:
    surgeon = scenario.surgeon
    force = surgeon.contact_force
    surface = None if force is None else Border(scenario, "contact")
    return Operator(surgeon.velocity, force, surface)


# The output that is connected to each input.
CONNECTIONS = {
    "task_space.state": "plant.state",
    "task_space.control_force": "controller.control_force",
    "task_space.environment_force": "environment.force",
    "plant.actuation": "task_space.torque",
    "environment.position": "task_space.position",
    "environment.velocity": "task_space.velocity",
    "controller.position": "task_space.position",
    "controller.velocity": "task_space.velocity",
    "controller.environment_force": "environment.force",
    "return_position": "task_space.position",
    "return_velocity": "task_space.velocity",
    "operator.felt_position": "return_position",
    "minus": "return_velocity",
    "error.u0": "operator.velocity_command",
    "error.u1": "minus",
    "device": "error",
    "operator.haptic_force": "device",
    "forward_force": "operator.force_command",
    "forward_velocity": "operator.velocity_command",
    "controller.haptic_force": "forward_force",
    "controller.velocity_command": "forward_velocity",
    "tool_position": "task_space.position",
    "tool_velocity": "task_space.velocity",
    "environment_force": "environment.force",
    "control_force": "controller.control_force",
}
LOGGED = ("tool_position", "tool_velocity", "environment_force", "control_force")


def MakeDiagram(scenario: Scenario, make_delay: Callable[[float, np.ndarray], System]):
    """Returns the Diagram and its loggers by signal."""
    n = scenario.num_axes
    T_f = scenario.forward_channel.delay
    T_r = scenario.return_channel.delay
    zero = np.zeros(n)
    plant = MakePlant(scenario.robot)
    loggers = {name: VectorLogSink(n) for name in LOGGED}
    systems = {
        "plant": plant,
        "task_space": TaskSpace(plant, n),
        "environment": Environment(scenario.environment.layers, n),
        "controller": AdaptiveBackstepping(scenario),
        "operator": MakeOperator(scenario),
        "device": MakeDevice(scenario.haptic_device, n),
        "error": Adder(2, n),
        "minus": Gain(-1.0, n),
        "forward_force": make_delay(T_f, zero),
        "forward_velocity": make_delay(T_f, zero),
        "return_position": make_delay(T_r, np.array(scenario.robot.start)),
        "return_velocity": make_delay(T_r, zero),
    }
    return Wired(systems | loggers, CONNECTIONS), loggers


@dataclass(frozen=True, kw_only=True)
class Solution:
    """Samples (N, k) at the ends of the solver's steps; None: it does not count."""

    time: np.ndarray
    signals: dict[str, np.ndarray]
    steps: int | None
    derivative_evaluations: int | None


def Run(scenario, make_delay, **config) -> Solution:
    diagram, loggers = MakeDiagram(scenario, make_delay)
    simulator = Simulator(diagram)
    if config:
        ApplySimulatorConfig(SimulatorConfig(**config), simulator)
    context = simulator.get_mutable_context()
    context.SetAccuracy(EVENT_ACCURACY)
    simulator.Initialize()
    simulator.AdvanceTo(scenario.duration)
    logs = {name: log.FindLog(context) for name, log in loggers.items()}
    integrator = simulator.get_integrator()
    return Solution(
        time=np.array(logs["tool_position"].sample_times()),
        signals={name: log.data().T.copy() for name, log in logs.items()},
        steps=integrator.get_num_steps_taken(),
        derivative_evaluations=integrator.get_num_derivative_evaluations(),
    )


# Drake locates events to a microsecond or better with this accuracy of the Context.
EVENT_ACCURACY = 1e-4

# By the number of axes: the loosest of the tried settings that keep the errors below
# 1e-5 of each signal's range on one axis and 1e-4 on two, as the table `comparison`
# shows.
SETTINGS = {
    1: {"accuracy": 1e-10, "max_step_size": 0.03},
    2: {"accuracy": 1e-8, "max_step_size": 0.03},
}


def simulate(scenario: Scenario) -> Solution:
    """Simulates with exact delays and the SETTINGS."""
    setting = SETTINGS[scenario.num_axes]
    channels = (scenario.forward_channel, scenario.return_channel)
    delays = [channel.delay for channel in channels if channel.delay > 0]
    step = min(setting["max_step_size"], *delays)
    return Run(
        scenario,
        lambda delay, initial: Delay(delay, initial, step),
        integration_scheme="runge_kutta5",
        accuracy=setting["accuracy"],
        max_step_size=step,
        use_error_control=True,
    )


def simulate_sampled(scenario: Scenario) -> Solution:
    """The same diagram with a DiscreteTimeDelay of 1 kHz for each signal.

    The Simulator is as Drake makes it. Before the first packet the blocks deliver 0,
    which nothing in the loop sees: the operator only waits for a position.
    """
    period = 0.001
    return Run(
        scenario,
        lambda delay, initial: DiscreteTimeDelay(
            period, round(delay / period), len(initial)
        ),
    )
