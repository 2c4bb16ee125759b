"""The source of a trajectory, against Drake's own and closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems import primitives as drake
from pydrake.systems.analysis import Simulator
from pydrake.trajectories import PiecewisePolynomial, PiecewiseQuaternionSlerp
from wired import Wired

from teleop_drake.loops import TrajectorySource, TransportDelay, simulate
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.framework.validation import ScenarioError

BREAKS = [0.2, 0.5, 0.501, 1.3]
STEPS = PiecewisePolynomial.ZeroOrderHold(BREAKS, [[0.0, 1.0, -2.0, 3.0]])
NODES = np.random.default_rng(1).normal(size=(2, 40))
EVEN = PiecewisePolynomial.CubicShapePreserving(np.linspace(0.1, 1.3, 40), NODES)
CUBIC = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(BREAKS, NODES[:, :4])
CONSTANT = PiecewisePolynomial(np.array([[1.0], [2.0]]))


@pytest.mark.parametrize("engine", ["drake", "compiled"])
@pytest.mark.parametrize("start", [0.0, 0.75])
@pytest.mark.parametrize(
    ("trajectory", "order"), [(STEPS, 0), (EVEN, 1), (CUBIC, 2), (CONSTANT, 1)]
)
def test_it_is_drakes_source(trajectory, order, start, engine):
    """Also before the first break, after the last one, and from a start between."""
    source = TrajectorySource(trajectory, order)
    diagram = Wired(
        {"source": source, "way": drake.Integrator(source.get_output_port().size())},
        {"way": "source"},
    )
    context = diagram.CreateDefaultContext()
    context.SetTime(start)
    recording = simulate(diagram, context=context, duration=1.5 - start, engine=engine)
    assert recording.solver.engine == engine
    theirs = drake.TrajectorySource(trajectory, order)
    own = theirs.CreateDefaultContext()
    for time in start + np.random.default_rng(2).uniform(0, 1.5 - start, 20):
        own.SetTime(time)
        expected = theirs.get_output_port().Eval(own)
        found = recording.Interpolate("source.y0", [time])[0]
        assert_allclose(found, expected, rtol=1e-9, atol=1e-8)
    # The integral of the steps has a closed form; the last value is held.
    if trajectory is STEPS and start == 0.0:
        total = (0.501 - 0.5) * 1.0 + (1.5 - 0.501) * -2.0
        assert recording["way.y0"][-1, 0] == pytest.approx(total, abs=1e-10)


@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_a_pulse_comes_out_of_a_delay_as_it_went_in(engine):
    """A pulse of 1 ms, of which no sample between steps need know."""
    diagram = Wired(
        {"source": TrajectorySource(STEPS), "delay": TransportDelay(delay=0.3, size=1)},
        {"delay": "source"},
    )
    recording = simulate(diagram, duration=1.0, engine=engine)
    late = recording.Interpolate("delay.delayed_signal", [0.79999, 0.80001, 0.80099])
    assert late[:, 0] == pytest.approx([0.0, 1.0, 1.0], abs=1e-12)


def test_a_plain_simulator_has_the_piece_of_each_time():
    source = TrajectorySource(EVEN, 1)
    simulator = Simulator(source)
    simulator.AdvanceTo(0.77)
    found = source.get_output_port().Eval(simulator.get_context())
    expected = np.vstack([EVEN.value(0.77), EVEN.EvalDerivative(0.77)])
    assert found == pytest.approx(expected.ravel(), rel=1e-9)


def test_drakes_source_runs_in_drake_with_a_note_that_names_this_one():
    source = drake.TrajectorySource(STEPS)
    with pytest.raises(UnsupportedSystem, match=r"teleop_drake\.TrajectorySource"):
        Evaluator(source, source.CreateDefaultContext())
    notes = simulate(source, duration=0.1).notes
    assert any("teleop_drake.TrajectorySource" in note for note in notes)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((PiecewiseQuaternionSlerp(),), "PiecewisePolynomial"),
        ((PiecewisePolynomial(),), "column"),
        ((PiecewisePolynomial(np.eye(2)),), "column"),
        ((STEPS, -1), "output_derivative_order"),
        ((PiecewisePolynomial.FirstOrderHold([-1.0, 1], [[0.0, 1]]),), "from -1 s"),
    ],
)
def test_what_is_refused(arguments, word):
    with pytest.raises(ScenarioError, match=word):
        TrajectorySource(*arguments)
