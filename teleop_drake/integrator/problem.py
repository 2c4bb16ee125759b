"""A system with delays and modes as arrays, as advance() integrates it."""

from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array, Indices
from teleop_drake.numerics.instants import same_within


class Delays(NamedTuple):
    """What is delayed; d delays of w numbers in all.

    Attributes:
        times: The delays in s (d), > 0; infinity where packets are shown. Of one that
            varies the shortest.
        signals: Where in y a delay's signal begins (d).
        outputs: Where in y its output begins (d).
        sizes: Width of the signal (d).
        initial_values: What comes out at first, one after another (w).
        packet_ranges: First and end of a delay's packets among all (d, 2).
        packets: When they are shown and sent, and when the one was sent with which they
            make a line, -infinity without, s (k, 3). Where no packets are shown, steps
            end when one would be: at the nonsmooth points of a delay that varies.
        piece_ranges: First and end of a delay's pieces among all (d, 2); none where the
            delay is constant.
        knots: Of the delays that vary, as piecewise.Pieces has them, one after another;
            each delay has one knot more than it has pieces.
        coefficients: Of their pieces (p, 8).
    """

    times: Array
    signals: Indices
    outputs: Indices
    sizes: Indices
    initial_values: Array
    packet_ranges: Indices
    packets: Array
    piece_ranges: Indices
    knots: Array
    coefficients: Array


class Transitions(NamedTuple):
    """Changes of the mode, k in all.

    Attributes:
        guards: Where in y the guard is (k), -1 if it is periodic.
        sources: Where in y the new mode begins (k).
        targets: Where in m it belongs (k).
        sizes: How many numbers it has (k).
        periods: Of the periodic ones in s (k); infinity: once.
        offsets: When the periodic ones happen first, s (k); infinity for others.
        are_discrete: 1 for what happens after the others at an instant, 0 for those.
    """

    guards: Indices
    sources: Indices
    targets: Indices
    sizes: Indices
    periods: Array
    offsets: Array
    are_discrete: Indices


class Problem(NamedTuple):
    """What belongs to a system.

    Attributes:
        p: Its parameters.
        q: Its parameters that are integers.
        delays: What is delayed.
        transitions: How the mode changes.
    """

    p: Array
    q: Indices
    delays: Delays
    transitions: Transitions


class Memory(NamedTuple):
    """What advance() works with and leaves behind.

    Attributes:
        clock: Time, next step's length, and where it started, in s (3).
        counts: Steps taken, evaluations, polynomials, breaks, rows, whether the first
            stage is known, and what was tried: steps, rejected ones too, and events
            (7).
        x: Continuous state.
        m: Discrete state.
        m_before: The same before the transitions under way.
        y: Signals; what is fed from outside is there beforehand.
        stages: Rates at the stages of a step (7, n).
        x_stage: State at a stage (n).
        x_next: State at the end of the step (n).
        dx: A rate that is not a stage's (n).
        next_packets: The next packet that will be shown of each delay (d).
        ticks: The number of each periodic transition's next instant (k).
        guards: What each guard was at the begin of the step, and of the one before if
            nothing happened in between (k, 2).
        breaks: Time and order of the breaks ahead (b, 2).
        steps: Begin and end of each polynomial in s (c, 2).
        values: Delayed signals at the nodes (c, 5, w).
        first_values: Delayed signals before anything has happened (w).
        row_times: Times of the recorded rows (r).
        row_ends: 1 for those with which a step ends (r); before one there are the three
            rows within the step, and before these the one with which it begins.
        rows: Signals of the recorded rows (r, y).
    """

    clock: Array
    counts: Indices
    x: Array
    m: Array
    m_before: Array
    y: Array
    stages: Array
    x_stage: Array
    x_next: Array
    dx: Array
    next_packets: Indices
    ticks: Indices
    guards: Array
    breaks: Array
    steps: Array
    values: Array
    first_values: Array
    row_times: Array
    row_ends: Indices
    rows: Array


# The places in `counts`.
STEPS, EVALUATIONS, POLYNOMIALS, BREAKS, ROWS, IS_STARTED, TRIES = range(7)


def make_memory(
    problem: Problem,
    *,
    x: Array,
    m: Array,
    y: Array,
    time: float = 0.0,
    first_step: float = 1e-3,
    room: int = 512,
) -> Memory:
    """Returns what advance() starts with.

    Args:
        y: Signals, with what is fed from outside.
        time: In s. What is due before has happened.
        first_step: Length of the first step in s.
        room: For how many polynomials and rows.
    """
    n = len(x)
    width = len(problem.delays.initial_values)
    transitions = problem.transitions
    periods = problem.transitions.periods
    gone = np.where(transitions.guards < 0, time - transitions.offsets, 0.0)
    gone -= same_within(time)
    ticks = np.where(periods < np.inf, np.ceil(gone / periods), gone > 0)
    return Memory(
        clock=np.array([time, first_step, time]),
        counts=np.zeros(7, np.int64),
        x=x,
        m=m,
        m_before=m.copy(),
        y=y,
        stages=np.zeros((7, n)),
        x_stage=np.zeros(n),
        x_next=np.zeros(n),
        dx=np.zeros(n),
        next_packets=problem.delays.packet_ranges[:, 0].copy(),
        ticks=np.maximum(ticks, 0).astype(np.int64),
        guards=np.zeros((len(ticks), 2)),
        breaks=np.zeros((1024, 2)),
        steps=np.zeros((room, 2)),
        values=np.empty((room, 5, width)),
        first_values=np.zeros(width),
        row_times=np.empty(room),
        row_ends=np.empty(room, np.int64),
        rows=np.empty((room, len(y))),
    )
