"""Polynomials of many intervals at once: what interpolation does for one, in arrays.

They are those of interpolation.limited_polynomial(), bit for bit, without machine code,
which a loop over the intervals would need.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NUM_STENCIL_POINTS = 8
"""The error of a smooth signal is O(step^8), well below that of the fifth-order
integrator which made the samples."""

CONVERGED = 1 / 32
"""The last two terms of a series that converges are at most this share of the largest.
Twelve samples in a period of a sine reach it even if all lie on one side."""

# How many samples on either side of an interval its polynomial may use.
_REACH = NUM_STENCIL_POINTS - 2

# How many intervals are in memory at a time.
_BLOCK = 4096


def newton_polynomials(
    times: Array, values: Array, intervals: Indices, is_cautious: bool = True
) -> Array:
    """Returns interpolation.limited_polynomial() of several intervals.

    Args:
        times: (N,) non-decreasing sample times; two equal ones mark a jump.
        values: (N, k) samples.
        intervals: (M,) indices of the intervals.
        is_cautious: Whether what cannot be trusted is drawn towards the chord; else it
            is a parabola.

    Returns:
        Nodes and coefficients, (2, NUM_STENCIL_POINTS, M, k).
    """
    result = np.zeros((2, NUM_STENCIL_POINTS, len(intervals), values.shape[1]))
    is_jump = times[intervals] == times[intervals + 1]
    result[1, 0, is_jump] = values[intervals[is_jump]]
    places = np.flatnonzero(~is_jump)
    bounds = _segments(times)
    with np.errstate(all="ignore"):  # What is beyond the samples is not used.
        for start in range(0, len(places), _BLOCK):
            block = places[start : start + _BLOCK]
            windows = _windows(times, intervals[block], bounds)
            nodes, coefficients = _newton(times, values, *windows)
            series = nodes, coefficients
            _limit(times, values, intervals[block], windows, series, is_cautious)
            result[0][:, block], result[1][:, block] = nodes, coefficients
    return result


def _segments(times: Array) -> tuple[Indices, Indices]:
    """Returns the first and the last sample (N,) that no jump parts from a sample."""
    places = np.arange(len(times))
    is_jump = times[1:] == times[:-1]
    firsts = np.where(np.concatenate([[True], is_jump]), places, 0)
    lasts = np.where(np.concatenate([is_jump, [True]]), places, len(times))
    return (
        np.maximum.accumulate(firsts),
        np.minimum.accumulate(lasts[::-1])[::-1],
    )


def _windows(
    times: Array, i: Indices, bounds: tuple[Indices, Indices]
) -> tuple[Indices, Indices, Indices]:
    """Returns the samples (M, 2 _REACH + 2) of interpolation.fill_window().

    Interval i begins in column _REACH. Besides returns the first column that is used,
    and the one after the last (M, 1).
    """
    spacing = (times[i + 1] - times[i]) / 4
    samples = np.repeat(i[:, np.newaxis], 2 * _REACH + 2, axis=1)
    samples[:, _REACH + 1] = i + 1
    first, end = (np.full(len(i), n) for n in (_REACH, _REACH + 2))
    last = len(times) - 1
    nearest, is_open = times[i], np.ones(len(i), bool)
    for column in range(_REACH - 1, -1, -1):
        j = np.searchsorted(times, nearest - spacing, side="right") - 1
        # The sum may have been rounded to the other side of a sample.
        j -= ~(nearest - times[j] >= spacing)
        j += nearest - times[np.minimum(j + 1, last)] >= spacing
        is_open &= j >= bounds[0][i]
        first -= is_open
        samples[is_open, column] = j[is_open]
        nearest = np.where(is_open, times[j], nearest)
    nearest, is_open = times[i + 1], np.ones(len(i), bool)
    for column in range(_REACH + 2, 2 * _REACH + 2):
        j = np.searchsorted(times, nearest + spacing)
        j += ~(times[np.minimum(j, last)] - nearest >= spacing)
        j -= times[np.minimum(j - 1, last)] - nearest >= spacing
        is_open &= j <= bounds[1][i + 1]
        end += is_open
        samples[is_open, column] = j[is_open]
        nearest = np.where(is_open, times[np.minimum(j, last)], nearest)
    return samples, first[:, np.newaxis], end[:, np.newaxis]


def _newton(
    times: Array, values: Array, samples: Indices, first: Indices, end: Indices
) -> tuple[Array, Array]:
    """Returns the nodes and coefficients of interpolation.fit_series() of windows."""
    t, differences = times[samples], values[samples]
    size, k = len(samples), values.shape[1]
    rows, signals = np.arange(size)[:, np.newaxis], np.arange(k)
    nodes, coefficients = np.zeros((2, NUM_STENCIL_POINTS, size, k))
    left = np.full((size, k), _REACH)
    nodes[0], coefficients[0] = t[:, _REACH, np.newaxis], differences[:, _REACH]
    for order in range(1, NUM_STENCIL_POINTS):
        gaps = t[:, order:] - t[:, :-order]
        differences = (differences[:, 1:] - differences[:, :-1]) / gaps[:, :, None]
        exists = order < end - first
        # Towards the side on which the divided differences are smaller; the first one
        # makes the line through both ends of the interval.
        on_left = np.abs(differences[rows, np.maximum(left - 1, 0), signals])
        on_right = np.abs(differences[rows, left, signals])
        grows = (left + order == end) | (on_left < on_right)
        grows &= exists & (left > first) & (order > 1)
        left = left - grows
        new = np.where(grows, left, left + order)
        nodes[order] = np.where(exists, t[rows, new], 0.0)
        coefficients[order] = np.where(exists, differences[rows, left, signals], 0.0)
    return nodes, coefficients


def _limit(
    times: Array,
    values: Array,
    i: Indices,
    windows: tuple[Indices, Indices, Indices],
    series: tuple[Array, Array],
    is_cautious: bool,
) -> None:
    """Ends and scales series in place, as interpolation.limit_series() does."""
    nodes, coefficients = series
    begin, end = times[i][:, np.newaxis], times[i + 1][:, np.newaxis]
    num_terms = np.minimum(windows[2] - windows[1], NUM_STENCIL_POINTS)
    terms = np.zeros_like(coefficients)
    factor = (end - begin) * (end - begin) / 4
    for m in range(2, NUM_STENCIL_POINTS):
        terms[m] = np.abs(coefficients[m]) * factor
        factor = factor * np.maximum(np.abs(begin - nodes[m]), np.abs(end - nodes[m]))
    last = np.minimum(3, num_terms - 1)
    remainder = terms[2:4].max(axis=0)
    falls = np.ones(remainder.shape, bool)
    for m in range(4, NUM_STENCIL_POINTS):
        pair = np.maximum(terms[m - 1], terms[m])
        falls &= (m < num_terms) & (pair <= remainder)
        last = np.where(falls, m, last)
        remainder = np.where(falls, pair, remainder)
    is_used = np.arange(NUM_STENCIL_POINTS)[:, np.newaxis, np.newaxis] <= last
    terms = np.where(is_used, terms, 0.0)
    deviation = 4 * terms.sum(axis=0)
    change = np.abs(values[i + 1] - values[i])
    is_unsure = (remainder > CONVERGED * terms.max(axis=0)) & (change < deviation)
    coefficients *= is_used
    if is_cautious:
        coefficients[2:] *= np.where(is_unsure, change / deviation, 1.0)
    else:
        coefficients[3:] *= ~is_unsure
