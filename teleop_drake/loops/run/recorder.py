"""The sampler of a run in Drake's Simulator."""

import math
import time as clock
from array import array
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from pydrake.systems.framework import Context, EventStatus, OutputPort, System

from teleop_drake.loops.framework.arrays import Array, Flags
from teleop_drake.loops.numerics.instants import SAME, SAME_SHARE, same_within
from teleop_drake.loops.numerics.step_polynomials import DEGREE, Series
from teleop_drake.loops.run.bends import CHECKED, INSIDE
from teleop_drake.loops.run.following import Following, Moving, Rows
from teleop_drake.loops.run.moving import Motion
from teleop_drake.loops.run.readings import Readings
from teleop_drake.loops.run.run import Interruption

# Samples of held signals are checked after about so many s of real time, and after so
# many samples at the latest.
_CHECK_PERIOD = 0.05
_MOST_UNCHECKED = 256

# The instants at which the first steps are looked at, as shares of their lengths, and
# the number of these steps.
_LOOKED_AT = (*INSIDE, CHECKED)
_FIRST_STEPS = 8

# The golden section, whose multiples are spread evenly between whole numbers.
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


class Recorder:
    """A sampler of the signals of a diagram, step by step.

    Signals that are known to be held within a step are sampled at its end. Those that
    may move within a step are followed there, too; see Following.

    Many blocks only seem to depend on time. In a system without continuous states, the
    signals that may move are looked at in full within the first steps, and at one
    instant within each later one. Each is taken to be held until it is seen to move.

    Attributes:
        names: The names of the signals.
        columns: The slice of a sample that belongs to each signal, in the same order.
        is_held: Whether no signal may move within a step; known from the first sample.
        time: The time of the last sample, s.

    Args:
        diagram: The simulated System.
        signals: The output port of each signal, by name.
        root_context: The Context of the Simulator.
        due: The instants of the rows that are asked for, s; None: all of them.
    """

    def __init__(
        self,
        diagram: System,
        signals: Mapping[str, OutputPort],
        root_context: Context,
        due: Array | None = None,
    ):
        self.names = list(signals)
        self._has_states = root_context.num_continuous_states() > 0
        # Without continuous states, the run can stop at each of these instants.
        self.is_held = due is not None and not self._has_states
        self.time = math.inf
        self._sizes = [port.size() for port in signals.values()]
        ends = np.cumsum([0, *self._sizes]).tolist()
        self.columns = [slice(*ends_of) for ends_of in pairwise(ends)]
        # Ports without elements need no evaluation.
        self._ports = [
            (i, port) for i, port in enumerate(signals.values()) if self._sizes[i] > 0
        ]
        self._readings = Readings([port for _, port in self._ports], root_context)
        self._diagram = diagram
        self._root_context = root_context
        self._motion: Motion | None = None
        # The signals that are followed.
        self._moving: list[Moving] = []
        self._following: Following | None = None
        # Those that are looked at, with their values within a step and at its end.
        self._still: list[Moving] = []
        self._inside = Readings((), root_context)
        self._at_end: list[memoryview] = []
        self._looks = not self.is_held
        self._num_looks = 0
        # The rows ahead that are asked for, and whether there is none in the last step.
        self._due = deque(due.tolist() if due is not None and self._has_states else ())
        self._has_passed = False
        # The ends of steps in which no signal moves.
        self._times = array("d")
        self._samples: list[bytes] = []
        self._bent: set[int] = set()
        self._unresolved: set[int] = set()

    def Sample(self) -> bytes:
        """Samples the end of a step, and what moves within; returns the sample.

        It has eight bytes for each element, or none if nobody asks for rows of the
        step. The first sample is that of the start.
        """
        following = self._following
        if following is not None and self._due and self._Passes(following):
            return b""
        self._has_passed = False
        sample = self._readings.Read()
        begin = self.time
        time = self.time = self._root_context.get_time()
        if self._looks:
            self._Look(begin, time)
        if self._following is None:
            self._times.append(time)
            self._samples.append(sample)
        else:
            self._following.Add(time, sample)
        return sample

    def HeldMonitor(
        self,
        check: Callable[[float], EventStatus | None],
        until: float,
        interruption: Interruption,
    ) -> Callable[[Context], EventStatus | None]:
        """Returns a monitor that takes the samples from now on, of held signals.

        It does what Sample() does, in half the time: a discrete system takes steps of
        microseconds.

        Args:
            check: What is called with the time after some samples, and at once after an
                interruption. It returns what the monitor returns.
            until: The time in s from which on it is called at once.
            interruption: The handler of Ctrl-C.
        """
        readers = self._readings.readers
        memory = self._readings.memory
        join = b"".join
        get_time = self._root_context.get_time
        append_time = self._times.append
        append_sample = self._samples.append
        is_quiet = _AreQuiet()

        def Monitor(_: Context) -> EventStatus | None:
            for evaluate, context in readers:
                evaluate(context)
            append_sample(join(memory))
            time = get_time()
            append_time(time)
            if time < until and next(is_quiet) and not interruption.has_come:
                return None
            return check(time)

        return Monitor

    @property
    def num_samples(self) -> int:
        """The number of samples of held signals."""
        return len(self._samples)

    def AreNumbers(self, first: int) -> bool:
        """Returns whether no sample of held signals is NaN, from an index on."""
        later = b"".join(self._samples[first:])
        return not np.isnan(np.frombuffer(later)).any()

    def CatchUp(self) -> None:
        """Records the steps that wait for the rows within them."""
        if self._following is None:
            return
        if self._has_passed:
            self._following.Add(self.time, self._readings.Read())
        self._following.CatchUp()

    def _Passes(self, following: Following) -> bool:
        """Passes a step in which no row is asked for; returns whether it is one."""
        time = self._root_context.get_time()
        soon = time + same_within(time)
        is_due = self._due[0] <= soon
        while self._due and self._due[0] <= soon:
            self._due.popleft()
        if is_due or not following.Pass(time):
            return False
        self.time = time
        self._has_passed = True
        return True

    def _Look(self, begin: float, end: float) -> None:
        """Looks at a step for signals that move in it, and begins to follow them.

        Args:
            begin: The time of the beginning, s.
            end: The time of the end, s.
        """
        if self._motion is None:
            self._motion = self._FindMoving()
        elif end > begin + same_within(end):
            found = self._Seen(self._motion, begin, end)
            if found:
                self._Follow(self._motion, found)

    def _FindMoving(self) -> Motion:
        """Finds the signals that may move within a step, at the first sample."""
        motion = Motion(self._diagram, self._root_context)
        found = [
            Moving(
                signal=i,
                port=port,
                place=self.columns[i],
                is_affine=motion.IsAffine(port),
                is_opaque=motion.DependsOnAbstract(port),
            )
            for i, port in self._ports
            if motion.Moves(port)
        ]
        self._readings.EvaluateOnly(motion.Readers([port for _, port in self._ports]))
        self.is_held = not found
        if found and self._has_states:
            self._Follow(motion, found)
        else:
            self._Watch(motion, found)
        return motion

    def _Watch(self, motion: Motion, still: list[Moving]) -> None:
        """Looks at signals from now on, and at no others."""
        self._still = still
        self._looks = bool(still)
        self._inside = motion.ReadingsOf([x.port for x in still])
        self._at_end = self._MemoryOf({x.signal for x in still})

    def _Follow(self, motion: Motion, found: Sequence[Moving]) -> None:
        """Follows signals from now on, with those that are followed already."""
        self.CatchUp()
        self._Watch(motion, [x for x in self._still if x not in found])
        self._moving += found
        moving = {x.signal for x in self._moving}
        self._bent |= self._following.bent if self._following else set()
        self._unresolved |= self._following.unresolved if self._following else set()
        self._following = Following(
            motion,
            self._root_context,
            self._sizes,
            self._moving,
            self._MemoryOf({i for i, _ in self._ports} - moving),
            self._Rows(DEGREE),
        )

    def _MemoryOf(self, signals: Collection[int]) -> list[memoryview]:
        """Returns the values of signals at the last sample, from their indices."""
        memory = zip(self._ports, self._readings.memory, strict=True)
        return [values for (i, _), values in memory if i in signals]

    def _Seen(self, motion: Motion, begin: float, end: float) -> list[Moving]:
        """Returns the signals that are seen to move in a step.

        After the first steps this looks at one instant, which differs from step to
        step, so that it does not keep time with a signal whose period is that of the
        steps.

        Args:
            begin: The time of the beginning, s.
            end: The time of the end, s.
        """
        motion.context.SetTimeStateAndParametersFrom(self._root_context)
        self._num_looks += 1
        if self._num_looks <= _FIRST_STEPS:
            times = [begin + share * (end - begin) for share in _LOOKED_AT]
            found = {i for time in times for i in self._Differing(motion, time)}
        else:
            once = (self._num_looks * _GOLDEN) % 1.0
            found = self._Differing(motion, begin + once * (end - begin))
            if found:
                # Those that are back at the end may have moved in earlier steps, too.
                back = found - self._Differing(motion, begin)
                self._bent |= back
                self._unresolved |= back
        return [x for x in self._still if x.signal in found]

    def _Differing(self, motion: Motion, time: float) -> set[int]:
        """Returns the signals that are not at a time in s what they are at the end."""
        motion.context.SetTime(time)
        if self._inside.Read() == b"".join(self._at_end):
            return set()
        values = zip(self._still, self._inside.memory, self._at_end, strict=True)
        return {signal.signal for signal, inside, at_end in values if inside != at_end}

    def Bent(self) -> set[str]:
        """Returns the names of the signals that jump or bend within a step."""
        bent = self._following.bent if self._following else set()
        return {self.names[i] for i in self._bent | bent}

    def Unresolved(self) -> set[str]:
        """Returns the names of those that are not accurate there."""
        unresolved = self._following.unresolved if self._following else set()
        return {self.names[i] for i in self._unresolved | unresolved}

    def Finish(self) -> Series:
        """Returns the times (N,), the signals (N, k) and the steps.

        A held signal is a straight line within a step.
        """
        degree = DEGREE if self._following else 1
        times, rows, ends = self._Rows(degree)
        signals = {
            name: rows[:, place]
            for name, place in zip(self.names, self.columns, strict=True)
        }
        return times, signals, ends[:, np.newaxis] + np.arange(-degree, 1)

    def _Rows(self, degree: int) -> Rows:
        """Returns the rows so far.

        If no signal is followed, each may jump at the beginning of a step only.

        Args:
            degree: The degree of the polynomials of steps.
        """
        if self._following:
            return self._following.Rows()
        times = np.array(self._times)
        samples = np.frombuffer(b"".join(self._samples))
        samples = samples.reshape(len(times), sum(self._sizes))
        last = np.append(np.inf, times[:-1])
        is_later = times > last + np.maximum(SAME, SAME_SHARE * np.abs(times))
        is_step = is_later & ~_AnyInRow(~np.isfinite(samples))
        jumps = is_step & np.append(False, _AnyInRow(samples[1:] != samples[:-1]))
        # A step has a row at its beginning if there is a jump, those inside, and the
        # one at its end.
        counts = 1 + (degree - 1) * is_step + jumps
        ends = np.cumsum(counts) - 1
        sources = np.repeat(np.arange(len(times)), counts)
        before_end = ends[sources] - np.arange(len(sources))
        share = 1.0 - before_end / degree
        begin = np.where(before_end > 0, last[sources], times[sources])
        rows_at = begin + share * (times[sources] - begin)
        return rows_at, samples.take(sources, axis=0), ends[is_step]


def _AreQuiet() -> Iterator[bool]:
    """Yields for each sample of held signals whether it needs no check."""
    count = 1
    while True:
        begin = clock.monotonic()
        for _ in range(count - 1):
            yield True
        yield False
        taken = clock.monotonic() - begin
        # The next check is due after as many samples as there are in the period.
        fitting = int(count * _CHECK_PERIOD / max(taken, 1e-9))
        count = min(max(fitting, 1), 4 * count, _MOST_UNCHECKED)


def _AnyInRow(values: Flags) -> Flags:
    """Returns np.any(values, axis=1), which takes ten times as long in short rows."""
    return values @ np.ones(values.shape[1], dtype=bool)
