"""The time at which a run begins: that of its Context, or the solver's start_time."""

import numpy as np
import pytest
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.primitives import Sine

from teleop_drake.loops import Compile, ScenarioError, simulate

ENGINES = ["drake", "compiled"]


def config(start_time):
    return SimulatorConfig(
        integration_scheme="runge_kutta5",
        max_step_size=0.1,
        start_time=start_time,
        use_error_control=True,
    )


def check(recording, start):
    """Checks a run of sin(t) over 1 s."""
    assert recording.time[[0, -1]] == pytest.approx([start, start + 1.0], abs=1e-12)
    np.testing.assert_allclose(recording["y0"][:, 0], np.sin(recording.time), atol=1e-9)


@pytest.mark.parametrize("start", [2.0, -0.5])
@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_without_a_context_begins_at_the_start_time(engine, start):
    run = simulate(
        Sine(1.0, 1.0, 0.0, 1), duration=1.0, simulator=config(start), engine=engine
    )
    check(run, start)
    assert run.notes == []
    program = Compile(Sine(1.0, 1.0, 0.0, 1), duration=1.0, simulator=config(start))
    check(program.Run(), start)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_context_has_a_time_of_its_own_and_a_note_says_so(engine):
    system = Sine(1.0, 1.0, 0.0, 1)
    context = system.CreateDefaultContext()
    context.SetTime(3.0)
    run = simulate(
        system, context=context, duration=1.0, simulator=config(2.0), engine=engine
    )
    check(run, 3.0)
    assert run.notes == [
        "simulator.start_time = 2 has no effect: the run begins at the time of its "
        "Context, 3 s."
    ]
    # A run that goes on has the same solver.
    context.SetTime(2.0)
    first = simulate(system, context=context, duration=1.0, simulator=config(2.0))
    assert first.notes == []


def test_a_start_time_is_a_number():
    with pytest.raises(ScenarioError, match=r"^simulator.start_time = inf: must be a "):
        simulate(Sine(1.0, 1.0, 0.0, 1), duration=1.0, simulator=config(np.inf))
