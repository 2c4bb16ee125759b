"""Rows of random Diagrams in Drake's engine, against stops of Drake's Simulator."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import Value
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    FirstOrderLowPassFilter,
    Gain,
    Integrator,
    LinearSystem,
    Saturation,
    Sine,
    ZeroOrderHold,
)

from teleop_drake.loops import simulate
from teleop_drake.loops.framework.signals import SignalsOf

DURATION = 1.3
PERIOD = 0.0173
TIMES = np.arange(0.0117, DURATION, PERIOD)

# The largest error of a signal as a share of its range, without a note.
TOLERANCE = 1e-4


class Hold(LeafSystem):
    """A hold in Python, whose output may depend on everything as far as Drake knows."""

    def __init__(self, period):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("u", 1)
        state = self.DeclareDiscreteState([0.3])
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self.Update)
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput, self.Prerequisites(state))

    def Prerequisites(self, state):
        return {self.all_sources_ticket()}

    def Update(self, context, state):
        state.set_value(0, self.get_input_port().Eval(context))

    def CalcOutput(self, context, output):
        output.SetFromVector(context.get_discrete_state_vector().value())


class DeclaredHold(Hold):
    """One that declares what its output depends on."""

    def Prerequisites(self, state):
        return {self.discrete_state_ticket(state)}


class HiddenHold(LeafSystem):
    """A hold that stores its sample in an abstract state."""

    def __init__(self, period):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("u", 1)
        self.DeclareAbstractState(Value[object](0.3))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self.Store)
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput)

    def Store(self, context, state):
        value = self.get_input_port().Eval(context)[0]
        state.get_mutable_abstract_state(0).set_value(value)

    def CalcOutput(self, context, output):
        output.SetFromVector([context.get_abstract_state(0).get_value()])


class Mixed(LeafSystem):
    """sin(u0) u1 and a function of time."""

    def __init__(self):
        LeafSystem.__init__(self)
        for i in (0, 1):
            self.DeclareVectorInputPort(f"u{i}", 1)
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput)

    def CalcOutput(self, context, output):
        a, b = (self.get_input_port(i).Eval(context)[0] for i in (0, 1))
        output.SetFromVector([np.sin(a) * b + 0.1 * np.cos(3 * context.get_time())])


# What is added, from random numbers and a random period.
DISCRETE = (
    lambda rng, period: ZeroOrderHold(period, 1),
    lambda rng, period: Hold(period),
    lambda rng, period: DeclaredHold(period),
    lambda rng, period: HiddenHold(period),
    lambda rng, period: LinearSystem(
        [[0.5]], [[0.5]], [[1.0]], [[float(rng.choice([0.0, 1.0]))]], period
    ),
    lambda rng, period: Gain(rng.uniform(-2, 2), 1),
    lambda rng, period: Adder(2, 1),
    lambda rng, period: Saturation([-0.4], [0.4]),
    lambda rng, period: Mixed(),
)
CONTINUOUS = (
    lambda rng, period: Integrator([rng.uniform(-1, 1)]),
    lambda rng, period: FirstOrderLowPassFilter(rng.uniform(0.1, 1), 1),
)
SOURCES = (
    lambda rng: Sine(1.0, rng.uniform(0.5, 5), 0.0, 1),
    lambda rng: ConstantVectorSource([rng.uniform(-1, 1)]),
)


def random_diagram(seed):
    """Returns a Diagram without loops; a third of them has no continuous states."""
    rng = np.random.default_rng(seed)
    makers = DISCRETE if rng.random() < 1 / 3 else DISCRETE + CONTINUOUS
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", SOURCES[rng.integers(2)](rng))
    outputs = [source.get_output_port(0)]
    for i in range(rng.integers(3, 8)):
        period = float(rng.choice([0.03, 0.05, 0.1]))
        block = makers[rng.integers(len(makers))](rng, period)
        builder.AddNamedSystem(f"{type(block).__name__}_{i}", block)
        for k in range(block.num_input_ports()):
            output = outputs[rng.integers(len(outputs))]
            builder.Connect(output, block.get_input_port(k))
        outputs.append(block.get_output_port(0))
    return builder.Build()


def in_drake(diagram):
    """Returns all signals at TIMES, where Drake's Simulator is stopped."""
    simulator = Simulator(diagram)
    config = SimulatorConfig(accuracy=1e-9, max_step_size=0.01)
    ApplySimulatorConfig(config, simulator)
    root = simulator.get_context()
    ports = SignalsOf(diagram)
    values = {name: [] for name in ports}
    for time in TIMES:
        simulator.AdvanceTo(time)
        for name, port in ports.items():
            own = port.get_system().GetMyContextFromRoot(root)
            values[name].append(port.Eval(own))
    return {name: np.array(x) for name, x in values.items()}


@given(seed=st.integers(0, 2**32 - 1))
def test_signals_between_rows_are_those_of_drake_or_named(seed):
    diagram = random_diagram(seed)
    config = SimulatorConfig(accuracy=1e-7, max_step_size=0.02)
    options = {"duration": DURATION, "engine": "drake", "simulator": config}
    recording = simulate(diagram, **options)
    few = simulate(diagram, publish_period=PERIOD, **options)
    notes = [note for note in recording.notes if "jumps or bends" in note]
    for name, expected in in_drake(diagram).items():
        if any(name in note for note in notes):
            continue
        allowed = TOLERANCE * max(np.ptp(expected), 1e-3)
        found = recording.Interpolate(name, TIMES)
        assert np.abs(found - expected).max() < allowed, name
        inside = recording.Interpolate(name, few.time[1:-1])
        assert np.abs(few[name][1:-1] - inside).max() < allowed, name
