"""Random sources of Drake in compiled runs: the draws of Drake's own runs."""

import numpy as np
import pytest
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import FirstOrderLowPassFilter, RandomSource

from teleop_drake import Compile, TransportDelay, simulate
from teleop_drake.kernel import Kernel, KernelBlock

TIMES = np.linspace(0.0005, 0.9995, 300)


def noisy():
    """Two sources of different periods; the first is delayed and filtered."""
    builder = DiagramBuilder()
    parts = [
        RandomSource(RandomDistribution.kGaussian, 1, 0.03),
        TransportDelay(0.05, 1),
        FirstOrderLowPassFilter(0.1, 1),
    ]
    for name, part in zip(("noise", "delay", "filter"), parts, strict=True):
        builder.AddNamedSystem(name, part)
    builder.Connect(parts[0].get_output_port(), parts[1].get_input_port())
    builder.Connect(parts[1].get_output_port(), parts[2].get_input_port())
    pair = RandomSource(RandomDistribution.kUniform, 2, 0.25)
    builder.AddNamedSystem("pair", pair)
    for part in (*parts, pair):
        builder.ExportOutput(part.get_output_port(), part.get_name())
    return builder.Build()


def begin(diagram, seed):
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    return context


def check_equal(one, other, times):
    for name in other:
        np.testing.assert_allclose(
            one.Interpolate(name, times), other.Interpolate(name, times), atol=1e-9
        )


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
    builder = DiagramBuilder()
    noise = RandomSource(RandomDistribution.kGaussian, 1, 0.1)
    builder.AddNamedSystem("noise", noise)
    own = builder.AddNamedSystem("own", Squared())
    builder.Connect(noise.get_output_port(), own.get_input_port())
    diagram = builder.Build()
    context = begin(diagram, 5)
    program = Compile(diagram, context=context, duration=1.0)
    drake = simulate(diagram, context=context, duration=1.0, engine="drake")
    check_equal(program.Run(), drake, TIMES)
    check_equal(program.Run(), drake, TIMES)
