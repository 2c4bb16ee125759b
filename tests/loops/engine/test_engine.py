"""Compiled runs against closed forms and against Drake's Simulator."""

import math

import numpy as np
import pytest
from engines import Compiled, InDrake
from numpy.testing import assert_allclose
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Gain,
    Integrator,
    LinearSystem,
    ZeroOrderHold,
)
from wired import Wired

from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.engine import run as compiled_runs
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.kernel import Delay, Kernel, KernelBlock, Transition

# What one of them compiles, the others find on the disk.
pytestmark = pytest.mark.xdist_group("machine_code")


def nothing(context, output):
    """What Drake would call."""


class Line(LeafSystem):
    """A delay that only a compiled run can have."""

    def __init__(self, time, initial_value):
        LeafSystem.__init__(self)
        self._delay = Delay(
            signal="u", output="y", time=time, initial_value=[initial_value]
        )
        self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("y", 1, nothing, {self.time_ticket()})

    def Kernel(self):
        return Kernel(delays=[self._delay])


def delayed_decay(delay):
    """dx/dt = -x(t - delay), x = 1 up to t = 0."""
    return Wired(
        {"x": Integrator([1.0]), "line": Line(delay, 1.0), "gain": Gain(-1.0, 1)},
        {"line": "x", "gain": "line", "x": "gain"},
    )


class Sampler(KernelBlock):
    """Samples as all blocks of the package do, before what happens at an instant."""

    def __init__(self, period):
        KernelBlock.__init__(self)
        self._period = period
        self.DeclareVectorInputPort("u", 1)
        self.DeclareDiscreteState([0.0])
        self.DeclareOutputs(y=1)

    def Kernel(self):
        samples = Transition(mode="u", period=self._period)
        return Kernel(outputs={"y": "mode"}, transitions={"samples": samples})


@pytest.mark.parametrize(
    "delay",
    [
        lambda: TransportDelay(delay=0.1, size=1),
        lambda: SampledDelay(delay=0.1, sample_period=0.05, size=1),
    ],
)
def test_a_sample_at_the_instant_of_a_jump_is_that_of_drake(delay):
    """Drake's hold samples after the jump that arrives, the package's own before it."""
    times = np.array([0.07, 0.12])
    values = {}
    for make in (lambda: Sampler(0.05), lambda: ZeroOrderHold(0.05, 1)):
        for engine in (InDrake, Compiled):
            diagram = Wired(
                {
                    "source": ConstantVectorSource([1.0]),
                    "line": delay(),
                    "hold": make(),
                },
                {"line": "source", "hold": "line"},
                {"y": "hold"},
            )
            values[make, engine] = engine(diagram, SimulatorConfig(), times)
    shown = [x["y"][-1, 0] for x in values.values()]
    assert shown == [0.0, 0.0, 1.0, 1.0]


def run(diagram, end, *, accuracy=1e-9, max_step=0.1, every=math.inf):
    """Runs to an end, and stops on the way as often as one likes."""
    context = diagram.CreateDefaultContext()
    engine = CompiledRun(
        Evaluator(diagram, context, as_machine_code=True),
        context,
        end=end,
        accuracy=accuracy,
        max_step=max_step,
    )
    while engine.time < end and not engine.failure:
        engine.Advance(min(end, (round(engine.time / every) + 1) * every))
    assert not engine.failure
    return engine, *engine.Rows()


# The last one stops where the jumps arrive.
@pytest.mark.parametrize(
    ("delay", "every"), [(1.0, 7.0), (0.3, math.inf), (0.11, 0.07), (0.25, 0.25)]
)
def test_the_method_of_steps(delay, every):
    engine, times, rows = run(delayed_decay(delay), 4.0, every=every)
    signal = engine.evaluator.program.signals
    x = rows[:, signal[next(s for s in signal if s.block == 0)].start]
    k = np.arange(math.floor(4.0 / delay) + 2)
    for t, value in zip(times[::7], x[::7], strict=True):
        # The sum of the method of steps, exact.
        terms = np.where(t > (k - 1) * delay, t - (k - 1) * delay, 0.0) ** k
        factorials = np.array([math.gamma(i + 1) for i in k])
        exact = np.sum((-1.0) ** k * terms / factorials)
        assert value == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("delay", [0.3, 0.05])
def test_samples_need_few_rows(monkeypatch, delay):
    """What no delay reaches is forgotten: a loop over a network runs for hours."""
    monkeypatch.setattr(compiled_runs, "_MOST_KEPT", 40)
    diagram = delayed_decay(delay)
    context = diagram.CreateDefaultContext()
    engine = CompiledRun(
        Evaluator(diagram, context), context, end=4.0, accuracy=1e-9, max_step=0.1
    )
    instants = np.arange(1, 161) / 40
    num_rows = []
    samples = []
    for time in instants:
        samples.append(engine.Sample(time)[0])
        num_rows.append(len(engine.Rows()[0]))
    assert max(num_rows) < 150
    _, times, rows = run(diagram, 4.0, every=1 / 40)
    nearest = [np.abs(times - time).argmin() for time in instants]
    assert_allclose(samples, rows[nearest, 0], atol=1e-8)


class Switch(LeafSystem):
    """A thermostat: heats below 1, until x exceeds 2."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("x", 1)
        self.DeclareDiscreteState([1.0])
        self.DeclareVectorOutputPort("y", 1, nothing, {self.time_ticket()})

    def Kernel(self):
        return Kernel(
            outputs={"y": (heat, "mode")},
            transitions={
                "off": Transition(guard=(above, "mode", "x"), mode=(other, "mode")),
                "on": Transition(guard=(below, "mode", "x"), mode=(other, "mode")),
            },
        )


def heat(mode):
    return 6.0 * mode


def above(mode, x):
    return x - 2.0 if mode[0] == 1 else x * 0 - 1.0


def below(mode, x):
    return 1.0 - x if mode[0] == 0 else x * 0 - 1.0


def other(mode):
    return 1 - mode


def test_transitions_are_located():
    diagram = Wired(
        {"x": LinearSystem([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), "switch": Switch()},
        {"switch": "x", "x": "switch"},
    )
    _, times, _ = run(diagram, 2.0)
    jumps = times[:-1][np.diff(times) == 0]
    # From 0 to 2 towards 6, from 2 to 1 towards 0, from 1 to 2 towards 6, ...
    rise = math.log(6 / 4)
    fall = math.log(2)
    again = math.log(5 / 4)
    expected = np.cumsum([rise, fall, again, fall, again])
    assert_allclose(jumps[1:], expected[expected < 2], atol=1e-9)


@pytest.mark.parametrize("every", [math.inf, 0.1, 0.03])
def test_a_sampled_loop_is_its_difference_equation(every):
    """dx/dt = -2 x_k, sampled every 0.1 s: x_{k+1} = 0.8 x_k."""
    diagram = Wired(
        {"x": Integrator([1.0]), "hold": Sampler(0.1), "gain": Gain(-2.0, 1)},
        {"hold": "x", "gain": "hold", "x": "gain"},
    )
    _, times, rows = run(diagram, 1.05, max_step=1.0, every=every)
    k = int(np.flatnonzero(np.isclose(times, 1.0))[0])
    assert rows[k, 0] == pytest.approx(0.8**10, abs=1e-12)
