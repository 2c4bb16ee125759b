"""How much later each signal of a network may come until the network is unstable.

A network consists of dynamic systems and the wires between them. All wires are cut at
once. Between the cuts the network is linear, with inner delays:

    [dx/dt; s; e] = M [x; w; d],    d_i(t) = e_i(t - T_i)                        (1)

The signals s are sent into the wires, and w leave them. The network itself has w = s.
With w = s + v, let S be the response from v to s at some wires: their sensitivity,
which has the modes of the closed network. A delay T of these wires makes
v = (e^(-s T) - 1) s there, and the roots of the network those of

    det(I + S(s) (1 - e^(-s T))) = 0.                                            (2)

The loop that is opened at these wires has the transfer function L = -S (I + S)^-1, and
(2) is det(I + L(s) e^(-s T)) = 0 as in crossings. One sweep of the frequency finds S
at all wires, so that a network of many wires takes hardly longer than one loop.

Only signals that act on each other are in a loop: those of a strongly connected part of
the graph of M. Each part is analysed by itself. A wire in no part has no loop.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from teleop_drake.loops.framework.arrays import Array, ComplexArray, Flags, Indices
from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.loops.numerics.crossings import by_size, crossings_of
from teleop_drake.loops.numerics.delayed_loop import (
    delay_through_zero,
    gain_at_once,
    slowest_resolved,
    without_hidden_modes,
)
from teleop_drake.loops.numerics.state_space import StateSpace, strong_parts

# The sweep of the frequency: its points per decade, how far it reaches below the
# slowest mode, the number of points on each side of a weakly damped mode, the points
# per turn of the phase by all delays, and the largest number of these.
_POINTS_PER_DECADE = 200
_BELOW = 1e-4
_NUM_MODE_POINTS = 40
_POINTS_PER_TURN = 12
_MOST_POINTS = 100_000

# A mode is weakly damped if its damping ratio is less than this.
_WEAK = 0.2

# The sweep ends where no sensitivity can exceed this: |S| < 1/2 means |L| < 1. The end
# is searched for in this number of decades above the fastest mode, with a number of
# frequencies in each.
_LEAST_SENSITIVITY = 0.45
_NUM_DECADES = 4
_NUM_COARSE = 30

# The number of frequencies at which all sensitivities are computed together.
_CHUNK = 64

# The least number of roots that are searched for; a part may have fewer.
_FEWEST_ROOTS = 16


def delay_margins(
    network: StateSpace, bundles: Sequence[Indices]
) -> list[float] | None:
    """Returns the additional delay in s that each bundle of wires tolerates.

    The result is infinity if no delay makes the network unstable, as with wires in no
    loop, and None if the network is unstable without additional delay.

    Args:
        network: M of (1), with all wires as open signals and the delays T_i > 0.
        bundles: Indices of wires that are late together, (g, m) each: g wires that
            carry the same m signals.
    """
    parts = [_Part(network, nodes) for nodes in strong_parts(network.matrix)]
    if not all(part.is_stable for part in parts):
        return None
    keys = [(wires.shape, wires.tobytes()) for wires in bundles]
    distinct = dict(zip(keys, bundles, strict=True))
    margins = dict.fromkeys(keys, math.inf)
    for part in parts:
        for i, margin in part.margins(list(distinct.values())).items():
            key = list(distinct)[i]
            margins[key] = min(margins[key], margin)
    return [margins[key] for key in keys]


class _Part:
    """A strongly connected part of a network.

    Args:
        network: The network.
        nodes: Whether each state, wire and delay is in the part.
    """

    def __init__(self, network: StateSpace, nodes: Flags):
        n = network.num_states
        num_wires = network.num_open[0]
        wires = np.flatnonzero(nodes[n : n + num_wires])
        # The place of each of the network's wires among those of the part, or -1.
        self._places = np.full(num_wires, -1)
        self._places[wires] = np.arange(len(wires))
        num_states = int(nodes[:n].sum())
        cut = network.matrix[np.ix_(nodes, nodes)]
        i = num_states + np.arange(len(wires))
        # Without algebraic loops this matrix is triangular, in a suitable order.
        around = np.eye(len(i)) - cut[np.ix_(i, i)]
        closed = cut + cut[:, i] @ np.linalg.solve(around, cut[i])
        delays = np.array(network.delays)[nodes[n + num_wires :]]
        whole = StateSpace(
            matrix=closed, num_states=num_states, delays=tuple(delays.tolist())
        )
        self._system, hidden = without_hidden_modes(whole)
        # The part with its delays alone.
        rest = np.arange(len(i), len(whole.D))
        inner = self._system.part(np.arange(self._system.num_states), rest, rest)
        self._closed = replace(inner, delays=whole.delays)
        count = max(_FEWEST_ROOTS, self._closed.num_states)
        self._roots = np.array(hidden)
        if self._closed.num_states:
            roots = characteristic_roots(self._closed, count=count)
            self._roots = np.append(hidden, roots)
        self._slow = slowest_resolved(self._closed)

    @cached_property
    def is_stable(self) -> bool:
        """Whether no root is right of the imaginary axis; roots at 0 are allowed."""
        is_slow = np.abs(self._roots) <= self._slow
        is_right = self._roots.real > self._slow
        at_once = gain_at_once(self._closed.D, self._closed.delays)
        return at_once < 1 and not np.any(is_right & ~is_slow)

    def margins(self, bundles: Sequence[Indices]) -> dict[int, float]:
        """Returns the margins of the bundles that have wires in the part, by index."""
        found = {i: self._signals(wires) for i, wires in enumerate(bundles)}
        inside = {i: signals for i, signals in found.items() if signals}
        if not inside:
            return {}
        systems = {i: self._through(signals) for i, signals in inside.items()}
        margins = {i: self._bound(system) for i, system in systems.items()}
        every = self._through(list(itertools.chain(*inside.values())))
        loci = _SensitivityLoci(every, list(systems.values()))
        owners = [i for i, signals in inside.items() for _ in signals]
        for column, crossing in crossings_of(loci, self._sweep(loci)):
            if crossing.direction > 0:
                i = owners[column]
                margins[i] = min(margins[i], crossing.delay)
        return margins

    def _signals(self, wires: Indices) -> list[Indices]:
        """Returns the places of the wires of each signal of a bundle in the part."""
        places = [column[column >= 0] for column in self._places[wires].T]
        return [x for x in places if len(x)]

    def _through(self, signals: Sequence[Indices]) -> StateSpace:
        """Returns the response from v to s of some signals.

        Args:
            signals: The places of the wires of each signal. It leaves one of them, and
                v enters all of them.
        """
        n = self._system.num_states
        matrix = self._system.matrix
        after = n + int((self._places >= 0).sum())
        sent = [n + places[0] for places in signals]
        entering = [matrix[:, n + places].sum(axis=1) for places in signals]
        columns = np.column_stack([matrix[:, :n], *entering, matrix[:, after:]])
        rows = [*range(n), *sent, *range(after, len(matrix))]
        return replace(self._system, matrix=columns[rows])

    def _bound(self, bundle: StateSpace) -> float:
        """Returns an upper bound of a bundle's margin, apart from pairs of roots.

        It is 0 if loops without dynamics amplify, or the delay at which a real root
        passes through 0, or infinity.
        """
        m = bundle.num_open[0]
        # The bundle is opened by v = u - s.
        left = np.linalg.inv(np.eye(m) + bundle.D[:m, :m])
        opening = np.eye(len(bundle.D))
        opening[:m] = left @ np.hstack([np.eye(m), -bundle.D[:m, m:]])
        times = (-1.0,) * m + bundle.delays
        if gain_at_once(bundle.D @ opening, times) >= 1:
            return 0.0
        sizes = np.abs(self._roots)
        if not np.any(sizes <= self._slow):
            return math.inf
        slowest = float(sizes[sizes > self._slow].min(initial=1.0))
        return delay_through_zero(bundle.response_at, slowest)

    def _sweep(self, loci: "_SensitivityLoci") -> Array:
        """Returns ascending frequencies in rad/s that resolve the sensitivities."""
        system = loci.system
        modes = np.append(self._roots, np.linalg.eigvals(system.A))
        sizes = np.abs(modes)[np.abs(modes) > self._slow].tolist()
        sizes += [1 / delay for delay in system.delays]
        low = _BELOW * min(sizes, default=1.0)
        high = loci.highest(max(sizes, default=1.0))
        num_even = math.ceil(_POINTS_PER_DECADE * math.log10(high / low))
        weak = self._roots[np.abs(self._roots.real) < _WEAK * self._roots.imag]
        widths = np.maximum(np.abs(weak.real), 1e-9 * np.abs(weak))
        offsets = np.geomspace(widths / 8, np.abs(weak) / 2, _NUM_MODE_POINTS)
        turns = high * sum(system.delays) / (2 * math.pi)
        num_turning = min(math.ceil(_POINTS_PER_TURN * turns), _MOST_POINTS)
        every = np.concatenate(
            [
                np.geomspace(low, high, num_even),
                np.linspace(low, high, num_turning),
                (weak.imag + offsets).ravel(),
                (weak.imag - offsets).ravel(),
            ]
        )
        return np.array(sorted({*every[(every >= low) & (every <= high)].tolist()}))


class _SensitivityLoci:
    """The eigenvalues of L of several bundles as functions of the frequency; see Loci.

    Attributes:
        system: The response from v to s of all bundles, one behind the other.

    Args:
        system: See above.
        bundles: The response from v to s of each bundle.
    """

    def __init__(self, system: StateSpace, bundles: Sequence[StateSpace]):
        self.system = system
        self._bundles = bundles
        ends = np.cumsum([bundle.num_open[0] for bundle in bundles])
        begins = [0, *ends[:-1].tolist()]
        self._slices = [slice(*x) for x in zip(begins, ends.tolist(), strict=True)]
        self._begins = np.array(begins)

    def over(self, frequencies: Array) -> ComplexArray:
        """Returns all eigenvalues (K, Q), those of a bundle by descending magnitude."""
        result = np.empty((len(frequencies), self.system.num_open[0]), dtype=complex)
        for k in range(0, len(frequencies), _CHUNK):
            chunk = slice(k, k + _CHUNK)
            S = self.system.finite_response(frequencies[chunk])
            for own in self._slices:
                result[chunk, own] = _loci(S[:, own, own])
        return result

    def at(self, frequencies: Array, columns: Indices) -> ComplexArray:
        """Returns one of the eigenvalues for each frequency (k)."""
        result = np.empty(len(frequencies), dtype=complex)
        owners = np.searchsorted(self._begins, columns, side="right") - 1
        for owner in sorted(set(owners.tolist())):
            k = np.flatnonzero(owners == owner)
            loci = _loci(self._bundles[owner].finite_response(frequencies[k]))
            result[k] = loci[np.arange(len(k)), columns[k] - self._begins[owner]]
        return result

    def highest(self, fastest: float) -> float:
        """Returns a frequency in rad/s above which no sensitivity reaches 1/2.

        If delays without dynamics between them keep a sensitivity large, it no longer
        changes above this frequency.

        Args:
            fastest: The magnitude of the fastest mode in 1/s.
        """
        at_once = self._largest(self.system.D[np.newaxis].astype(complex))
        for decade in range(_NUM_DECADES, 0, -1):
            w = np.geomspace(
                fastest * 10 ** (decade - 1), fastest * 10**decade, _NUM_COARSE
            )
            largest = self._largest(self.system.opened.finite_response(w))
            is_over = largest > np.maximum(_LEAST_SENSITIVITY, 1.01 * at_once)
            if is_over.any():
                return 2 * float(w[is_over.any(axis=1)][-1])
        return fastest

    def _largest(self, opened: ComplexArray) -> Array:
        """Returns the largest gain of each bundle for any phases of the delays (K, b).

        Args:
            opened: The response with the delays as open signals.
        """
        sizes = np.abs(opened)
        q = self.system.num_open[0]
        around = sizes[:, q:, q:]
        is_bounded = np.abs(np.linalg.eigvals(around)).max(axis=1, initial=0.0) < 1
        by_delays = np.eye(around.shape[1]) - around[is_bounded]
        bound = np.full((len(sizes), q, q), np.inf)
        bound[is_bounded] = sizes[is_bounded, :q, :q] + sizes[
            is_bounded, :q, q:
        ] @ np.linalg.solve(by_delays, sizes[is_bounded, q:, :q])
        return np.stack(
            [bound[:, own, own].sum(axis=2).max(axis=1) for own in self._slices], axis=1
        )


def _loci(S: ComplexArray) -> ComplexArray:
    """Returns the eigenvalues of L = -S (I + S)^-1 by descending magnitude (K, m)."""
    values = S[:, :, 0] if S.shape[1] == 1 else np.linalg.eigvals(S)
    with np.errstate(divide="ignore", invalid="ignore"):
        loci = np.where(values == -1, np.inf, -values / (1 + values)).astype(complex)
    return by_size(loci)
