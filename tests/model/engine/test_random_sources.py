"""Random sources of Drake in compiled runs: the draws of Drake's own runs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import (
    FirstOrderLowPassFilter,
    RandomSource,
    ZeroOrderHold,
)
from wired import InSeries, Wired

from teleop_drake import Compile, SampledSensor, simulate
from teleop_drake.loops import TransportDelay
from teleop_drake.loops.kernel import Kernel, KernelBlock

TIMES = np.linspace(0.0005, 0.9995, 300)


def noisy():
    """Two sources of different periods; the first is delayed and filtered."""
    parts = {
        "noise": RandomSource(RandomDistribution.kGaussian, 1, 0.03),
        "delay": TransportDelay(0.05, 1),
        "filter": FirstOrderLowPassFilter(0.1, 1),
        "pair": RandomSource(RandomDistribution.kUniform, 2, 0.25),
    }
    shown = {name: name for name in parts}
    return Wired(parts, InSeries("noise", "delay", "filter"), shown)


def begin(diagram, seed):
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    return context


def check_equal(one, other, times):
    for name in other:
        assert_allclose(
            one.Interpolate(name, times), other.Interpolate(name, times), atol=1e-9
        )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_compiled_run_has_the_draws_of_drake(seed):
    diagram = noisy()
    context = begin(diagram, seed)
    compiled = simulate(diagram, context=context, duration=1.0)
    drake = simulate(diagram, context=context, duration=1.0, engine="drake")
    assert (compiled.solver.engine, compiled.notes) == ("compiled", [])
    check_equal(compiled, drake, TIMES)
    assert np.unique(compiled["noise"]).size == 35  # At first, and at 0, 0.03 ... 0.99.


def test_other_seeds_have_other_draws_and_runs_of_one_program_the_same():
    diagram = noisy()
    first, second = (
        Compile(diagram, context=begin(diagram, seed), duration=0.5) for seed in (1, 2)
    )
    check_equal(first.Run(), first.Run(), TIMES / 2)
    assert np.abs(first.Run()["noise"][-1] - second.Run()["noise"][-1]) > 1e-3


@pytest.mark.mostly_slow
@pytest.mark.parametrize("split", [0.42, 0.45, 0.5])
@pytest.mark.parametrize("latter", ["compiled", "drake"])
def test_the_draws_go_on_where_a_run_has_ended(split, latter):
    """A draw is due at 0.45 s, and one of the pair at 0.5 s."""
    diagram = noisy()
    context = begin(diagram, 3)
    whole = simulate(diagram, context=context, duration=1.0)
    half = simulate(diagram, context=context, duration=split)
    second = simulate(
        diagram,
        context=half.final_context,
        duration=1.0 - split,
        engine=latter,
        suppress_initialization_events=True,
    )
    check_equal(second, whole, TIMES[split + 1e-3 < TIMES])


def held(period, hold_period):
    """A source, the hold and the sensor that read it, and a filter of the hold."""
    parts = {
        "noise": RandomSource(RandomDistribution.kGaussian, 1, period),
        "hold": ZeroOrderHold(hold_period, 1),
        "sensor": SampledSensor(hold_period, [0.0]),
        "filter": FirstOrderLowPassFilter(0.1, 1),
    }
    connections = {"hold": "noise", "sensor": "noise", "filter": "hold"}
    shown = {name: name for name in parts} | {"sensor": "sensor.sample"}
    return Wired(parts, connections, shown)


PERIODS = [(0.1, 0.1), (0.04, 0.05), (0.05, 0.1), (0.1, 0.05)]


def in_plain_simulator(diagram, context, times):
    """Returns the signals at times between ticks, in Drake's own Simulator."""
    simulator = Simulator(diagram, context.Clone())
    simulator.get_mutable_context().SetAccuracy(1e-4)
    simulator.get_mutable_integrator().set_maximum_step_size(1e-3)
    rows = {name: [] for name in ("noise", "hold", "sensor", "filter")}
    for time in times:
        simulator.AdvanceTo(time)
        for name, values in rows.items():
            port = diagram.GetOutputPort(name)
            values.append(port.Eval(simulator.get_context()).copy())
    return {name: np.array(values) for name, values in rows.items()}


@pytest.mark.parametrize(("period", "hold_period"), PERIODS)
def test_what_samples_a_draw_at_its_instant_reads_what_drake_does(period, hold_period):
    """A hold reads the draw of the instant, also at the start; a sensor the one before.

    Drake executes a draw and a sensor's sample together, and a hold after them.
    """
    diagram = held(period, hold_period)
    context = begin(diagram, 1)
    times = np.arange(0.003, 0.4, 0.01)
    drake = in_plain_simulator(diagram, context, times)
    for engine in ("compiled", "drake"):
        run = simulate(diagram, context=context, duration=0.4, engine=engine)
        assert run.solver.engine == engine
        for name, values in drake.items():
            found = run.Interpolate(name, times)
            assert_allclose(found, values, atol=1e-6, err_msg=name)
    # The first sample, by its definition.
    first = drake["noise"][0]
    before = diagram.GetOutputPort("noise").Eval(context)
    assert_array_equal(drake["hold"][0], first)
    assert_array_equal(drake["sensor"][0], before)


@pytest.mark.parametrize(("period", "hold_period"), PERIODS)
@pytest.mark.parametrize("latter", ["compiled", "drake"])
def test_two_halves_of_a_held_draw_are_the_whole(period, hold_period, latter):
    """Both the source and the hold are due where the first half ends, at 0.2 s."""
    diagram = held(period, hold_period)
    context = begin(diagram, 1)
    times = np.arange(0.203, 0.4, 0.01)
    drake = in_plain_simulator(diagram, context, times)
    half = simulate(diagram, context=context, duration=0.2)
    rest = {"duration": 0.2, "engine": latter}
    second = simulate(
        diagram,
        context=half.final_context,
        suppress_initialization_events=True,
        **rest,
    )
    for name, values in drake.items():
        found = second.Interpolate(name, times)
        assert_allclose(found, values, atol=1e-6, err_msg=name)


def squared(noise):
    return noise * noise


class Squared(KernelBlock):
    """A user's own block, whose kernel is compared with Drake in the first run."""

    def __init__(self):
        KernelBlock.__init__(self)
        self.DeclareVectorInputPort("noise", 1)
        self.DeclareOutputs(squared=1)

    def Kernel(self):
        return Kernel(outputs={"squared": (squared, "noise")})


def test_each_run_of_a_users_own_block_has_the_draws_from_the_start():
    noise = RandomSource(RandomDistribution.kGaussian, 1, 0.1)
    diagram = Wired({"noise": noise, "own": Squared()}, {"own": "noise"})
    context = begin(diagram, 5)
    program = Compile(diagram, context=context, duration=1.0)
    drake = simulate(diagram, context=context, duration=1.0, engine="drake")
    check_equal(program.Run(), drake, TIMES)
    check_equal(program.Run(), drake, TIMES)
