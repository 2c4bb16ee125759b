"""Runs a compiled diagram."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence, Sized
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import Context

from teleop_drake.arrays import Array, Indices
from teleop_drake.engine.advance import DONE, STUCK, advance, is_full
from teleop_drake.engine.delays import delay_at
from teleop_drake.engine.evaluator import Evaluator
from teleop_drake.engine.past import ReadPast
from teleop_drake.engine.problem import (
    BREAKS,
    END,
    ROWS,
    Delays,
    Memory,
    Past,
    Problem,
    Transitions,
    make_memory,
)
from teleop_drake.engine.program import Program
from teleop_drake.engine.random_sources import Draw, TakeDraws
from teleop_drake.engine.transitions import next_time
from teleop_drake.jit.native import Evaluate, Packed
from teleop_drake.jit.typed_code import CompileTyped
from teleop_drake.jit.typed_values import EVALUATE, TypeOf
from teleop_drake.kernel import Delay, Packet
from teleop_drake.kernel.packet_line import PacketsUntil
from teleop_drake.numerics.instants import SAME
from teleop_drake.numerics.piecewise import NUM_COEFFICIENTS, Pieces, fit_pieces
from teleop_drake.numerics.step_polynomials import steps_of

_NO_PIECES = Pieces(np.empty((0, 2)), np.empty((0, NUM_COEFFICIENTS)))

# Rows for which there is memory at first. What is not written takes none.
_ROOM = 32768

# The room of a run whose states are compared with Drake: where it has no more, a state
# is seen that a short run comes through.
_FIRST_ROOM = 64

# Rows that a run keeps of which only samples are wanted.
_MOST_KEPT = 2048

# What the integrator tries at least, s.
_SHORTEST = 1e-14

# How many of the states where a run has been are kept, the last one among them.
_MAX_VISITED = 4


class Visited(NamedTuple):
    """Where a run has been.

    Attributes:
        t: The time in s.
        x: Continuous state.
        m: Discrete state.
        y: Signals, among them what came out of delays.
    """

    t: float
    x: Array
    m: Array
    y: Array


class CompiledRun:
    """A run of a diagram.

    Args:
        evaluator: Of the diagram, in Python or in machine code.
        context: Where it starts.
        start: The same, instead of the context.
        past: What was sent through the delays before.
        system: What is integrated, of MakeProblem(); None: it is made.
        end: Until when it can run, s.
        accuracy: What a step may be wrong by in the largest of all states, as Drake's
            integrators have it.
        max_step: Longest step in s.
        is_checked: Whether nobody needs a state that a short run comes through, because
            the code has been compared with Drake before.

    Attributes:
        evaluator: Of the diagram.
        problem: What is integrated.
        memory: Where it is.
        start: Where it started.
        failure: Why it cannot go on; empty if it can.
        error: What was raised in the midst of a step, after which it cannot go on.
        visited: Where it has been, a few times.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        context: Context | None,
        *,
        start: Visited | None = None,
        past: Past | None = None,
        system: Packed | None = None,
        end: float,
        accuracy: float,
        max_step: float,
        is_checked: bool = False,
        draws: Iterable[Draw] = (),
    ):
        if start is None:
            assert context is not None
            start = Visited(context.get_time(), *evaluator.ReadContext(context))
            past = ReadPast(evaluator, context, start.y)
            draws = TakeDraws(evaluator, context.Clone(), end)
        self.evaluator = evaluator
        self.start = start
        self.failure = ""
        self.error: Exception | None = None
        self.visited: list[Visited] = []
        self.draws = deque(draws)
        self._accuracy = accuracy
        self._max_step = max_step
        system = system or MakeProblem(evaluator.program, start.t, end)
        self.problem: Problem = system.value
        # The first row of this run, behind those of the past.
        self._first_row = 0 if past is None else len(past.times)
        self.memory = make_memory(
            self.problem,
            x=start.x.copy(),
            m=start.m.copy(),
            y=start.y.copy(),
            time=start.t,
            past=past,
            first_step=0.1 * max_step,
            room=self._first_row + (_ROOM if is_checked else _FIRST_ROOM),
        )
        self._integrate: Callable[..., Any] = advance
        # What the integrator takes: tuples or, in machine code, their headers.
        self._system: Any = self.problem
        self._memory: Any = self.memory
        if isinstance(evaluator.function, Evaluate):
            self._integrate = _CompiledAdvance(self.problem, self.memory)
            self._system = system
            self._memory = Packed(self.memory)

    @property
    def time(self) -> float:
        """How far the run is, in s."""
        return float(self.memory.clock[0])

    @property
    def next_time(self) -> float:
        """The time in s from which another run goes on.

        An event that is due at the end, but for rounding, has not happened. If Drake
        rounds its time to one before the end, it is that time.
        """
        transitions = self.problem.transitions
        ticks = range(len(self.memory.ticks))
        due = [next_time(k, transitions, self.memory) for k in ticks]
        due += [draw.time for draw in self.draws]
        return min([self.time, *due])

    @property
    def is_finite(self) -> bool:
        """Whether all numbers are that it computed last."""
        memory = self.memory
        states = memory.x, memory.x_stage, memory.x_next, *memory.stages
        return bool(np.isfinite(states).all())

    def Advance(self, end: float) -> Array:
        """Integrates for a while; returns the signals y (k, num_y) of the new rows.

        The run has ended if its time is `end` or there is a failure or an error.

        Args:
            end: Where to stop at the latest, s.
        """
        memory = self.memory
        if is_full(self.problem.delays, memory):
            memory = self._MakeRoom()
        first = int(memory.counts[ROWS])
        drawn = self.draws[0].time if self.draws else math.inf
        is_drawn = drawn < end - SAME
        stop = drawn if is_drawn else float(end)
        numbers = stop, self._accuracy, self._max_step
        status = DONE
        try:
            function = self.evaluator.function
            status = self._integrate(function, self._system, self._memory, *numbers)
        except Exception as error:  # noqa: BLE001 - A law may raise anything.
            if not self._MakesStepShorter(error):
                self.error = error
        rows = memory.rows[first : int(memory.counts[ROWS])]
        if len(rows):
            visited = self.time, memory.x.copy(), memory.m.copy(), rows[-1]
            self.visited[_MAX_VISITED - 1 :] = [Visited(*visited)]
        if is_drawn and self.time > drawn - SAME:
            self._TakeDraws(drawn)
        if status == STUCK:
            # In the words of Drake.
            self.failure = (
                "Error control wants to select step smaller than minimum allowed "
                f"({1e-14 * max(1.0, abs(self.time)):g})"
            )
        return rows

    def Feed(self, place: slice, values: Array) -> None:
        """Sets what an open input is fed with from now on: signals jump, a step ends.

        Args:
            place: Of the input in y, as Program.fed has it.
        """
        self.memory.y[place] = values
        self._AddBreak()

    def _TakeDraws(self, time: float) -> None:
        """Sets the random outputs that change now, at a time in s."""
        while self.draws and self.draws[0].time < time + SAME:
            draw = self.draws.popleft()
            self.memory.m[draw.place] = draw.value
        self._AddBreak()

    def _AddBreak(self) -> None:
        """Adds a break now, because signals jump."""
        counts = self.memory.counts
        self.memory.breaks[counts[BREAKS]] = self.time, 0.0
        counts[BREAKS] += 1

    def Sample(self, time: float) -> Array:
        """Integrates until a time in s; returns the signals y then.

        Keeps no rows but those that delays still need.

        At the very start they are those before what happens there.

        Raises:
            ArithmeticError: If it cannot go on.
        """
        sample = None
        while sample is None or self.time < time - SAME:
            rows = self.Advance(time)
            if self.failure or self.error is not None:
                raise ArithmeticError(self.failure or self.error)
            if len(rows):
                sample = rows[0 if time == self.start.t else -1].copy()
        if self.memory.counts[ROWS] > _MOST_KEPT:
            self._ForgetRows()
        return sample

    def Rows(self) -> tuple[Array, Array]:
        """Returns the times (k) and the signals y (k, num_y) of all rows so far.

        A time that stands twice marks a jump.
        """
        part = slice(self._first_row, self.memory.counts[ROWS])
        return self.memory.row_times[part], self.memory.rows[part]

    def Steps(self) -> Indices:
        """Returns the rows of each step so far (s, 5)."""
        part = slice(self._first_row, self.memory.counts[ROWS])
        return steps_of(self.memory.row_ends[part])

    def _MakesStepShorter(self, error: Exception) -> bool:
        """Rejects the step that has raised an error; returns whether it was too long.

        Args:
            error: If it is of numbers, then the state that was tried may be to blame.
        """
        is_of_numbers = isinstance(error, ArithmeticError | np.linalg.LinAlgError)
        clock = self.memory.clock
        if not (is_of_numbers or not self.is_finite):
            return False
        clock[1] *= 0.1
        return bool(clock[1] > _SHORTEST * max(1.0, self.time))

    def _MakeRoom(self) -> Memory:
        """Makes twice the room for rows and breaks, or more; returns the memory."""
        larger = {}
        for name in ("row_times", "row_ends", "rows", "breaks"):
            array = getattr(self.memory, name)
            # What is not written yet takes no memory.
            length = max(2 * len(array), _ROOM)
            larger[name] = np.empty((length, *array.shape[1:]), array.dtype)
            larger[name][: len(array)] = array
        self.memory = self.memory._replace(**larger)
        if isinstance(self._memory, Packed):
            self._memory = Packed(self.memory)
        else:
            self._memory = self.memory
        return self.memory

    def _ForgetRows(self) -> None:
        """Removes the rows that no delay reaches."""
        memory = self.memory
        delays = self.problem.delays
        reached = self.time
        for d, time in enumerate(delays.times):
            if np.isfinite(time):
                delay = delay_at(self.time, d, delays)
                reached = min(reached, self.time - delay)
            elif delays.packet_ranges[d, 0] < memory.next_packets[d]:
                # Those that are shown later were sent later.
                _, sent, previous = delays.packets[memory.next_packets[d] - 1]
                reached = min(reached, previous if np.isfinite(previous) else sent)
            else:
                reached = -np.inf
        counts = memory.counts
        num = counts[ROWS]
        # Two steps have ten rows at most.
        first = max(int(np.searchsorted(memory.row_times[:num], reached)) - 10, 0)
        for array in (memory.row_times, memory.row_ends, memory.rows):
            array[: num - first] = array[first:num].copy()
        counts[ROWS] -= first
        counts[END] -= first
        self._first_row = max(0, self._first_row - first)


# The integrator in machine code, once it is made.
_advance: list[Callable[..., int]] = []


def _CompiledAdvance(system: Problem, memory: Memory) -> Callable[..., int]:
    """Returns the integrator in machine code, which is that of all diagrams.

    Args:
        system: Any system, and its memory: they have the types of all others.
    """
    if not _advance:
        types = map(TypeOf, (system, memory, 0.0, 0.0, 0.0))
        _advance.append(CompileTyped(advance, (EVALUATE, *types)))
    return _advance[0]


def MakeProblem(program: Program, start: float, end: float) -> Packed:
    """Returns what is integrated between two times in s, a Problem."""
    delays = _Delays(program, start, end)
    return Packed(Problem(program.p, delays, _Transitions(program)))


def _Delays(program: Program, start: float, end: float) -> Delays:
    delays = [delay for delay, _, _ in program.delays]
    packets = [np.reshape(_Packets(delay, end), (-1, 3)) for delay in delays]
    pieces = [_PiecesOf(delay, start, end) for delay in delays]
    times = [
        _Shortest(x) if callable(delay.time) else delay.time
        for delay, x in zip(delays, pieces, strict=True)
    ]
    rows = [
        (signal.start, output.start, output.stop - output.start)
        for _, signal, output in program.delays
    ]
    signals, outputs, sizes = np.array(rows, np.int64).reshape(-1, 3).T.copy()
    return Delays(
        times=np.array(times, float),
        signals=signals,
        outputs=outputs,
        sizes=sizes,
        packet_ranges=_Ranges(packets),
        packets=np.concatenate([np.empty((0, 3)), *packets]),
        piece_ranges=_Ranges([x.knots for x in pieces]),
        knots=np.concatenate([x.knots for x in (_NO_PIECES, *pieces)]),
        coefficients=np.concatenate([x.coefficients for x in (_NO_PIECES, *pieces)]),
    )


def _PiecesOf(delay: Delay, start: float, end: float) -> Pieces:
    """Returns a delay that varies as polynomials; none of any other."""
    if not callable(delay.time):
        return _NO_PIECES
    # What is sent at the end arrives later, in the run that continues this one.
    last = min(end + 2 * delay.time(end), delay.end)
    return fit_pieces(delay.time, start, last, nonsmooth_times=delay.nonsmooth_times)


def _Ranges(groups: Sequence[Sized]) -> Indices:
    """Returns where each group begins and ends if they stand one after another."""
    ends = np.cumsum([0, *map(len, groups)], dtype=np.int64)
    return np.stack([ends[:-1], ends[1:]], axis=1)


def _Packets(delay: Delay, end: float) -> Sequence[Packet]:
    """Returns the packets of a delay; for nobody where T(t) is not smooth."""
    if delay.shown is not None:
        return PacketsUntil(delay, end)
    return [Packet(shown=t, sent=t) for t in sorted(delay.nonsmooth_times) if t <= end]


def _Shortest(pieces: Pieces) -> float:
    """Returns the shortest of a delay that varies, or a little less."""
    at = np.vander(np.linspace(-1.0, 1.0, 17), NUM_COEFFICIENTS, increasing=True)
    return 0.99 * float((pieces.coefficients @ at.T).min())


def _Transitions(program: Program) -> Transitions:
    rows = [
        (
            guard.start if guard else -1,
            source.start,
            target.start,
            target.stop - target.start,
            transition.period,
            np.inf if guard else transition.offset,
            transition.is_discrete,
        )
        for transition, guard, source, target in program.transitions
    ]
    kinds = (*[np.int64] * 4, *[np.float64] * 2, np.int64)
    columns: Any = np.array(rows, float).reshape(-1, len(kinds)).T
    return Transitions(*(x.astype(k) for x, k in zip(columns, kinds, strict=True)))
