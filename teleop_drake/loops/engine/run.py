"""Runs of a program: the start, the calls of advance() and the recorded rows."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence, Sized
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pydrake.systems.framework import Context

from teleop_drake.loops.engine.advance import DONE, REFUSED, STUCK, advance, is_full
from teleop_drake.loops.engine.delays import delay_at
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.past import ReadPast
from teleop_drake.loops.engine.problem import (
    BREAKS,
    END,
    FIRST,
    ROWS,
    Delays,
    Memory,
    Past,
    Problem,
    Steering,
    Transitions,
    make_memory,
)
from teleop_drake.loops.engine.program import Program
from teleop_drake.loops.engine.transitions import next_time
from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.loops.jit.native import Evaluate, Packed
from teleop_drake.loops.jit.typed_code import CompileTyped
from teleop_drake.loops.jit.typed_values import EVALUATE, TypeOf
from teleop_drake.loops.kernel import Delay, Packet
from teleop_drake.loops.kernel.packet_line import PacketsBetween
from teleop_drake.loops.kernel.steered_line import RefusalOfDelay
from teleop_drake.loops.numerics.instants import SAME
from teleop_drake.loops.numerics.piecewise import NUM_COEFFICIENTS, Pieces, fit_pieces
from teleop_drake.loops.numerics.step_polynomials import steps_of

if TYPE_CHECKING:
    from teleop_drake.loops.engine.random_sources import Draw

_NO_PIECES = Pieces(np.empty((0, 2)), np.empty((0, NUM_COEFFICIENTS)))

# The number of rows with memory at first. Rows that are not written take no memory.
_ROOM = 32768

# The number of rows at first if the states are compared with Drake. When it is used up,
# the present state is stored in `visited`, so that a short run has some of them.
_FIRST_ROOM = 64

# The most rows stored by a run of which only samples are used.
_MOST_KEPT = 2048

# The shortest step that is tried, s.
_SHORTEST = 1e-14

# The number of visited states that a run stores; the last one is among them.
_MAX_VISITED = 4


class Visited(NamedTuple):
    """A state in which a run has been.

    Attributes:
        t: The time in s.
        x: The continuous states of the program.
        m: The discrete states of the program.
        y: The signals, including the outputs of delays.
    """

    t: float
    x: Array
    m: Array
    y: Array


class CompiledRun:
    """A run of a program, which Advance() continues.

    Args:
        evaluator: Evaluates the program, interpreted or compiled.
        context: The Context of the diagram at the start. None: `start`, `past` and
            `draws` describe the start.
        start: The time, states and signals at the start.
        past: The signals in the delays before the start; None: no signals.
        system: The Problem, from MakeProblem(). None: it is made.
        end: The last time that the run may reach, s.
        accuracy: The largest error of a step in any state, as for Drake's integrators.
        max_step: The longest step in s.
        is_checked: Whether the code has been compared with Drake before. Otherwise, the
            run stores a state early, so that a short run has one to compare.
        draws: The new outputs of random sources, in their order.

    Attributes:
        evaluator: Evaluates the program.
        problem: The delays, transitions and parameters of the program.
        memory: The present state and the recorded rows.
        start: The time, states and signals at the start.
        failure: The reason why the run cannot continue; empty if it can.
        error: The exception that a law raised within a step; the run cannot continue.
        visited: Some states of the run.
        draws: The draws that have not been taken yet.
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
        draws: "Iterable[Draw]" = (),
    ):
        if start is None:
            assert context is not None
            start = Visited(context.get_time(), *evaluator.ReadContext(context))
            past = ReadPast(evaluator, context, start.y)
            from teleop_drake.loops.engine.random_sources import TakeDraws

            draws = TakeDraws(evaluator, context.Clone(), end)
        self.evaluator = evaluator
        self.start = start
        self.failure = ""
        self.error: Exception | None = None
        self.visited: list[Visited] = []
        self.draws = deque(draws)
        self._accuracy = accuracy
        self._max_step = max_step
        system = system or MakeProblem(evaluator.program, start.t, end, past)
        self.problem: Problem = system.value
        # The first row of this run, after those of the past.
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
        # The integrator's arguments: tuples or, for machine code, their headers.
        self._system: Any = self.problem
        self._memory: Any = self.memory
        if isinstance(evaluator.function, Evaluate):
            self._integrate = _CompiledAdvance(self.problem, self.memory)
            self._system = system
            self._memory = Packed(self.memory)

    @property
    def time(self) -> float:
        """The present time of the run, s."""
        return float(self.memory.clock[0])

    @property
    def next_time(self) -> float:
        """The time in s at which another run continues this one.

        It is the present time, unless Drake rounds the time of an event that is due now
        to an earlier time. The event has not happened yet, so it is then that time.
        """
        transitions = self.problem.transitions
        ticks = range(len(self.memory.ticks))
        due = [next_time(k, transitions, self.memory) for k in ticks]
        return min([self.time, *due])

    @property
    def is_finite(self) -> bool:
        """Whether all states and rates of the last step are finite."""
        memory = self.memory
        states = memory.x, memory.x_stage, memory.x_next, *memory.stages
        return bool(np.isfinite(states).all())

    def Advance(self, end: float) -> Array:
        """Integrates some steps; returns the signals y (k, num_y) of the new rows.

        The run has ended if its time is `end`, or if there is a failure or an error.

        Args:
            end: The latest time at which to stop, s.
        """
        memory = self.memory
        if is_full(self.problem.delays, memory):
            memory = self._MakeRoom()
        first = int(memory.counts[ROWS])
        self._TakeDraws()
        drawn = self.draws[0].time if self.draws else math.inf
        numbers = min(drawn, float(end)), self._accuracy, self._max_step
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
        if status == REFUSED:
            self.error = self._Refusal()
        if status == STUCK:
            # The message of Drake.
            self.failure = (
                "Error control wants to select step smaller than minimum allowed "
                f"({1e-14 * max(1.0, abs(self.time)):g})"
            )
        return rows

    def _Refusal(self) -> ScenarioError:
        """Returns the error of a delay that is a signal outside of its range."""
        steering = self.problem.delays.steering
        row = self.memory.rows[self.memory.counts[ROWS] - 1]
        times = row[steering.controls]
        is_time = steering.lengths == 0
        k = int(np.argmax(is_time & ((times < -SAME) | (times > steering.longest))))
        paths = [
            block.path
            for block, kernel in zip(
                self.evaluator.blocks, self.evaluator.program.kernels, strict=True
            )
            for _ in kernel.delays
        ]
        path = paths[steering.delays[k]]
        return RefusalOfDelay(path, times[k], steering.longest[k], self.time)

    def Feed(self, place: slice, values: Array) -> None:
        """Sets the value of an unconnected input from now on; signals jump.

        Args:
            place: The slice of y of the input, see Program.fed.
            values: The new value of the input.
        """
        self.memory.y[place] = values
        counts = self.memory.counts
        self.memory.breaks[counts[BREAKS]] = self.time, 0.0
        counts[BREAKS] += 1

    def _TakeDraws(self) -> None:
        """Writes the random outputs that change now, before their updates execute."""
        while self.draws and self.draws[0].time < self.time + SAME:
            draw = self.draws.popleft()
            self.memory.y[draw.place] = draw.value

    def Sample(self, time: float) -> Array:
        """Integrates until a time in s; returns the signals y at that time.

        At the start, they are the signals before the events of that instant. Rows are
        deleted if no delay needs them.

        Raises:
            ArithmeticError: If the run cannot continue.
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

        Two rows with the same time mark a jump.
        """
        part = slice(self._first_row, self.memory.counts[ROWS])
        return self.memory.row_times[part], self.memory.rows[part]

    def Steps(self) -> Indices:
        """Returns the indices of the rows of each step so far (s, 5)."""
        part = slice(self._first_row, self.memory.counts[ROWS])
        return steps_of(self.memory.row_ends[part])

    def _MakesStepShorter(self, error: Exception) -> bool:
        """Shortens the step in which an error was raised; returns whether to repeat it.

        An arithmetic error, or a state that is not finite, may be the result of a step
        that was too long. Any other error is one of the law itself.
        """
        is_of_numbers = isinstance(error, ArithmeticError | np.linalg.LinAlgError)
        clock = self.memory.clock
        if not (is_of_numbers or not self.is_finite):
            return False
        clock[1] *= 0.1
        return bool(clock[1] > _SHORTEST * max(1.0, self.time))

    def _MakeRoom(self) -> Memory:
        """Doubles the room for rows and breaks, or more; returns the memory."""
        larger: dict[str, Any] = {}
        for name in ("row_times", "row_ends", "rows", "breaks"):
            larger[name] = _Enlarged(getattr(self.memory, name))
        steered = self.memory.steered
        if steered is not None:
            larger["steered"] = steered._replace(jumps=_Enlarged(steered.jumps))
        self.memory = self.memory._replace(**larger)
        if isinstance(self._memory, Packed):
            self._memory = Packed(self.memory)
        else:
            self._memory = self.memory
        return self.memory

    def _ForgetRows(self) -> None:
        """Deletes the rows that no delay needs any more."""
        memory = self.memory
        delays = self.problem.delays
        reached = self.time
        for d, time in enumerate(delays.times):
            if np.isfinite(time):
                delay = delay_at(self.time, d, delays)
                reached = min(reached, self.time - delay)
            elif delays.packet_ranges[d, 0] < memory.next_packets[d]:
                # Packets that are shown later were sent later.
                _, sent, previous = delays.packets[memory.next_packets[d] - 1]
                reached = min(reached, previous if np.isfinite(previous) else sent)
            else:
                reached = -np.inf
        counts = memory.counts
        num = counts[ROWS]
        # Keep two more steps, which have ten rows at most.
        first = max(int(np.searchsorted(memory.row_times[:num], reached)) - 10, 0)
        for array in (memory.row_times, memory.row_ends, memory.rows):
            array[: num - first] = array[first:num].copy()
        counts[ROWS] -= first
        counts[END] -= first
        counts[FIRST] = max(0, counts[FIRST] - first)
        self._first_row = max(0, self._first_row - first)


def _Enlarged(array: Array) -> Array:
    """Returns an array with twice the room, or more, that begins with another one."""
    # Elements that are not written yet take no memory.
    length = max(2 * len(array), _ROOM)
    larger = np.empty((length, *array.shape[1:]), array.dtype)
    larger[: len(array)] = array
    return larger


# The compiled integrators after their first use, by whether there are delays whose time
# is a signal.
_advance: dict[bool, Callable[..., int]] = {}


def _CompiledAdvance(system: Problem, memory: Memory) -> Callable[..., int]:
    """Returns the compiled integrator; the same code integrates all such programs.

    Args:
        system: The problem of any program; the types of its arrays are compiled.
        memory: The memory of that problem, for the same reason.
    """
    is_steered = memory.steered is not None
    if is_steered not in _advance:
        types = map(TypeOf, (system, memory, 0.0, 0.0, 0.0))
        _advance[is_steered] = CompileTyped(advance, (EVALUATE, *types))
    return _advance[is_steered]


def MakeProblem(
    program: Program, start: float, end: float, past: Past | None = None
) -> Packed:
    """Returns the Problem of a program for a run between two times in s.

    Args:
        past: The signals in the delays before the start; None: no signals.
    """
    # Packets sent before the start are those of the past.
    begin = start if past is None else float(past.times[0])
    delays = _Delays(program, start, end, begin)
    return Packed(Problem(program.p, delays, _Transitions(program)))


def _Delays(program: Program, start: float, end: float, begin: float) -> Delays:
    """Returns the delays of a run; `begin` is the time of the first packet sent, s."""
    delays = [delay for delay, _, _ in program.delays]
    packets = [np.reshape(_Packets(delay, begin, end), (-1, 3)) for delay in delays]
    pieces = [_PiecesOf(delay, start, end) for delay in delays]
    times = [_Time(delay, x) for delay, x in zip(delays, pieces, strict=True)]
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
        steering=_Steering(program),
    )


def _Time(delay: Delay, pieces: Pieces) -> float:
    """Returns the time of a delay in Delays.times, s."""
    if isinstance(delay.time, str):
        return math.inf
    return _Shortest(pieces) if callable(delay.time) else delay.time


def _Steering(program: Program) -> Steering:
    """Returns the delays of a program whose time is a signal."""
    # The position is read from the signal, whose past is known.
    found = [
        (d, signal.stop - 1 if delay.length > 0 else place.start, delay)
        for d, ((delay, signal, _), place) in enumerate(
            zip(program.delays, program.controls, strict=True)
        )
        if place is not None
    ]
    return Steering(
        delays=np.array([d for d, _, _ in found], np.int64),
        controls=np.array([place for _, place, _ in found], np.int64),
        lengths=np.array([delay.length for _, _, delay in found], float),
        longest=np.array([delay.longest for _, _, delay in found], float),
    )


def _PiecesOf(delay: Delay, start: float, end: float) -> Pieces:
    """Returns a varying delay as piecewise polynomials; no pieces if it is constant."""
    if not callable(delay.time):
        return _NO_PIECES
    # A signal sent at the end arrives later, in the run that continues this one.
    last = min(end + 2 * delay.time(end), delay.end)
    return fit_pieces(delay.time, start, last, nonsmooth_times=delay.nonsmooth_times)


def _Ranges(groups: Sequence[Sized]) -> Indices:
    """Returns begin and end of each group in the concatenation of all (d, 2)."""
    ends = np.cumsum([0, *map(len, groups)], dtype=np.int64)
    return np.stack([ends[:-1], ends[1:]], axis=1)


def _Packets(delay: Delay, begin: float, end: float) -> Sequence[Packet]:
    """Returns the packets of a delay.

    A varying delay has one at each nonsmooth point, which only makes a step end there.
    """
    if delay.shown is not None:
        return PacketsBetween(delay, begin, end)
    return [Packet(shown=t, sent=t) for t in sorted(delay.nonsmooth_times) if t <= end]


def _Shortest(pieces: Pieces) -> float:
    """Returns a lower bound of a varying delay, close to its minimum, s."""
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
