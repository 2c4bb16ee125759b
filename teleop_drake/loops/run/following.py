"""Steps of Drake's Simulator within which signals move.

Drake provides the states at the ends of a step only. Within a step they are
interpolated by cubic polynomials that match states and rates at both ends. Signals that
are affine in the states follow these cubics. All others that may move are evaluated at
the interpolated states, in a separate Context. Where a polynomial through the samples
does not follow a signal, the step is recorded in shorter pieces, down to 2^-14 of its
length.
"""

import math
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from struct import Struct
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context, OutputPort

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.numerics.instants import same_within
from teleop_drake.loops.numerics.step_polynomials import DEGREE
from teleop_drake.loops.run.bends import CHECKED, INSIDE, Bends
from teleop_drake.loops.run.moving import Motion
from teleop_drake.loops.run.readings import MemoryOf, Readings

Rows = tuple[Array, Array, Indices]
"""Times in s (N), samples (N, k), and the indices of the rows at the ends of steps."""

# The coefficients of the change within a step, by ascending powers of the share of its
# length: of the change at the end, and of the rates at both ends times the length.
_HERMITE = np.array([[0.0, 0, 0], [0, 1, 0], [3, -2, -1], [-2, 1, 1]])


class _Shares(NamedTuple):
    """Points of a step.

    Attributes:
        values: The points as shares of the step's length (s).
        weights: The weights at these of the change at the end of the step, and of the
            rates at both ends times the length (s, 3).
    """

    values: Array
    weights: Array


def _EvaluatedOf(begin: float, end: float) -> _Shares:
    """Returns the points at which a piece of a step is evaluated, given its shares."""
    values = begin + (end - begin) * np.array([*INSIDE, CHECKED])
    return _Shares(values, np.vander(values, 4, increasing=True) @ _HERMITE)


_WHOLE_STEP = _EvaluatedOf(0.0, 1.0)

# The shortest piece as a share of its step, and the most pieces of a step. A kink needs
# some fifteen.
_SHORTEST_PIECE = 2.0**-14
_MOST_PIECES = 200

# At most so many steps are followed at once. NumPy takes almost as long for one.
_MOST_WAITING = 256

_NOTHING: Array = np.empty(0)

_NO_SIGNAL: Indices = np.empty(0, dtype=np.intp)


class Moving(NamedTuple):
    """A signal that may move within a step.

    Attributes:
        signal: Its index among all signals.
        port: The output port.
        place: Its place in a sample.
        is_affine: Whether it is affine in the continuous state within a step.
        is_opaque: Whether it may depend on abstract states.
    """

    signal: int
    port: OutputPort
    place: slice
    is_affine: bool
    is_opaque: bool


class _Instant(NamedTuple):
    """An instant of a run, of a system with n continuous states.

    Attributes:
        time: The time, s.
        state: The continuous state (n).
        rate: The rate of the state (n).
        sample: The values of all signals.
        held: The discrete states and the held signals.
    """

    time: float
    state: Array
    rate: Array
    sample: bytes
    held: bytes


class _Instants(NamedTuple):
    """The times (m), states (m, n), rates (m, n) and samples (m, k) of instants."""

    time: Array
    state: Array
    rate: Array
    sample: Array


class _Steps(NamedTuple):
    """Some steps: their beginnings, their ends, and what is held within each."""

    begin: _Instants
    end: _Instants
    held: Sequence[bytes]

    def Only(self, i: int) -> "_Steps":
        """Returns the step with an index."""
        begin, end = (
            _Instants(*(x[i : i + 1] for x in each)) for each in (self.begin, self.end)
        )
        return _Steps(begin, end, self.held[i : i + 1])


class _Block(NamedTuple):
    """Rows of some steps: the times (m, 5), the samples (m, 5, k), and which are rows.

    A step begins with the row before, unless it has one of its own. A row that belongs
    to no step is the first and only one of five.
    """

    times: Array
    rows: Array
    is_row: Array


class Following:
    """Records steps from their ends, with the rows within.

    If a held signal or a discrete state differs from that of the instant before, a
    block has changed it at the beginning of the step, which is sampled again.

    Attributes:
        bent: The indices of the signals that jump or bend within a step.
        unresolved: The indices of those that do so more sharply than the shortest piece
            follows.

    Args:
        motion: What is known of the outputs.
        root_context: The Context of the Simulator.
        sizes: The sizes of all signals, in the order of a sample.
        moving: The signals that may move within a step. All others are held: they
            change at the beginning of a step only.
        held: The values of the held signals in the Context of the Simulator.
        rows: The rows before the first step.
    """

    def __init__(
        self,
        motion: Motion,
        root_context: Context,
        sizes: Sequence[int],
        moving: Sequence[Moving],
        held: Collection[memoryview],
        rows: Rows,
    ):
        self.bent: set[int] = set()
        self.unresolved: set[int] = set()
        self._root_context = root_context
        self._has_states = root_context.num_continuous_states() > 0
        self._state = root_context.get_continuous_state_vector()
        self._EvalRates = motion.system.EvalTimeDerivatives
        # Events change abstract states unseen, and with them signals and rates.
        is_opaque = [x.is_opaque for x in moving]
        self._changes_unseen = any(is_opaque) or motion.HasOpaqueRates()
        self._jumps_unseen = self._changes_unseen and motion.JumpsUnseen()
        groups = range(root_context.num_discrete_state_groups())
        self._discrete = [MemoryOf(root_context.get_discrete_state(i)) for i in groups]
        self._held = [*self._discrete, *held]
        self._floats = Struct(f"{sum(sizes)}d")
        # The Context for what is within steps, and what is held in it.
        self._context = motion.context
        self._held_inside = b""
        affine = [x for x in moving if x.is_affine]
        others = [x for x in moving if not x.is_affine]
        self._moving = motion.ReadingsOf([x.port for x in moving])
        self._moving_columns = _Columns(moving)
        self._others = motion.ReadingsOf([x.port for x in others])
        self._other_columns = _Columns(others)
        self._affine_columns = _Columns(affine)
        self._slopes = _Slopes(
            self._context, motion.ReadingsOf([x.port for x in affine])
        )
        times, samples, _ = rows
        self._first_rows = rows
        self._blocks: list[_Block] = []
        self._bends = Bends(sizes)
        self._last = _Instant(math.inf, _NOTHING, _NOTHING, b"", b"")
        # The ends of steps.
        self._waiting: list[tuple[_Instant, _Instant]] = []
        if len(times):
            self._bends.See(samples)
            self._last = self._last._replace(
                time=float(times[-1]), sample=samples[-1].tobytes()
            )

    def Add(self, time: float, sample: bytes) -> None:
        """Records a step, or only its end if it has no length or is not finite.

        Args:
            time: The time of the end, s.
            sample: The sample there.
        """
        state = rate = _NOTHING
        if self._has_states:
            state = self._state.CopyToVector()
            rate = self._EvalRates(self._root_context).CopyToVector()
        held = b"".join(self._held)
        instant = _Instant(time, state, rate, sample, held)
        is_finite = math.isfinite(math.hypot(*self._floats.unpack(sample)))
        last = self._last
        self._last = instant
        if not is_finite or time <= last.time + same_within(time):
            self.CatchUp()
            self._AppendRow(time, np.frombuffer(sample))
            return
        self._waiting.append((last, instant))
        if self._changes_unseen:
            self._context.SetTimeStateAndParametersFrom(self._root_context)
            self._held_inside = held
            self._CatchUp()
        elif len(self._waiting) == _MOST_WAITING:
            self.CatchUp()

    def Pass(self, time: float) -> bool:
        """Passes a step of which nobody asks for rows, given the time of its end in s.

        Returns:
            Whether the state is finite; if not, the step is to be added.
        """
        state = self._state.CopyToVector()
        if not math.isfinite(math.hypot(*state.tolist())):
            return False
        self._last = _Instant(time, state, _NOTHING, b"", b"".join(self._held))
        return True

    def CatchUp(self) -> None:
        """Records the steps that wait for the rows within them."""
        # Others use the Context, too.
        self._held_inside = b""
        self._CatchUp()

    def _CatchUp(self) -> None:
        """Records the steps that wait; the Context has the states of the first one."""
        if not self._waiting:
            return
        lasts, ends = zip(*self._waiting, strict=True)
        self._waiting = []
        begins = list(map(self._Begin, lasts, ends))
        has_begin = [x.sample != y.sample for x, y in zip(lasts, begins, strict=True)]
        held = [instant.held for instant in ends]
        steps = _Steps(_InstantsOf(begins), _InstantsOf(ends), held)
        times, evaluated = self._Within(steps, _WHOLE_STEP)
        times = _Closed(steps.begin.time, times[:, :-1], steps.end.time)
        rows = _Closed(steps.begin.sample, evaluated[:, :-1], steps.end.sample)
        bent, signals = self._Bent(rows, evaluated[:, -1])
        self.bent.update(signals.tolist())
        first = 0
        for i in sorted({*bent.tolist()}):
            self._AppendSteps(times[first:i], rows[first:i], has_begin[first:i])
            self._FollowPieces(steps.Only(i), has_begin=has_begin[i])
            first = i + 1
        self._AppendSteps(times[first:], rows[first:], has_begin[first:])

    def _Begin(self, last: _Instant, end: _Instant) -> _Instant:
        """Returns the beginning of a step, where a block may have changed something.

        Args:
            last: The end of the step before, which may have been passed.
            end: The end of the step, which has the held signals.
        """
        if last.sample and last.held == end.held and not self._jumps_unseen:
            return last
        self._Hold(end.held)
        self._context.SetTimeAndContinuousState(last.time, last.state)
        row = np.frombuffer(end.sample).copy()
        row[self._moving_columns] = np.frombuffer(self._moving.Read())
        rate = last.rate
        if self._has_states:
            rate = self._EvalRates(self._context).CopyToVector()
        return _Instant(last.time, last.state, rate, row.tobytes(), end.held)

    def _Hold(self, held: bytes) -> None:
        """Sets the discrete states in the Context for what is within steps."""
        if held == self._held_inside:
            return
        self._held_inside = held
        first = 0
        for i, memory in enumerate(self._discrete):
            last = first + memory.nbytes
            self._context.SetDiscreteState(i, np.frombuffer(held[first:last]))
            first = last

    def _Within(self, steps: _Steps, shares: _Shares) -> tuple[Array, Array]:
        """Returns the times (m, s) and the samples (m, s, k) at points of steps."""
        begin, end, held = steps
        length = (end.time - begin.time)[:, np.newaxis]
        times = begin.time[:, np.newaxis] + length * shares.values
        states = np.empty((*times.shape, 0))
        rows = np.repeat(end.sample[:, np.newaxis], len(shares.values), axis=1)
        if self._has_states:
            ends = [end.state - begin.state, length * begin.rate, length * end.rate]
            changes = shares.weights @ np.stack(ends, axis=1)
            states = begin.state[:, np.newaxis] + changes
            first = begin.sample[:, np.newaxis, self._affine_columns]
            rows[..., self._affine_columns] = first + changes @ self._slopes
        if len(self._other_columns):
            found = b"".join(map(self._Evaluated, times, states, held))
            values = np.frombuffer(found).reshape(*times.shape, -1)
            rows[..., self._other_columns] = values
        return times, rows

    def _Evaluated(self, times: Array, states: Array, held: bytes) -> bytes:
        """Returns the signals that are not affine, in a row for each instant.

        Args:
            times: The times of instants within a step, s (s).
            states: The states (s, n).
            held: What is held within the step.
        """
        self._Hold(held)
        rows = []
        for time, state in zip(times.tolist(), states, strict=True):
            self._context.SetTimeAndContinuousState(time, state)
            rows.append(self._others.Read())
        return b"".join(rows)

    def _Bent(self, rows: Array, checked: Array) -> tuple[Indices, Indices]:
        """Returns the pieces whose polynomial does not follow a signal, and the signal.

        Args:
            rows: The samples of each piece (m, 5, k).
            checked: The samples at CHECKED (m, k).
        """
        if len(self._other_columns) == 0:  # Cubics are followed.
            return _NO_SIGNAL, _NO_SIGNAL
        return self._bends.Find(np.concatenate([rows, checked[:, np.newaxis]], axis=1))

    def _FollowPieces(self, step: _Steps, *, has_begin: bool) -> None:
        """Records one step in pieces that polynomials follow.

        Args:
            has_begin: Whether there is a row at its beginning.
        """
        begin_time = step.begin.time
        begin_sample = step.begin.sample
        # The pieces ahead, the next one last: their shares of the step, and their ends.
        pieces = [(0.0, 1.0, step.end.time, step.end.sample)]
        num_pieces = 1
        while pieces:
            begin, end, end_time, end_sample = pieces.pop()
            times, rows = self._Within(step, _EvaluatedOf(begin, end))
            middle = (begin + end) / 2
            halves = [
                (middle, end, end_time, end_sample),
                (begin, middle, times[:, 1], rows[:, 1]),
            ]
            checked = rows[:, -1]
            times = _Closed(begin_time, times[:, :-1], end_time)
            rows = _Closed(begin_sample, rows[:, :-1], end_sample)
            _, bent = self._Bent(rows, checked)
            may_halve = end - begin > _SHORTEST_PIECE and num_pieces < _MOST_PIECES
            if len(bent) and may_halve:
                pieces += halves
                num_pieces += 1
                continue
            self.unresolved.update(bent.tolist())
            if num_pieces == _MOST_PIECES:
                # Noise bends everywhere.
                self._bends.Leave(bent)
            self._AppendSteps(times, rows, [has_begin and begin == 0.0])
            begin_time = end_time
            begin_sample = end_sample

    def _AppendSteps(
        self, times: Array, rows: Array, has_begin: Sequence[bool]
    ) -> None:
        """Appends the rows of steps, each of which begins where the last one ends.

        Args:
            times: The times of each step, s (m, 5).
            rows: The samples of each step (m, 5, k).
            has_begin: Whether a step has a row of its own at its beginning (m).
        """
        is_row = np.ones(times.shape, dtype=bool)
        is_row[:, 0] = has_begin
        self._blocks.append(_Block(times, rows, is_row))

    def _AppendRow(self, time: float, row: Array) -> None:
        """Appends a row that belongs to no step."""
        is_row = np.zeros((1, DEGREE + 1), dtype=bool)
        is_row[:, 0] = True
        times = np.full(is_row.shape, time)
        self._blocks.append(_Block(times, row + np.zeros((*is_row.shape, 1)), is_row))

    def Rows(self) -> Rows:
        """Returns all rows, with those before the first step.

        Steps that still wait are left out if their signals cannot be computed: an error
        has ended the run beside them.
        """
        with suppress(Exception):
            self.CatchUp()
        first_times, first_rows, first_ends = self._first_rows
        times, rows, is_row = (
            np.concatenate(x) for x in zip(*self._blocks, strict=True)
        )
        last = len(first_times) - 1 + np.cumsum(is_row.sum(axis=1))
        return (
            np.append(first_times, times[is_row]),
            np.concatenate([first_rows, rows[is_row]]),
            np.append(first_ends, last[is_row[:, -1]]),
        )


def _InstantsOf(instants: Iterable[_Instant]) -> _Instants:
    """Returns instants as arrays."""
    times, states, rates, samples, _ = zip(*instants, strict=True)
    rows = np.frombuffer(b"".join(samples)).reshape(len(times), -1)
    return _Instants(np.array(times), np.array(states), np.array(rates), rows)


def _Closed(first: Array, inside: Array, last: Array) -> Array:
    """Returns values at the beginnings of steps, inside and at the ends (m, 5, ...).

    Args:
        first: The values at the beginnings (m, ...).
        inside: The values inside (m, 3, ...).
        last: The values at the ends (m, ...).
    """
    return np.concatenate([first[:, np.newaxis], inside, last[:, np.newaxis]], axis=1)


def _Columns(signals: Iterable[Moving]) -> Indices:
    """Returns the columns of some signals in a sample."""
    places = [np.arange(x.place.start, x.place.stop) for x in signals]
    return np.concatenate([_NO_SIGNAL, *places])


def _Slopes(context: Context, signals: Readings) -> Array:
    """Returns the derivatives of affine signals with respect to the states (n, k).

    Args:
        context: The Context in which the signals are read, which is changed.
    """

    def At(state: Array) -> Array:
        context.SetContinuousState(state)
        return np.frombuffer(signals.Read())

    units = np.eye(context.num_continuous_states())
    offset = At(np.zeros(len(units)))
    return np.array([At(unit) - offset for unit in units])
