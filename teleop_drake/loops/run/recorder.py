"""The sampler of a run in Drake's Simulator."""

import math
from collections.abc import Mapping
from itertools import compress, pairwise

import numpy as np
from pydrake.systems.framework import (
    CacheIndex,
    Context,
    Diagram,
    LeafSystem,
    OutputPort,
    OutputPortIndex,
    System,
)

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.framework.contexts import DiscreteState
from teleop_drake.loops.numerics.instants import same_within
from teleop_drake.loops.numerics.step_polynomials import DEGREE, Series
from teleop_drake.loops.run.bends import CHECKED, INSIDE, Bends

# The coefficients of a cubic Hermite polynomial, by ascending powers: of the values at
# both ends, and of the rates at both ends times the length.
_HERMITE = np.array(
    [[1.0, 0, 0, 0], [0, 0, 1, 0], [-3, 3, -2, -1], [2, -2, 1, 1]],
)

# The instants at which a piece is evaluated, as shares of its length, and the powers of
# those of a whole step.
_EVALUATED = [*INSIDE, CHECKED]
_OF_STEP = np.vander(_EVALUATED, 4, increasing=True)

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
    separate Context. Where a polynomial through the samples does not follow a signal,
    the step is recorded in shorter pieces, down to 2^-14 of its length. All other
    outputs are held: they change at the beginning of a step only. If one has, or if the
    discrete state differs from that of the last sample, the beginning is sampled again.

    Attributes:
        names: The names of the signals.
        columns: The slice of a sample that belongs to each signal, in the same order.
        bent: The names of the signals that jump or bend within a step.
        unresolved: The names of those that do so more sharply than the shortest piece
            follows.

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
        sizes = [port.size() for port in signals.values()]
        ends = np.cumsum([0, *sizes]).tolist()
        self.columns = [slice(*ends_of) for ends_of in pairwise(ends)]
        self._bends = Bends(sizes)
        self._inner_context = root_context.Clone()
        # Ports without elements need no evaluation.
        self._ports = [
            (port, place)
            for port, place in zip(signals.values(), self.columns, strict=True)
            if port.size() > 0
        ]
        self._at_end, self._inside = (
            [
                (port.Eval, port.get_system().GetMyContextFromRoot(root))
                for port, _ in self._ports
            ]
            for root in (root_context, self._inner_context)
        )
        self._diagram = diagram
        self._root_context = root_context
        self._has_modes = root_context.num_discrete_state_groups() > 0
        # Whether a signal may move within a step; None: not known yet.
        self._moves: bool | None = None
        # Whether each element of a sample may move within a step.
        self._is_moving = np.ones(ends[-1], dtype=bool)
        self._times: list[float] = []
        self._samples: list[Array] = []
        self._step_ends: list[int] = []
        self._state = self._rate = self._mode = _NOTHING

    def Sample(self) -> Array:
        """Samples the interior and the end of a step; returns the sample at its end."""
        root = self._root_context
        time = root.get_time()
        values = _Joined([evaluate(context) for evaluate, context in self._at_end])
        if self.is_held:
            self._Append(time, values)
            return values
        last = self._times[-1] if self._times else math.inf
        is_step = time > last + same_within(time) and _AreFinite(values)
        state = root.get_continuous_state_vector().CopyToVector()
        rate = self._RateIn(root)
        mode = DiscreteState(root) if self._has_modes else _NOTHING
        if is_step:
            self._inner_context.SetTimeStateAndParametersFrom(root)
            if self._HasChanged(mode, values):
                # A block has changed it at the beginning of the step.
                self._Append(last, self._Evaluate(last, self._state, values))
                self._rate = self._RateIn(self._inner_context)
            self._SampleStep(time, state, rate, values)
        else:
            self._Append(time, values)
        self._state = state
        self._rate = rate
        self._mode = mode
        return values

    def Last(self) -> tuple[float, list[Array]]:
        """Returns the time of the last sample and its values."""
        return self._times[-1], [self._samples[-1][place] for place in self.columns]

    def _Append(self, time: float, values: Array) -> None:
        self._times.append(time)
        self._samples.append(values)

    def _HasChanged(self, mode: Array, values: Array) -> bool:
        """Returns whether the discrete state or a held output is another one.

        Args:
            mode: The discrete state at the end of the step.
            values: The sample there.
        """
        if self._has_modes and not np.array_equal(mode, self._mode):
            return True
        if self._is_moving.all():
            return False
        differs = values != self._samples[-1]
        return bool((differs & ~self._is_moving).any())

    def _RateIn(self, root_context: Context) -> Array:
        """Returns the rate of the state in a Context."""
        if root_context.num_continuous_states() == 0:
            return np.empty(0)  # Some systems without such a state raise an error.
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
        begin = self._times[-1]
        h = end - begin
        states = np.array([self._state, state, h * self._rate, h * rate])
        coefficients = _HERMITE @ states

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

    def _Evaluate(self, time: float, state: Array, at_end: Array) -> Array:
        """Returns the sample at a time in s and at a state.

        Args:
            at_end: The sample at the end of the step, which has the held signals.
        """
        context = self._inner_context
        context.SetTimeAndContinuousState(time, state)
        if self._moves is None:
            values = _Joined([evaluate(own) for evaluate, own in self._inside])
            context.SetTimeAndContinuousState(time + 1.0, state)
            moves = [_IsOutOfDate(port, context) for port, _ in self._ports]
            for (_, place), is_moving in zip(self._ports, moves, strict=True):
                self._is_moving[place] = is_moving
            self._inside = list(compress(self._inside, moves))
            self._moves = any(moves)
            context.SetTimeAndContinuousState(time, state)
            return values
        moving = _Joined([evaluate(own) for evaluate, own in self._inside])
        if len(moving) == len(at_end):
            return moving
        values = at_end.copy()
        values[self._is_moving] = moving
        return values

    @property
    def is_held(self) -> bool:
        """Whether no signal moves within a step, as the first step has shown."""
        return self._moves is False

    def Finish(self) -> Series:
        """Returns the times (N,), the signals (N, k) and the steps."""
        times = np.array(self._times)
        rows = np.array(self._samples).reshape(len(times), len(self._is_moving))
        ends = np.array(self._step_ends, int)
        if self.is_held:
            # The first step was sampled before it was known.
            inside = (ends[:, np.newaxis] - np.arange(1, DEGREE)).ravel()
            times = np.delete(times, inside)
            times, rows, ends = _WithSteps(times, np.delete(rows, inside, axis=0))
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
    last = np.r_[np.inf, times[:-1]]
    is_later = times > last + [same_within(t) for t in times.tolist()]
    is_step = is_later & np.isfinite(rows).all(axis=1)
    jumps = is_step & np.r_[False, (rows[1:] != rows[:-1]).any(axis=1)]
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


def _IsOutOfDate(port: OutputPort, root_context: Context) -> bool:
    """Returns whether an output must be computed again in a Context.

    Args:
        port: The output port, which has been evaluated in the Context before.
        root_context: The Context.
    """
    system = port.get_system()
    while isinstance(system, Diagram):
        system, index = system.get_output_port_locator(
            OutputPortIndex(port.get_index())
        )
        port = system.get_output_port(int(index))
    if not isinstance(system, LeafSystem):
        return True  # Some Diagrams of Drake's are known as Systems only.
    # Drake names the cache entry of each output of a leaf in this way.
    name = f"output port {int(port.get_index())}({port.get_name()}) cache"
    i = 0
    while system.get_cache_entry(CacheIndex(i)).description() != name:
        i += 1
    entry = system.get_cache_entry(CacheIndex(i))
    context = system.GetMyContextFromRoot(root_context)
    return entry.is_cache_entry_disabled(context) or entry.is_out_of_date(context)
