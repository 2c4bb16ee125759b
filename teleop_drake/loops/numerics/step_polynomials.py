"""Recorded signals as piecewise polynomials, one polynomial for each step.

A step consists of d + 1 rows of a recording, equally spaced in time, both ends
included. The array `steps` (S, d + 1) contains the indices of these rows. Adjacent
steps share the row between them. Where a signal jumps or bends, each step has its own
row instead, so that no polynomial reaches across such an instant. Within a step a
signal is the polynomial of degree d through its values `values[steps]` (S, d + 1, k).
"""

import math
from functools import cache

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.numerics.instants import TIE

Series = tuple[Array, dict[str, Array], Indices]
"""A recording: times (N,) in s, signals (N, k) by name, and steps (S, d + 1)."""

DEGREE = 4
"""The degree of the polynomials of a run: a step has three rows between its ends."""


@cache
def shares(degree: int) -> Array:
    """Returns the points of a step as shares of its length, from 0 to 1 (d + 1)."""
    return np.linspace(0.0, 1.0, degree + 1)


@cache
def to_powers(degree: int) -> Array:
    """Returns the matrix from values at a step's points to ascending powers."""
    powers = np.vander(shares(degree), increasing=True)
    return np.asarray(np.linalg.inv(powers), np.float64)


@cache
def products_of_values(degree: int) -> Array:
    """Returns the integrals of products of two Lagrange polynomials (d, d + 1, d + 1).

    The first index is the interval between two neighbouring points of the step; the
    other two are the polynomials.
    """
    powers = np.arange(degree + 1)
    powers = powers[:, None] + powers + 1
    nodes = shares(degree)[:, None, None]
    hilbert = (nodes[1:] ** powers - nodes[:-1] ** powers) / powers
    return to_powers(degree).T @ hilbert @ to_powers(degree)


def steps_of(row_ends: Indices) -> Indices:
    """Returns the steps (S, 5) of a run.

    Args:
        row_ends: (N,) 1 for each row at the end of a step, else 0.
    """
    ends = np.flatnonzero(row_ends)
    steps: Indices = ends[:, np.newaxis] + np.arange(-DEGREE, 1)
    return steps


def straight_steps(times: Array) -> Indices:
    """Returns steps of degree 1 (S, 2) between neighbouring rows, except at jumps.

    Args:
        times: The times of the rows (N,); two equal ones mark a jump.
    """
    first = np.flatnonzero(np.diff(times) > 0)
    return np.stack([first, first + 1], axis=1)


def lagrange(at: Array, degree: int) -> Array:
    """Returns the interpolation weights (..., d + 1) of a step's values.

    At the points of the step the weights are exactly 0 or 1.

    Args:
        at: Points as shares of the step's length (...,), 0 at its start and 1 at its
            end.
        degree: The degree d of the polynomial.
    """
    nodes = shares(degree)
    weights = []
    for k, node in enumerate(nodes):
        others = np.delete(nodes, k)
        weights.append(math.prod((at - x) / (node - x) for x in others))
    return np.stack(weights, axis=-1)


def interpolate(times: Array, values: Array, steps: Indices, query: Array) -> Array:
    """Returns a signal at any times (M, k); at a jump, the value before it.

    Args:
        times: The times of the rows (N,).
        values: The signal in the rows (N, k).
        steps: The steps (S, d + 1).
        query: The times (M,), clamped to the span of the steps.
    """
    if len(steps) == 0:
        return np.repeat(values[-1:], len(query), axis=0)
    begin = times[steps[:, 0]]
    end = times[steps[:, -1]]
    i = np.clip(np.searchsorted(begin, query) - 1, 0, None)
    at = np.clip((query - begin[i]) / (end[i] - begin[i]), 0.0, 1.0)
    weights = lagrange(at, steps.shape[1] - 1)
    return np.einsum("ma,mak->mk", weights, values[steps[i]])


def part(series: Series, begin: float, end: float) -> Series:
    """Returns the part of a series between two instants.

    A step that crosses one of the instants is cut there: its rows are moved into the
    part that remains, and the signals are interpolated. Without a step in between, the
    result is the first row and no step.

    Args:
        series: Times (N,), signals (N, k) by name, steps.
        begin: The first instant in s.
        end: The last instant in s, later.
    """
    times, signals, steps = series
    starts = times[steps[:, 0]]
    ends = times[steps[:, -1]]
    kept = np.flatnonzero((ends > begin) & (starts < end))
    if len(kept) == 0:
        return times[:1], {name: x[:1] for name, x in signals.items()}, steps[:0]
    i = kept[0]
    j = kept[-1]
    # Both sides of a jump at an end are kept.
    first = min(steps[i, 0], np.searchsorted(times, begin))
    last = max(steps[j, -1], np.searchsorted(times, end, "right") - 1)
    rows = slice(first, last + 1)
    new_times = times[rows].copy()
    new_signals = {name: x[rows].copy() for name, x in signals.items()}
    # Only the first and the last step can be cut.
    for k in {i, j}:
        low = max(starts[k], begin)
        high = min(ends[k], end)
        if low == starts[k] and high == ends[k]:
            continue
        own = steps[k] - first
        nodes = low + shares(steps.shape[1] - 1) * (high - low)
        new_times[own] = nodes
        for name, x in signals.items():
            new_signals[name][own] = interpolate(times, x, steps[k : k + 1], nodes)
    return new_times, new_signals, steps[kept] - first


def thinned(series: Series, period: float) -> Series:
    """Returns the rows of a series at multiples of a period after its first instant.

    The last instant is added. At a jump, a row has the values before it, as a log of
    Drake's has; also at the first instant. Between the rows the signals are straight
    lines.

    Args:
        series: Times (N,), signals (N, k) by name, steps.
        period: The time between rows, s.
    """
    times, signals, steps = series
    new_times = times_every(period, times[0], times[-1])
    new_signals = {
        name: interpolate(times, x, steps, new_times) for name, x in signals.items()
    }
    for name, x in signals.items():
        new_signals[name][0] = x[0]
        new_signals[name][-1] = x[-1]
    return new_times, new_signals, straight_steps(new_times)


def times_every(period: float, begin: float, end: float) -> Array:
    """Returns the multiples of a period after an instant, and the last instant, in s.

    Args:
        period: The time between two of them, s.
        begin: The first one, s.
        end: The last one, s.
    """
    num_periods = math.floor((end - begin) / period + TIE)
    times = begin + period * np.arange(num_periods + 1)
    return np.append(times[times < end - TIE * period], end)


def finite_part(series: Series) -> Series:
    """Returns the part of a series before its first row that is not finite.

    Without a complete step before that row, the result is the first row, or no row if
    the first one is not finite, and no step.

    Args:
        series: Times (N,), signals (N, k) by name, steps.
    """
    times, signals, steps = series
    columns = [times[:, np.newaxis], *signals.values()]
    is_finite = np.isfinite(np.hstack(columns))
    if is_finite.all():
        return series
    count = int(np.argmin(is_finite.all(axis=1)))
    steps = steps[steps[:, -1] < count]
    count = int(steps[-1, -1]) + 1 if len(steps) else min(count, 1)
    return times[:count], {name: x[:count] for name, x in signals.items()}, steps


def integrate_product(first: Array, second: Array) -> Array:
    """Returns the exact integrals of the product of two signals in steps (S, d, k).

    Each integral reaches from one point of a step to the next one. The variable is the
    share of the step, so the result is to be multiplied by the step's length.

    Args:
        first: The values of a signal in its steps (S, d + 1, k).
        second: The values of the other signal (S, d + 1, k).
    """
    mass = products_of_values(first.shape[1] - 1)
    return np.einsum("sak,jab,sbk->sjk", first, mass, second, optimize=True)
