"""The integrator as plain Python, against closed forms; test_engine.py compiles it."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.loops.engine import advance as integrator
from teleop_drake.loops.engine.advance import DONE, FULL, STUCK, advance
from teleop_drake.loops.engine.problem import (
    ROWS,
    TRIES,
    Delays,
    Problem,
    Transitions,
    make_memory,
)
from teleop_drake.loops.numerics.piecewise import Pieces, fit_pieces

NO_PIECES = Pieces(np.empty((0, 2)), np.empty((0, 8)))
NO_DELAYS = Delays(
    *(np.empty(0), *[np.empty(0, dtype=int)] * 3),
    packet_ranges=np.empty((0, 2), dtype=int),
    packets=np.empty((0, 3)),
    piece_ranges=np.empty((0, 2), dtype=int),
    knots=np.empty((0, 2)),
    coefficients=np.empty((0, 8)),
)
NO_TRANSITIONS = Transitions(
    *[np.empty(0, dtype=int)] * 4, *[np.empty(0)] * 2, np.empty(0, dtype=int)
)


def OneTransition(*, guard, source, period=math.inf, offset=math.inf):
    places = map(np.array, ([guard], [source], [0], [1]))
    return Transitions(*places, *map(np.array, ([period], [offset], [0])))


def MakeProblem(delays=NO_DELAYS, transitions=NO_TRANSITIONS):
    return Problem(np.empty(0), delays, transitions)


def MakeMemory(x, m=(), num_signals=1, problem=None, room=2000):
    problem = problem or MakeProblem()
    return make_memory(
        problem,
        x=np.array(x, dtype=float),
        m=np.array(m, dtype=float),
        y=np.ones(num_signals),  # What comes out of a delay at first.
        room=room,
    )


def oscillate(t, x, m, p, y, dx, wanted):
    dx[0] = x[1]
    dx[1] = -x[0]
    y[0] = x[0]


@pytest.mark.parametrize("place", [0, 1])
def test_no_step_is_taken_with_a_rate_that_is_no_number(place):
    """Of two states, whichever comes first, one has no rate beyond 0.5 s."""

    def break_down(t, x, m, p, y, dx, wanted):
        dx[:] = -1.0
        dx[place] = math.nan if t > 0.5 else 0.0

    memory = MakeMemory([1.0, 1.0])
    outcome = FULL
    while outcome == FULL:
        outcome = advance(break_down, MakeProblem(), memory, 1.0, 1e-6, 0.2)
    assert outcome == STUCK
    assert memory.clock[0] == pytest.approx(0.5)
    assert memory.x[1 - place] == pytest.approx(0.5)


def Doubled(array):
    return np.concatenate([array, np.empty_like(array)])


def test_it_goes_on_where_there_was_no_more_room():
    memory = MakeMemory([1.0, 0.0], room=12)
    outcome = FULL
    calls = 0
    while outcome == FULL:
        outcome = advance(oscillate, MakeProblem(), memory, 6.0, 1e-10, 0.2)
        num = memory.counts[ROWS]
        times = memory.row_times[:num]
        rows = memory.rows[:num, 0]
        assert_allclose(rows, np.cos(times), atol=1e-8)
        calls += 1
        grown = {"row_times", "row_ends", "rows"}
        memory = memory._replace(
            **{name: Doubled(getattr(memory, name)) for name in grown}
        )
    assert outcome == DONE and calls > 2 and times[-1] == 6.0


def decay(t, x, m, p, y, dx, wanted):
    y[0] = x[0]
    dx[0] = -y[1]


def OneDelay(time, packets=(), pieces=NO_PIECES):
    return Delays(
        times=np.array([time]),
        signals=np.array([0]),
        outputs=np.array([1]),
        sizes=np.array([1]),
        packet_ranges=np.array([[0, len(packets)]]),
        packets=np.array(packets, dtype=float).reshape(-1, 3),
        piece_ranges=np.array([[0, len(pieces.coefficients)]]),
        knots=pieces.knots,
        coefficients=pieces.coefficients,
    )


def test_a_delay_that_varies():
    """dx/dt = -x(t - T), T = 0.5 + t/2, so that t - T(t) = (t - 1)/2.

    1 - t up to t = 1, then x(1) - (t - 1) + (t - 1)^2/4 up to t = 3.
    """
    pieces = fit_pieces(lambda t: 0.5 + t / 2, 0.0, 2.75)
    problem = MakeProblem(delays=OneDelay(0.5, pieces=pieces))
    memory = MakeMemory([1.0], num_signals=2, problem=problem)
    assert advance(decay, problem, memory, 2.75, 1e-10, 0.1) == DONE
    assert memory.x[0] == pytest.approx(-1.75 + 1.75**2 / 4, abs=1e-9)
    times = memory.row_times[: memory.counts[ROWS]]
    # A step ends where the start comes out.
    assert times[np.argmin(np.abs(times - 1))] == pytest.approx(1.0, abs=1e-12)


def test_packets_are_held():
    """dx/dt = -x(k) from k + 0.5 on, where packet k is shown, and -1 before."""
    packets = [(k + 0.5, k, -math.inf) for k in range(3)]
    problem = MakeProblem(delays=OneDelay(math.inf, packets))
    memory = MakeMemory([1.0], num_signals=2, problem=problem)
    assert advance(decay, problem, memory, 2.5, 1e-9, 0.1) == DONE
    # x(0) = 1, x(1) = 0: -1 up to 1.5, then 0.
    assert memory.x[0] == pytest.approx(-0.5, abs=1e-9)


def throw(t, x, m, p, y, dx, wanted):
    dx[0] = x[1]
    dx[1] = -1.0
    if wanted:
        y[0] = x[0] - 0.49 if m[0] == 0 else -1.0
        y[1] = 1.0


def test_a_moment_within_a_step_is_found():
    """A ball flies above 0.49 m for 0.28 s, within a step of 1 s."""
    problem = MakeProblem(transitions=OneTransition(guard=0, source=1))
    memory = MakeMemory([0.0, 1.0], m=[0.0], num_signals=2, problem=problem)
    memory.clock[1] = 0.1  # The step after that is five times as long, then 1 s.
    assert advance(throw, problem, memory, 3.0, 1e-3, 1.0) == DONE
    times = memory.row_times[: memory.counts[ROWS]]
    assert times[np.flatnonzero(np.diff(times) == 0)[-1]] == pytest.approx(
        1 - math.sqrt(0.02), abs=1e-9
    )
    assert memory.m[0] == 1


@pytest.mark.parametrize("is_stiff", [False, True])
def test_it_comes_back_from_what_comes_no_further(monkeypatch, is_stiff):
    """From events at one instant, and from steps that are rejected."""
    monkeypatch.setattr(integrator, "_MOST_TRIES", 20)
    each = OneTransition(guard=-1, source=0, period=1e-14, offset=0.0)
    problem = MakeProblem() if is_stiff else MakeProblem(transitions=each)

    def decay(t, x, m, p, y, dx, wanted):
        dx[0] = -1e12 * x[0] if is_stiff else 0.0

    memory = MakeMemory([1.0], m=[0.0], problem=problem)
    for calls in (1, 2):
        assert advance(decay, problem, memory, 1.0, 1e-9, 0.1) == FULL
        assert memory.counts[TRIES] == 20 * calls
    assert memory.clock[0] < 1e-9
