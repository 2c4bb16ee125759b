"""The arguments of advance(): a Problem to integrate, and its working Memory.

They are named tuples of arrays, which compiled code can take (jit/typed_values).
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.numerics.instants import same_within


class Steering(NamedTuple):
    """The k delays whose time is a signal.

    Attributes:
        delays: The index of each delay (k); its time in Delays.times is infinity.
        controls: The index in y of the signal that steers each delay (k).
        lengths: 0 if the signal is the delay in s; otherwise the signal is the position
            of a conveyor, whose length this is in the same unit (k).
        longest: The longest delay that is allowed, s (k).
    """

    delays: Indices
    controls: Indices
    lengths: Array
    longest: Array


NO_STEERING = Steering(
    delays=np.empty(0, np.int64),
    controls=np.empty(0, np.int64),
    lengths=np.empty(0),
    longest=np.empty(0),
)
"""The Steering of a problem in which no delay's time is a signal."""


class Delays(NamedTuple):
    """The d delays of a problem.

    Attributes:
        times: The delays in s (d): the constant delay, a lower bound of a delay that
            varies, or infinity for packets. If it is 0, the delay's output is not used
            (see evaluator.PassAtZero).
        signals: The index in y at which each delay's signal begins (d).
        outputs: The index in y at which each delay's output begins (d).
        sizes: The width of each signal (d).
        packet_ranges: The begin and end of each delay's rows in `packets` (d, 2).
        packets: The times in s of each kernel.Packet (k, 3): `shown`, `sent` and
            `previous`. A delay that varies has a packet at each non-smooth point of
            T(t); it carries no value and only makes a step end there.
        piece_ranges: The begin and end of each delay's rows in `coefficients` (d, 2);
            empty unless the delay varies.
        knots: The begin and end of each piece in s (p, 2).
        coefficients: The coefficients of each piece, as in piecewise.Pieces (p, 8).
        steering: The delays whose time is a signal.
    """

    times: Array
    signals: Indices
    outputs: Indices
    sizes: Indices
    packet_ranges: Indices
    packets: Array
    piece_ranges: Indices
    knots: Array
    coefficients: Array
    steering: Steering = NO_STEERING


class Transitions(NamedTuple):
    """The k transitions, which change the mode.

    Attributes:
        guards: The index of each guard in y (k); -1 for a periodic transition.
        sources: The index in y at which the new mode begins (k).
        targets: The index in m at which the block's mode begins (k).
        sizes: The width of the mode (k).
        periods: The periods of periodic transitions in s (k); infinity: once.
        offsets: The first times of periodic transitions in s (k); infinity for others.
        are_discrete: 1 for discrete updates, which happen after the other transitions
            of an instant; 0 for others (k).
    """

    guards: Indices
    sources: Indices
    targets: Indices
    sizes: Indices
    periods: Array
    offsets: Array
    are_discrete: Indices


class Problem(NamedTuple):
    """The data of a problem; its equations are the function `evaluate` of a program.

    Attributes:
        p: The parameters that are floats.
        delays: The delays.
        transitions: The changes of the mode.
    """

    p: Array
    delays: Delays
    transitions: Transitions


class Steered(NamedTuple):
    """The part of the memory for the k delays whose time is a signal.

    An output of such a delay is found by the jumps behind it: it lies on the piece of
    its signal between two of them until a step has ended where it passes one.

    Attributes:
        marks: Integers at the places JUMPS to AHEAD (3): the number of jumps; whether
            an output was sent within the present step, 0 or 1; and the first row of the
            last try of the step, 0 if there is none.
        jumps: Time in s, order and row of each event behind that an output may still
            pass (j, 3). The row is the one after the event; for the order, see
            Memory.breaks.
        sides: The number of jumps behind each output (k).
        used: The value of each control with which the output was found (k).
        sent: When each output was sent, s, at the start of the step and of the step
            before (k, 2).
        x_before: The state at the end of the last try (n).
    """

    marks: Indices
    jumps: Array
    sides: Indices
    used: Array
    sent: Array
    x_before: Array


class Memory(NamedTuple):
    """The working memory and the results of advance().

    Attributes:
        clock: The time, the length of the next step and the time of the first row, in
            s (3).
        counts: Integers at the places STEPS to FIRST (7): the number of steps taken;
            the number of evaluations; the index of the last row that ends a step, 0 if
            there is none; the number of breaks; the number of rows; the number of
            tries, which are accepted and rejected steps, and events without a step; and
            the index of the first row of the run, after those of the past.
        x: Continuous state.
        m: Discrete state.
        m_before: Discrete state before the transitions of the present instant.
        y: Signals. The caller sets the inputs that are not connected and, at the start,
            the outputs of delays.
        stages: Rates at the stages of a step (7, n).
        weights: Weights of the stages in the dense output (7).
        x_stage: State at a stage (n).
        x_next: State at the end of the step (n).
        dx: A rate that belongs to no stage (n).
        next_packets: The index of the next packet to be shown for each delay (d).
        ticks: The number of each periodic transition's next instant (k).
        guards: The value of each guard at the start of the step, and at the start of
            the step before if no event happened in between (k, 2).
        breaks: Time in s and order of the breaks ahead (b, 2). A break is an instant
            that no step may cross. Its order is the number of delays that the effect of
            an event has passed since it was a jump of a signal.
        row_times: Times of the recorded rows in s (r).
        row_ends: 1 for a row at the end of a step, else 0 (r). Three rows within the
            step precede it, and the row at the start of the step precedes these.
        rows: Signals of the recorded rows (r, y).
        steered: The memory of the delays whose time is a signal; None: there are none.
    """

    clock: Array
    counts: Indices
    x: Array
    m: Array
    m_before: Array
    y: Array
    stages: Array
    weights: Array
    x_stage: Array
    x_next: Array
    dx: Array
    next_packets: Indices
    ticks: Indices
    guards: Array
    breaks: Array
    row_times: Array
    row_ends: Indices
    rows: Array
    steered: Steered | None = None


class Past(NamedTuple):
    """The signals sent through the delays before a run.

    Attributes:
        times: The times of the rows in s (r). The first row has the signals before the
            events of its instant. Each step has five rows: one at either end and three
            between.
        rows: The signals y (r, y); only the inputs of delays are valid.
        arrivals: The times in s at which the jumps under way arrive (b).
    """

    times: Array
    rows: Array
    arrivals: Array


# The places in Memory.counts.
STEPS, EVALUATIONS, END, BREAKS, ROWS, TRIES, FIRST = range(7)

# The places in Steered.marks.
JUMPS, BEYOND, AHEAD = range(3)


def make_memory(
    problem: Problem,
    *,
    x: Array,
    m: Array,
    y: Array,
    time: float = 0.0,
    past: Past | None = None,
    first_step: float = 1e-3,
    room: int = 512,
) -> Memory:
    """Returns the initial memory of advance().

    Args:
        x: Initial continuous state (n).
        m: Initial discrete state.
        y: Signals, with the values of inputs that are not connected and the initial
            outputs of the delays.
        time: The start time in s. Events that were due before it are not executed.
        past: The signals sent before the start; None: the delays are empty.
        first_step: Length of the first step in s.
        room: The number of rows for which memory is reserved.
    """
    n = len(x)
    transitions = problem.transitions
    periods = problem.transitions.periods
    # The number of the first tick that is not before the start, as Drake rounds it.
    gone = np.where(transitions.guards < 0, time - transitions.offsets, 0.0)
    nearest = np.round(gone / periods)
    steps = nearest * np.where(periods < np.inf, periods, 0.0)
    ticks = nearest + (transitions.offsets + steps < time)
    # Packets that were shown before are shown in the first row.
    delays = problem.delays
    next_packets = [
        begin + np.searchsorted(delays.packets[begin:end, 0], time - same_within(time))
        for begin, end in delays.packet_ranges
    ]
    num_arrivals = 0 if past is None else len(past.arrivals)
    memory = Memory(
        clock=np.array([time, first_step, time]),
        counts=np.zeros(7, np.int64),
        x=x,
        m=m,
        m_before=m.copy(),
        y=y,
        stages=np.zeros((7, n)),
        weights=np.zeros(7),
        x_stage=np.zeros(n),
        x_next=np.zeros(n),
        dx=np.zeros(n),
        next_packets=np.array(next_packets, np.int64),
        ticks=np.maximum(ticks, 0).astype(np.int64),
        guards=np.zeros((len(ticks), 2)),
        breaks=np.zeros((1024 + num_arrivals, 2)),
        row_times=np.empty(room),
        row_ends=np.empty(room, np.int64),
        rows=np.empty((room, len(y))),
        steered=_make_steered(len(delays.steering.delays), n, past),
    )
    if past is not None:
        _put_past(past, memory)
    return memory


def _make_steered(k: int, n: int, past: Past | None) -> Steered | None:
    """Returns the memory of k delays whose time is a signal; None without any."""
    if k == 0:
        return None
    num_past = 0 if past is None else len(past.times)
    return Steered(
        marks=np.zeros(3, np.int64),
        jumps=np.zeros((1024 + num_past, 3)),
        sides=np.zeros(k, np.int64),
        used=np.zeros(k),
        sent=np.zeros((k, 2)),
        x_before=np.zeros(n),
    )


def _put_past(past: Past, memory: Memory) -> None:
    """Writes the rows before the start, and the jumps under way, into the memory."""
    num = len(past.times)
    memory.row_times[:num] = past.times
    memory.row_ends[:num] = np.arange(num) % 5 == 0
    memory.row_ends[0] = 0
    memory.rows[:num] = past.rows
    memory.counts[ROWS] = num
    memory.counts[FIRST] = num
    memory.counts[END] = num - 1
    memory.clock[2] = past.times[0]
    num_breaks = len(past.arrivals)
    memory.breaks[:num_breaks, 0] = past.arrivals
    memory.breaks[:num_breaks, 1] = 1
    memory.counts[BREAKS] = num_breaks
    if memory.steered is not None:
        _put_jumps(past, memory.steered)


def _put_jumps(past: Past, steered: Steered) -> None:
    """Writes the jumps of the past: its beginning, and where two steps do not meet."""
    num = len(past.times)
    ends = past.rows[5 : num - 1 : 5]
    begins = past.rows[6:num:5]
    differ = np.abs(begins - ends) > 1e-9 * (np.abs(begins) + np.abs(ends))
    after = np.append(1, 6 + 5 * np.flatnonzero(differ.any(axis=1)))
    jumps = np.stack([past.times[after], np.ones(len(after)), after], axis=1)
    steered.marks[JUMPS] = len(after)
    steered.jumps[: len(after)] = jumps
