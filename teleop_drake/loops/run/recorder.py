"""The sampler of a run in Drake's Simulator."""

import math
from array import array
from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np
from pydrake.systems.framework import Context, OutputPort, System

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.numerics.instants import SAME, SAME_SHARE, same_within
from teleop_drake.loops.numerics.step_polynomials import DEGREE, Series
from teleop_drake.loops.run.affine import HERMITE, Affine, Ends, Moving
from teleop_drake.loops.run.bends import CHECKED, INSIDE, Bends
from teleop_drake.loops.run.moving import Motion

# The instants at which a piece is evaluated, as shares of its length, and the powers of
# those of a whole step.
_EVALUATED = [*INSIDE, CHECKED]
_OF_STEP = np.vander(_EVALUATED, 4, increasing=True)

# The number of steps at the start that are sampled in full in any case.
_FULL_STEPS = 8

# The golden section, whose multiples are spread evenly between whole numbers.
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0

_NOTHING: Array = np.empty(0)

# The shortest piece as a share of its step, and the most pieces of a step. A kink needs
# some fifteen.
_SHORTEST_PIECE = 2.0**-14
_MOST_PIECES = 200


class Recorder:
    """A sampler of the signals of a diagram, step by step.

    Drake provides the states at the ends of a step only. Within a step they are
    interpolated by cubic polynomials that match states and rates at both ends. The
    outputs that depend on them, or on time, are evaluated at these states, in a
    separate Context. If all are known to be affine in them, they follow the cubics.
    Where a polynomial through the samples does not follow a signal, the step is
    recorded in shorter pieces, down to 2^-14 of its length. All other outputs are held:
    they change at the beginning of a step only. If one has, or if the discrete state
    differs from that of the last sample, the beginning is sampled again.

    Many blocks only seem to depend on time. In a system without continuous states, a
    step with the same values at its beginning, at its end and at one instant within is
    taken to have no others, until a signal is seen to move and to come back in a step.

    Attributes:
        names: The names of the signals.
        columns: The slice of a sample that belongs to each signal, in the same order.
        bent: The names of the signals that jump or bend within a step.
        unresolved: The names of those that do so more sharply than the shortest piece
            follows.
        is_held: Whether no signal may move within a step; known from the first sample.

    Args:
        diagram: The simulated System.
        signals: The output port of each signal, by name.
        root_context: The Context of the Simulator.
    """

    def __init__(
        self,
        diagram: System,
        signals: Mapping[str, OutputPort],
        root_context: Context,
    ):
        self.names = list(signals)
        self.bent: set[str] = set()
        self.unresolved: set[str] = set()
        self.is_held = False
        sizes = [port.size() for port in signals.values()]
        ends = np.cumsum([0, *sizes]).tolist()
        self.columns = [slice(*ends_of) for ends_of in pairwise(ends)]
        self._bends = Bends(sizes)
        # Ports without elements need no evaluation.
        self._ports = [
            (port, place)
            for port, place in zip(signals.values(), self.columns, strict=True)
            if port.size() > 0
        ]
        self._at_end = [
            (port.Eval, port.get_system().GetMyContextFromRoot(root_context))
            for port, _ in self._ports
        ]
        self._diagram = diagram
        self._root_context = root_context
        self._has_states = root_context.num_continuous_states() > 0
        self._modes = range(root_context.num_discrete_state_groups())
        self._num_columns = ends[-1]
        self._moving: list[Moving] = []
        self._affine: Affine | None = None
        # Whether no signal was seen yet to move and to come back within a step.
        self._stays = not self._has_states
        self._times: list[float] = []
        self._samples: list[Array] = []
        # The later samples of signals that are held.
        self._held = array("d")
        self._step_ends: list[int] = []
        self._state = self._rate = _NOTHING
        # The discrete states and the held signals at the last sample.
        self._last_held: list[bytes] = []

    def Sample(self) -> Array:
        """Samples the interior and the end of a step; returns the sample at its end."""
        root = self._root_context
        time = root.get_time()
        values = _Joined([evaluate(context) for evaluate, context in self._at_end])
        if not self._times:
            self._FindMoving(time)
        if self.is_held:
            self._Append(time, values)
            return values
        state = rate = _NOTHING
        if self._has_states:
            state = root.get_continuous_state_vector().CopyToVector()
            rate = self._RateIn(root)
        held = [
            *(root.get_discrete_state(i).CopyToVector().tobytes() for i in self._modes),
            values[self._held_columns].tobytes(),
        ]
        last = self._times[-1] if self._times else math.inf
        if time > last + same_within(time) and _AreFinite(values):
            has_changed = held != self._last_held
            if has_changed or self._affine is None:
                self._inner_context.SetTimeStateAndParametersFrom(root)
            if has_changed:
                # A block has changed it at the beginning of the step.
                first = self._Evaluate(last, self._state, values)
                self._Append(last, first)
                if self._has_states:
                    self._rate = self._RateIn(self._inner_context)
            if not self._IsStill(time, values):
                self._SampleStep(time, state, rate, values)
        else:
            self._Append(time, values)
        self._state = state
        self._rate = rate
        self._last_held = held
        return values

    def HeldSampler(self) -> Callable[[], tuple[float, float]]:
        """Returns a function that takes the samples from now on, of held signals.

        It returns the time in s and the norm of all signals. It does what Sample()
        does, in a third of the time: a discrete system takes steps of microseconds.
        """
        get_time = self._root_context.get_time
        at_end = self._at_end
        append_time = self._times.append
        store = self._held.extend
        hypot = math.hypot

        def Sample() -> tuple[float, float]:
            norm = 0.0
            for evaluate, context in at_end:
                values = evaluate(context).tolist()
                store(values)
                norm = hypot(norm, *values)
            time = get_time()
            append_time(time)
            return time, norm

        return Sample

    def Last(self) -> tuple[float, list[Array]]:
        """Returns the time of the last sample and its values."""
        return self._times[-1], [self._samples[-1][place] for place in self.columns]

    def _FindMoving(self, time: float) -> None:
        """Finds the signals that may move within a step, at the first sample."""
        self._inner_context = context = self._root_context.Clone()
        state = context.get_continuous_state_vector().CopyToVector()
        # The clone has the outputs that were evaluated, until its time changes.
        context.SetTimeAndContinuousState(time + 1.0, state)
        motion = Motion(self._diagram, context)
        held = np.ones(self._num_columns, dtype=bool)
        is_affine = True
        for port, place in self._ports:
            if motion.Moves(port):
                own = port.get_system().GetMyContextFromRoot(context)
                self._moving.append((port.Eval, own, place))
                held[place] = False
                is_affine = is_affine and motion.IsAffine(port)
        self._held_columns = np.flatnonzero(held)
        self.is_held = not self._moving
        if self._moving and is_affine:
            self._affine = Affine(context, self._moving)

    def _Append(self, time: float, values: Array) -> None:
        self._times.append(time)
        self._samples.append(values)

    def _RateIn(self, root_context: Context) -> Array:
        """Returns the rate of the state in a Context."""
        rate: Array = self._diagram.EvalTimeDerivatives(root_context).CopyToVector()
        return rate

    def _SampleStep(self, end: float, state: Array, rate: Array, values: Array) -> None:
        """Records the samples from the last one to the end of the step.

        Args:
            end: The time of the end, s.
            state: The state at the end.
            rate: The rate of the state at the end.
            values: The sample at the end.
        """
        ends = self._state, state, self._rate, rate
        first = len(self._times) - 1
        if self._affine is None:
            self._FollowStep(end, values, ends)
        else:
            self._AppendStill(end, values)
            self._affine.Store(first, len(self._times) - 1, ends)

    def _FollowStep(self, end: float, values: Array, ends: Ends) -> None:
        """Records the samples of a step in pieces that polynomials follow.

        Args:
            end: The time of the end, s.
            values: The sample at the end.
            ends: The states at the ends of the step and their rates there.
        """
        begin = self._times[-1]
        h = end - begin
        before, after, rate_before, rate_after = ends
        states = np.array([before, after, h * rate_before, h * rate_after])
        coefficients = HERMITE @ states

        def At(first: float, width: float) -> list[tuple[float, Array]]:
            shares = [first + share * width for share in _EVALUATED]
            instants = [begin + share * h for share in shares]
            is_whole = width == 1.0
            powers = _OF_STEP if is_whole else np.vander(shares, 4, increasing=True)
            inside = powers @ coefficients
            return [
                (t, self._Evaluate(t, x, values))
                for t, x in zip(instants, inside, strict=True)
            ]

        # The pieces ahead, the next one last, each with the sample at its end.
        pieces = [(0.0, 1.0, (end, values))]
        num_pieces = 1
        while pieces:
            first, last, sample = pieces.pop()
            width = last - first
            *inside, checked = At(first, width)
            rows = [self._samples[-1], *(x for _, x in (*inside, sample, checked))]
            bent = self._bends.Find(np.array(rows))
            if width == 1.0:
                self.bent |= {self.names[k] for k in bent}
            if len(bent) and width > _SHORTEST_PIECE and num_pieces < _MOST_PIECES:
                middle = first + width / 2
                pieces += [(middle, last, sample), (first, middle, inside[1])]
                num_pieces += 1
                continue
            self.unresolved |= {self.names[k] for k in bent}
            if num_pieces == _MOST_PIECES:
                # Noise bends everywhere.
                self._bends.Leave(bent)
            for instant in inside:
                self._Append(*instant)
            self._step_ends.append(len(self._times))
            self._Append(*sample)

    def _IsStill(self, end: float, values: Array) -> bool:
        """Records a step in which no signal moves; returns whether it is one.

        After the first steps they are looked at once, at an instant that differs from
        step to step, so that it does not keep time with a signal whose period is that
        of the steps.

        Args:
            end: The time of the end, s.
            values: The sample at the end.
        """
        bits = values.tobytes()
        if not self._stays or self._samples[-1].tobytes() != bits:
            return False
        begin = self._times[-1]
        is_first = len(self._step_ends) < _FULL_STEPS
        once = (len(self._times) * _GOLDEN) % 1.0
        for share in _EVALUATED if is_first else [once]:
            instant = begin + share * (end - begin)
            inside = self._Evaluate(instant, self._state, values)
            if inside.tobytes() == bits:
                continue
            self._stays = False
            if not is_first:
                # Steps before may have been taken for still.
                places = zip(self.names, self.columns, strict=True)
                moves = inside != values
                found = {name for name, x in places if moves[x].any()}
                self.bent |= found
                self.unresolved |= found
            return False
        self._bends.See(values)
        self._AppendStill(end, values)
        return True

    def _AppendStill(self, end: float, values: Array) -> None:
        """Appends the rows of a step with the same values within and at its end."""
        begin = self._times[-1]
        self._times += [begin + share * (end - begin) for share in INSIDE]
        self._step_ends.append(len(self._times))
        self._times.append(end)
        self._samples += [values] * DEGREE

    def _Evaluate(self, time: float, state: Array, at_end: Array) -> Array:
        """Returns the sample at a time in s and at a state.

        Args:
            at_end: The sample at the end of the step, which has the held signals.
        """
        self._inner_context.SetTimeAndContinuousState(time, state)
        values = at_end.copy()
        for evaluate, own, place in self._moving:
            values[place] = evaluate(own)
        return values

    def Finish(self) -> Series:
        """Returns the times (N,), the signals (N, k) and the steps."""
        times = np.array(self._times)
        size = self._num_columns
        # An error may have ended the run within the last sample.
        held = self._held[: size * (len(times) - len(self._samples))]
        rows = np.concatenate([*self._samples, held]).reshape(len(times), size)
        ends = np.array(self._step_ends, int)
        if self._affine is not None:
            self._affine.Fill(times, rows)
        if self.is_held:
            times, rows, ends = _WithSteps(times, rows)
        signals = {
            name: rows[:, place]
            for name, place in zip(self.names, self.columns, strict=True)
        }
        return times, signals, ends[:, np.newaxis] + np.arange(-DEGREE, 1)


def _WithSteps(times: Array, rows: Array) -> tuple[Array, Array, Indices]:
    """Returns times and rows of steps, and the indices of the rows at their ends.

    Args:
        times: The times of the samples at the ends of steps, s (N).
        rows: The samples (N, k). No signal moves within a step, but may jump at its
            beginning.
    """
    last = np.append(np.inf, times[:-1])
    is_later = times > last + np.maximum(SAME, SAME_SHARE * np.abs(times))
    is_step = is_later & np.isfinite(rows).all(axis=1)
    jumps = is_step & np.append(False, (rows[1:] != rows[:-1]).any(axis=1))
    # A step has a row at its beginning, if there is a jump, three inside, and the end.
    counts = 1 + len(INSIDE) * is_step + jumps
    ends = np.cumsum(counts) - 1
    sources = np.repeat(np.arange(len(times)), counts)
    before_end = ends[sources] - np.arange(len(sources))
    share = np.array([0.0, *INSIDE[::-1], 0.0])[before_end]
    begin = np.where(before_end > 0, last[sources], times[sources])
    length = np.where(before_end > 0, times[sources] - begin, 0.0)
    return begin + share * length, rows[sources], ends[is_step]


def _AreFinite(values: Array) -> bool:
    return math.isfinite(math.hypot(*values.tolist()))


def _Joined(values: list[Array]) -> Array:
    if len(values) == 1:
        return values[0]
    return np.concatenate(values) if values else _NOTHING
