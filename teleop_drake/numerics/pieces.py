"""Signals of a run in pieces, and what metrics are made of.

A piece is a step of a recording, or a part of a step that was cut at an instant. A
signal in pieces is an array (p, 5, ...): its values at five points of each of p pieces,
equally far apart, of which the ends are two. Between them it is the quartic through
them. So all functions here are exact for the polynomials of a run, and what is computed
with them converges with the solver, not with the sampling.

Signals in pieces are added and multiplied as arrays are. A product is a quartic through
its values again.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from teleop_drake.arrays import Array, Indices
from teleop_drake.numerics.bisection import bisect
from teleop_drake.numerics.step_polynomials import (
    DEGREE,
    interpolate,
    lagrange,
    products_of_values,
    shares,
    to_powers,
)

NODES = shares(DEGREE)
"""The points of a piece at which a signal is given."""

SAME_INSTANT = 5e-12
"""Instants that are closer together than this, in s, are one. Sums of times are."""

# Where a delayed signal jumps at an end of a piece, this is inside of the piece, s.
_INWARDS = 2 * SAME_INSTANT

# At a flat place a value is exact long before its place is.
_ROUNDS_TO_EXTREMES = 7


class Crossing(NamedTuple):
    """An instant at which a signal changes its sign.

    Attributes:
        time: In s.
        is_upwards: Whether it was negative before.
    """

    time: float
    is_upwards: bool


class Pieces:
    """The steps of a recording, cut at instants.

    Attributes:
        begin: When each piece begins, s (p).
        end: When it ends, s (p).
        length: How long it lasts, s (p). A recording of a single row is one piece, of
            which 1 is told.
    """

    def __init__(self, times: Array, steps: Indices, cuts: Iterable[float] = ()):
        """Cuts steps.

        Args:
            times: Of the rows of the recording in s (N).
            steps: Their rows (S, d + 1); see numerics.step_polynomials.
            cuts: Instants in s.
        """
        # A step between two instants that are one is a part of what jumps there.
        steps = steps[times[steps[:, -1]] - times[steps[:, 0]] > SAME_INSTANT]
        if len(steps) == 0:
            steps = np.full((1, len(NODES)), len(times) - 1)
        self._times = times
        self._steps = steps
        self._weights = lagrange(NODES, steps.shape[1] - 1)
        self.begin = times[steps[:, 0]]
        self.end = times[steps[:, -1]]
        self._step = np.arange(len(steps))
        self._parts = self._cut(np.unique(np.fromiter(cuts, float)))
        self.length = self.end - self.begin
        if len(self.length) == 1 and self.length[0] == 0:
            self.length = np.ones(1)

    def _cut(self, instants: Array) -> Indices:
        """Cuts whole steps at instants; returns which pieces are parts of a step."""
        # The step in which each instant is. At the end of a step it cuts nothing.
        inside = np.searchsorted(self.end, instants)
        inside = np.minimum(inside, len(self.end) - 1)
        is_after_begin = instants > self.begin[inside] + SAME_INSTANT
        is_before_end = instants < self.end[inside] - SAME_INSTANT
        is_cut = is_after_begin & is_before_end
        is_cut[1:] &= np.diff(instants) > SAME_INSTANT
        instants = instants[is_cut]
        inside = inside[is_cut]
        # A step that is cut k times has k + 1 pieces.
        self._step = np.insert(self._step, inside, inside)
        self.begin = self.begin[self._step]
        self.end = self.end[self._step]
        before = inside + np.arange(len(inside))
        self.end[before] = instants
        self.begin[before + 1] = instants
        return np.union1d(before, before + 1)

    def signal(self, samples: Array) -> Array:
        """Returns a signal in pieces (p, 5, n).

        Args:
            samples: Of the rows of the recording (N, n).
        """
        signal: Array = samples[self._steps[self._step]]
        if signal.shape[1] != len(NODES):
            signal = self._weights @ signal
        owners = self._steps[self._step[self._parts]]
        begin = self._times[owners[:, :1]]
        end = self._times[owners[:, -1:]]
        share = (self._instants()[self._parts] - begin) / (end - begin)
        signal[self._parts] = lagrange(share, owners.shape[1] - 1) @ samples[owners]
        return signal

    def delayed(self, samples: Array, delay: float) -> Array:
        """Returns what a signal was a delay ago in pieces (p, 5, n); 0 at first.

        Args:
            samples: Of the rows of the recording (N, n).
            delay: In s.
        """
        sent = self._instants() - delay
        # A jump at an end of the piece has happened, or has not.
        inwards = np.minimum(_INWARDS, (self.end - self.begin) / 8)
        sent[:, 0] += inwards
        sent[:, -1] -= inwards
        signal = interpolate(self._times, samples, self._steps, sent.ravel())
        signal[sent.ravel() < self._times[0]] = 0.0
        return signal.reshape(*sent.shape, -1)

    def since(self, time: float | None) -> slice:
        """Returns the pieces after an instant; all without one."""
        return self.between(time, None)

    def between(self, begin: float | None, end: float | None) -> slice:
        """Returns the pieces between two instants; None: those of the run's ends."""
        middles = (self.begin + self.end) / 2
        first = 0 if begin is None else int(np.searchsorted(middles, begin))
        last = len(middles)
        if end is not None:
            last = int(np.searchsorted(middles, end))
        return slice(first, last)

    def crossings(self, y: Array) -> list[Crossing]:
        """Returns where a signal (p, 5) changes its sign; 0 counts as positive."""
        is_in = y >= 0
        piece, node = np.nonzero(is_in[:, 1:] != is_in[:, :-1])
        if len(piece) == 0:
            return []
        powers = _powers(y[piece])
        was_in = is_in[piece, node]
        share = bisect(
            lambda x: (polyval(x, powers, tensor=False) >= 0) == was_in,
            NODES[node],
            NODES[node + 1],
        )
        times = self.begin[piece] + share * (self.end - self.begin)[piece]
        return [
            Crossing(time, not was)
            for time, was in zip(times.tolist(), was_in.tolist(), strict=True)
        ]

    def _instants(self) -> Array:
        """Returns the instants of the points of each piece in s (p, 5)."""
        return self.begin[:, None] + NODES * (self.end - self.begin)[:, None]


def first_upwards(crossings: Iterable[Crossing]) -> float | None:
    """Returns when a signal first becomes positive, s; None if it does not."""
    return next((x.time for x in crossings if x.is_upwards), None)


def first_after(time: float | None, times: Iterable[float]) -> float | None:
    """Returns the first of some instants after another one, s; None without either."""
    if time is None:
        return None
    return next((t for t in times if t > time), None)


def value_before(y: Array, span: slice) -> Array:
    """Returns a signal (p, 5, ...) just before a span of pieces; its first value."""
    if span.start == 0:
        return y[0, 0]
    return y[span.start - 1, -1]


def maximum(y: Array, span: slice) -> Array:
    """Returns the largest value of each component of a signal (p, 5, ...).

    Args:
        span: The pieces in question. Without a piece it is the value before them.
    """
    if span.start >= span.stop:
        return value_before(y, span)
    return extremes(y[span]).max(axis=(0, 1))


def minimum(y: Array, span: slice) -> Array:
    """Returns the smallest value of each component; see maximum()."""
    return -maximum(-y, span)


def extremes(y: Array) -> Array:
    """Returns values of a signal between which it is monotonic (p, 9, ...).

    They are in the order of time: those at the points of each piece, and between two of
    them the extreme or, if there is none, the one before again.
    """
    columns = y.reshape(*y.shape[:2], -1)
    powers = _powers(columns)
    slope = polyder(powers)
    is_up = polyval(NODES, slope) >= 0
    values = np.repeat(columns, 2, axis=1)[:, :-1]
    # Between two points of a piece the slope changes its sign.
    piece, column, node = np.nonzero(is_up[..., 1:] != is_up[..., :-1])
    was_up = is_up[piece, column, node]
    own_slope = slope[:, piece, column]
    share = bisect(
        lambda x: (polyval(x, own_slope, tensor=False) >= 0) == was_up,
        NODES[node],
        NODES[node + 1],
        _ROUNDS_TO_EXTREMES,
    )
    extreme = polyval(share, powers[:, piece, column], tensor=False)
    values[piece, 2 * node + 1, column] = extreme
    return values.reshape(len(y), -1, *y.shape[2:])


def variation(y: Array) -> Array:
    """Returns the total variation of each component of a signal, jumps included."""
    values = extremes(y)
    values = values.reshape(-1, *values.shape[2:])
    return np.abs(np.diff(values, axis=0)).sum(axis=0)


def rms(y: Array, length: Array) -> Array:
    """Returns the root of the mean square over time of each component (n).

    Args:
        y: The signal (p, 5, n).
        length: Of the pieces, s (p).
    """
    products = products_of_values(DEGREE).sum(axis=0)
    squares = (y * (products @ y)).sum(axis=1)
    return np.sqrt(length @ squares / length.sum())


def integral(y: Array, length: Array, start: Array) -> Array:
    """Returns the integral of a signal over time as a signal in pieces (p, 5, n).

    Args:
        y: The signal (p, 5, n).
        length: Of the pieces, s (p).
        start: Where it begins (n).
    """
    powers = np.arange(1, DEGREE + 2)
    to_integral = NODES[:, None] ** powers / powers @ to_powers(DEGREE)
    within = to_integral @ y * length[:, None, None]
    ends = np.cumsum(within[:, -1], axis=0)
    before = np.concatenate([np.zeros_like(ends[:1]), ends[:-1]])
    return start + before[:, None] + within


class Band(NamedTuple):
    """A vector that has come to rest where it stays this near to a centre.

    Attributes:
        y: The vector in pieces (p, 5, n).
        centre: (n).
        radius: The distance at which it is not at rest any more.
    """

    y: Array
    centre: Array
    radius: float


def settling_time(pieces: Pieces, span: slice, bands: Sequence[Band]) -> float | None:
    """Returns how long it takes until vectors stay in their bands, s.

    Args:
        pieces: Of the run.
        span: The pieces from when on it is looked at.
        bands: The vectors.

    Returns:
        None if a vector is outside at the end, or if all were inside for as long before
        without staying so: a run that happens to end as a vector passes has not
        settled.
    """
    if span.start >= span.stop:
        return None
    begin = pieces.begin[span]
    length = pieces.end[span] - begin
    powers = [_powers(band.y[span] - band.centre) for band in bands]

    def is_outside(piece: Indices, share: Array) -> Array:
        is_out = np.zeros(share.shape, dtype=bool)
        for band, own in zip(bands, powers, strict=True):
            offset = polyval(share[..., None], own[:, piece], tensor=False)
            is_out |= np.linalg.norm(offset, axis=-1) >= band.radius
        return is_out

    # The state at the points in the order of time, and where it is not the one before.
    piece, node = np.indices((len(begin), DEGREE + 1)).reshape(2, -1)
    is_moving = is_outside(piece, NODES[node])
    if is_moving[-1]:
        return None
    was_moving = np.concatenate([[False], is_moving[:-1]])
    changes = np.flatnonzero(is_moving != was_moving)
    piece = piece[changes]
    node = node[changes]
    was_moving = was_moving[changes]
    share = bisect(
        lambda x: is_outside(piece, x) == was_moving,
        NODES[np.maximum(node - 1, 0)],
        NODES[node],
    )
    times = begin[piece] + share * length[piece]
    # Each rest lasts from a change to the next one, the first one from the begin.
    limits = [begin[0], *times.tolist(), pieces.end[-1]]
    rests = np.diff(limits)[::2]
    if rests[-1] <= rests[:-1].max(initial=0.0):
        return None
    return float(limits[-2] - begin[0])


def _powers(y: Array) -> Array:
    """Returns the coefficients of ascending powers (5, k, ...) of quartics in [0, 1].

    Those of a constant are exactly 0 but for the first one.
    """
    first = y[:, 0]
    powers = np.tensordot(to_powers(DEGREE), y - y[:, :1], axes=(1, 1))
    powers[0] += first
    return powers
