"""Tests of transport delays side by side: each is what it would be alone."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import (
    DiagramBuilder,
    DiscreteStateIndex,
    LeafSystem,
)
from pydrake.systems.primitives import Demultiplexer, Integrator, LogVectorOutput

from teleop_drake.channels.transport_delay import TransportDelay
from teleop_drake.channels.transport_delays import TransportDelays

DELAYS = [0.1, 0.23, 0.1, 0.057, 0.23]
INITIAL = [1.0, 2.0, 3.0, 4.0, 5.0]
# Which of the elements jump, and when.
JUMPS = {0.2: [0, 1], 0.301: [3], 0.52: [0, 2, 4]}


class Waves(LeafSystem):
    """Sine waves, and steps by unrestricted updates."""

    def __init__(self):
        super().__init__()
        n = len(DELAYS)
        self.DeclareDiscreteState(n)
        self.DeclareStateOutputPort("steps", DiscreteStateIndex(0))
        self.DeclareVectorOutputPort("y", n, self._Calc)
        for time, places in JUMPS.items():
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                1e12, time, lambda _, state, places=places: self._Step(state, places)
            )

    def _Calc(self, context, output):
        waves = np.sin(np.arange(3, 3 + len(DELAYS)) * context.get_time())
        output.SetFromVector(waves + context.get_discrete_state_vector().value())

    def _Step(self, state, places):
        steps = state.get_mutable_discrete_state(0)
        for i in places:
            steps.SetAtIndex(i, steps[i] + 1 + i)


def test_each_element_is_delayed_as_alone():
    builder = DiagramBuilder()
    waves = builder.AddNamedSystem("waves", Waves())
    dut = builder.AddNamedSystem(
        "dut", TransportDelays(delays=DELAYS, initial_value=INITIAL)
    )
    split = builder.AddNamedSystem("split", Demultiplexer(len(DELAYS)))
    drift = builder.AddNamedSystem("drift", Integrator(len(DELAYS)))
    builder.Connect(waves.GetOutputPort("y"), dut.GetInputPort("signal"))
    builder.Connect(waves.GetOutputPort("y"), split.get_input_port())
    builder.Connect(dut.get_output_port(), drift.get_input_port())
    loggers = [LogVectorOutput(dut.get_output_port(), builder)]
    alone = []
    for i, (delay, value) in enumerate(zip(DELAYS, INITIAL, strict=True)):
        line = TransportDelay(
            delay=delay, size=1, initial_value=[value], max_sample_interval=math.inf
        )
        alone.append(builder.AddNamedSystem(f"line_{i}", line))
        builder.Connect(split.get_output_port(i), line.get_input_port())
        loggers.append(LogVectorOutput(line.get_output_port(), builder))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5",
            max_step_size=0.013,
            accuracy=1e-6,
            use_error_control=True,
        ),
        simulator,
    )
    simulator.Initialize()
    next_jumps = []
    for time in np.arange(0.05, 1.01, 0.05):
        simulator.AdvanceTo(time)
        context = simulator.get_context()
        next_jumps.append(dut.NextJumpTime(dut.GetMyContextFromRoot(context)))
        assert next_jumps[-1] == min(
            line.NextJumpTime(line.GetMyContextFromRoot(context)) for line in alone
        )
    # The first samples arrive, and so do the steps.
    for expected in (0.1, 0.23, 0.3, 0.43, 0.62, 0.75):
        assert min(abs(x - expected) for x in next_jumps) < 1e-12
    together, *apart = (logger.FindLog(context).data() for logger in loggers)
    # Elements with one delay have their stencils end at each other's jumps.
    np.testing.assert_allclose(together, np.vstack(apart), rtol=0, atol=1e-9)
    assert np.ptp(together, axis=1).min() > 2


def test_neither_the_first_sample_nor_the_initial_value_are_lost():
    dut = TransportDelays(delays=[0.1, 0.2], initial_value=[7.0, 8.0])
    context = dut.CreateDefaultContext()
    assert dut.get_output_port().Eval(context).tolist() == [7.0, 8.0]
    assert dut.NextJumpTime(context) == 0.1


@pytest.mark.parametrize(
    ("delays", "initial_value", "message"),
    [
        ([0.1, 0.0], [0, 0], "delays: 0; allowed"),
        ([0.1, -1.0], [0, 0], "delay: -1.0; allowed"),
        ([math.inf], [0], "delay: inf; allowed"),
        ([0.1], [0, 0], "initial_value: 2 elements; allowed: 1"),
        ([], [], "delays: .*at least one"),
    ],
)
def test_bad_parameters(delays, initial_value, message):
    with pytest.raises(ValueError, match=message):
        TransportDelays(delays=delays, initial_value=initial_value)
