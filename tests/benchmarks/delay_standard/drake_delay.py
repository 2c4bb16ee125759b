"""Drake's DiscreteTimeDelay: samples, each held until the next one."""

import numpy as np
from benchmarks.delay_standard.simulator import Input, Simulator
from pydrake.systems.analysis import ApplySimulatorConfig, SimulatorConfig
from pydrake.systems.analysis import Simulator as DrakeSimulator
from pydrake.systems.framework import (
    DiagramBuilder,
    LeafSystem,
    UnrestrictedUpdateEvent,
    WitnessFunctionDirection,
)
from pydrake.systems.primitives import (
    AffineSystem,
    DiscreteTimeDelay,
    LinearSystem,
)


class Source(LeafSystem):
    """A signal of time."""

    def __init__(self, signal: Input):
        super().__init__()
        self.DeclareVectorOutputPort(
            "y",
            signal.size,
            lambda context, output: output.SetFromVector(signal(context.get_time())),
            prerequisites_of_calc={self.time_ticket()},
        )


class Ball(LeafSystem):
    """x'' = -9.81 - 0.5 u; at x = 0 the velocity v becomes -0.8 v."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("u", 1)
        state = self.DeclareContinuousState(1, 1, 0)
        self.DeclareStateOutputPort("state", state)
        self.DeclareVectorOutputPort(
            "velocity",
            1,
            lambda context, output: output.set_value([self._state(context)[1]]),
            prerequisites_of_calc={self.xc_ticket()},
        )
        self._hit = self.MakeWitnessFunction(
            "hit",
            WitnessFunctionDirection.kPositiveThenNonPositive,
            lambda context: self._state(context)[0],
            UnrestrictedUpdateEvent(self._Bounce),
        )

    @staticmethod
    def _state(context):
        return context.get_continuous_state_vector().CopyToVector()

    def DoGetWitnessFunctions(self, context):
        return [self._hit]

    def DoCalcTimeDerivatives(self, context, derivatives):
        (u,) = self.get_input_port().Eval(context)
        derivatives.SetFromVector([self._state(context)[1], -9.81 - 0.5 * u])

    def _Bounce(self, context, event, state):
        v = self._state(context)[1]
        state.get_mutable_continuous_state().SetFromVector([0.0, -0.8 * v])


def values_at(port, simulator, diagram, times):
    """Returns what a port has at times, after the events there."""
    system = port.get_system()
    rows = []
    for t in times:
        # As Drake counts ticks: 0.29 is not 29 times 0.01.
        simulator.AdvanceTo(round(t / 0.01) * 0.01)
        simulator.AdvancePendingEvents()
        context = system.GetMyContextFromRoot(simulator.get_context())
        rows.append(port.Eval(context).copy())
    return np.array(rows)


class DiscreteDelay(Simulator):
    name = "Drake, DiscreteTimeDelay"
    pd_step = 1e-3

    def echo(self, signal: Input, path, times):
        """The period is the longest that divides the delay and 0.01 s."""
        builder = DiagramBuilder()
        port = builder.AddNamedSystem("source", Source(signal)).get_output_port()
        for i, T in enumerate(path):
            period = next(h for h in (0.01, 0.005, 0.002) if _divides(h, T))
            late = DiscreteTimeDelay(period, round(T / period), signal.size)
            builder.AddNamedSystem(f"delay_{i}", late)
            builder.Connect(port, late.get_input_port())
            port = late.get_output_port()
        diagram = builder.Build()
        simulator = DrakeSimulator(diagram)
        return values_at(port, simulator, diagram, times)

    def _loop(self, plant, law, sensor, actuator, start, history, times):
        step = self.pd_step if times[-1] > 30 else 1e-4
        builder = DiagramBuilder()
        builder.AddNamedSystem("plant", plant)
        builder.AddNamedSystem("law", law)
        delays = {}
        for name, T, source, target in (
            ("sensor", sensor, plant, law),
            ("actuator", actuator, law, plant),
        ):
            port = source.get_output_port()
            if T > 0:
                late = DiscreteTimeDelay(step, round(T / step), port.size())
                delays[name] = builder.AddNamedSystem(name, late)
                builder.Connect(port, late.get_input_port())
                port = late.get_output_port()
            builder.Connect(port, target.get_input_port())
        diagram = builder.Build()
        simulator = DrakeSimulator(diagram)
        config = SimulatorConfig(
            integration_scheme="runge_kutta3", max_step_size=step, accuracy=1e-8
        )
        ApplySimulatorConfig(config, simulator)
        context = simulator.get_mutable_context()
        context.SetContinuousState(start)
        if "sensor" in delays:
            own = delays["sensor"].GetMyMutableContextFromRoot(context)
            size = own.get_discrete_state_vector().size()
            own.SetDiscreteState(np.tile(history, size // len(history)))
        return values_at(plant.get_output_port(), simulator, diagram, times)[:, 0]

    def bounce(self, times):
        """A sample each 0.1 ms; the second delay samples the first one a step late."""
        step = 1e-4
        builder = DiagramBuilder()
        ball = builder.AddNamedSystem("ball", Ball())
        port = ball.GetOutputPort("velocity")
        ways = []
        for name in ("to_hand", "to_ball"):
            late = DiscreteTimeDelay(step, round(0.15 / step), 1)
            builder.AddNamedSystem(name, late)
            builder.Connect(port, late.get_input_port())
            port = late.get_output_port()
            ways.append(port)
        builder.Connect(port, ball.get_input_port())
        simulator = DrakeSimulator(builder.Build())
        context = simulator.get_mutable_context()
        context.SetAccuracy(1e-8)
        context.SetContinuousState([1.0, 0.0])
        simulator.get_mutable_integrator().set_maximum_step_size(step)
        rows = []
        for t in times:
            simulator.AdvanceTo(round(t / 0.01) * 0.01)
            simulator.AdvancePendingEvents()
            root = simulator.get_context()
            felt = ways[0].Eval(ways[0].get_system().GetMyContextFromRoot(root))
            state = ball.GetMyContextFromRoot(root).get_continuous_state_vector()
            rows.append([*state.CopyToVector(), *felt])
        return np.array(rows)

    def scalar_loop(self, k, T, times):
        plant = LinearSystem([[0.0]], [[1.0]], [[1.0]], [[0.0]])
        law = LinearSystem(D=[[-k]])
        return self._loop(plant, law, T, 0.0, [1.0], [1.0], times)

    def pd(self, sensor, actuator, times):
        plant = LinearSystem([[0, 1], [0, 0]], [[0], [1]], np.eye(2), np.zeros((2, 1)))
        law = AffineSystem(D=[[-4.0, -2.0]], y0=[4.0])
        return self._loop(plant, law, sensor, actuator, [0, 0], [0.0, 0.0], times)


def _divides(period: float, T: float) -> bool:
    return abs(T / period - round(T / period)) < 1e-9
