"""Metrics of signals in pieces; see loops.numerics.pieces.

All of them are exact for the polynomials of a run.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from teleop_drake.loops.framework.arrays import Array, Flags, Indices
from teleop_drake.loops.numerics.pieces import (
    NODES,
    Pieces,
    changes_of,
    powers_of,
)
from teleop_drake.loops.numerics.step_polynomials import (
    DEGREE,
    products_of_values,
    to_powers,
)

# The rounds of bisection for an extreme, where the value is much more accurate than the
# instant.
_ROUNDS_TO_EXTREMES = 4


def first_after(time: float | None, times: Iterable[float]) -> float | None:
    """Returns the first of the instants `times` after `time`, s.

    The result is None if `time` is None or no instant is later.
    """
    if time is None:
        return None
    return next((t for t in times if t > time), None)


def value_before(y: Array, span: slice) -> Array:
    """Returns the value of a signal (p, m, ...) just before a span of pieces.

    If the span begins with the first piece, it is the signal's first value.
    """
    if span.start == 0:
        return y[0, 0]
    return y[span.start - 1, -1]


def values_in(y: Array, span: slice) -> Array:
    """Returns the values of a signal in a span of pieces (s, m, ...).

    For an empty span it is the value just before the span.
    """
    if span.start >= span.stop:
        return value_before(y, span)
    return y[span]


def extremes(y: Array) -> Array:
    """Returns values of a signal between which it is monotonic (p, 9, ...).

    In the order of time, they are the values at the five points of each piece and,
    between two points, the extreme value there. Without an extreme in between, the
    value at the point before is repeated.
    """
    columns = y.reshape(*y.shape[:2], -1)
    values = np.repeat(columns, 2, axis=1)[:, :-1]
    # The coefficients of one polynomial for each component of each piece.
    powers = powers_of(columns).reshape(DEGREE + 1, -1)
    slope = polyder(powers)
    index, node, share = changes_of(
        lambda index, x: polyval(x, slope[:, index], tensor=False) >= 0,
        polyval(NODES, slope) >= 0,
        _ROUNDS_TO_EXTREMES,
    )
    piece, column = np.divmod(index, columns.shape[2])
    extreme = polyval(share, powers[:, index], tensor=False)
    values[piece, 2 * node + 1, column] = extreme
    return values.reshape(len(y), -1, *y.shape[2:])


def variation(values: Array) -> Array:
    """Returns the total variation of each component, jumps included.

    Args:
        values: The extremes() of a signal.
    """
    in_order = values.reshape(-1, *values.shape[2:])
    return np.abs(np.diff(in_order, axis=0)).sum(axis=0)


def rms(y: Array, length: Array) -> Array:
    """Returns the root of the mean square over time of each component (n).

    Args:
        y: The signal (p, 5, n).
        length: The length of each piece, s (p).
    """
    products = products_of_values(DEGREE).sum(axis=0)
    squares = (y * (products @ y)).sum(axis=1)
    return np.sqrt(length @ squares / length.sum())


def integral(y: Array, length: Array, start: Array) -> Array:
    """Returns the integral of a signal over time as a signal in pieces (p, 5, n).

    Args:
        y: The signal (p, 5, n).
        length: The length of each piece, s (p).
        start: The initial value of the integral (n).
    """
    powers = np.arange(1, DEGREE + 2)
    to_integral = NODES[:, None] ** powers / powers @ to_powers(DEGREE)
    within = to_integral @ y * length[:, None, None]
    before = np.cumsum(within[:, -1], axis=0) - within[:, -1]
    return start + before[:, None] + within


class Band(NamedTuple):
    """A vector and the band around a centre in which it counts as at rest.

    Attributes:
        offset: The vector minus its centre, in pieces (p, 5, n).
        radius: The distance from the centre at which the band ends.
    """

    offset: Array
    radius: float


def settling_time(pieces: Pieces, span: slice, bands: Sequence[Band]) -> float | None:
    """Returns the time in s from the start of a span until vectors stay in their bands.

    Args:
        pieces: The pieces of the run.
        span: The pieces that are examined.
        bands: The vectors with their bands.

    Returns:
        The time, or None if a vector is outside its band at the end, or if an earlier
        rest that did not last was at least as long as the final one. A run that ends
        while a vector is passing through its band has not settled.
    """
    if span.start >= span.stop:
        return None
    begin = pieces.begin[span]
    powers = [powers_of(band.offset[span]) for band in bands]

    def is_outside(piece: Indices, share: Array) -> Flags:
        x = share[..., np.newaxis]
        is_out = [
            np.linalg.norm(polyval(x, own[:, piece], tensor=False), axis=-1) >= radius
            for own, (_, radius) in zip(powers, bands, strict=True)
        ]
        return np.logical_or.reduce(is_out)

    is_moving = is_outside(np.arange(len(begin))[:, np.newaxis], NODES)
    if is_moving[-1, -1]:
        return None
    piece, _, share = changes_of(is_outside, is_moving)
    # The condition may jump between two pieces and at the start.
    was_moving = np.append(False, is_moving[:-1, -1])
    changes = np.append(
        begin[was_moving != is_moving[:, 0]],
        begin[piece] + share * pieces.length[span][piece],
    )
    # Rest and motion alternate. The vectors count as at rest before the start, so each
    # second interval, from the first one on, is a rest.
    limits = [begin[0], *np.sort(changes), pieces.end[-1]]
    rests = np.diff(limits)[::2]
    if rests[-1] <= rests[:-1].max(initial=0.0):
        return None
    return float(limits[-2] - begin[0])
