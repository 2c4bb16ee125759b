"""Signals in steps: in each step a polynomial through points of that step.

A step is d + 1 rows of a recording at equal distances in time, its ends among them: a
row of `steps` (S, d + 1) has their indices. Two steps share the row between them, but
where something jumps or bends: there each has a row of its own. So no polynomial
reaches across such an instant. In a step a signal is the polynomial of degree d through
its values (S, d + 1, k), `values[steps]`.
"""

import math
from functools import cache

import numpy as np

from teleop_drake.arrays import Array, Indices

Series = tuple[Array, dict[str, Array], Indices]

DEGREE = 4
"""Of the polynomials of a run: three rows between the ends of a step."""


@cache
def shares(degree: int) -> Array:
    """Returns where in a step its points are (d + 1), from 0 to 1."""
    return np.linspace(0.0, 1.0, degree + 1)


@cache
def to_powers(degree: int) -> Array:
    """Returns the matrix from values to coefficients of ascending powers."""
    powers = np.vander(shares(degree), increasing=True)
    return np.asarray(np.linalg.inv(powers), np.float64)


@cache
def products_of_values(degree: int) -> Array:
    """Returns the integrals of the products of Lagrange's polynomials.

    From each point of the step to the next one: (d, d + 1, d + 1).
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
    """Returns steps (S, 2) from each row to the next one, jumps left out.

    Args:
        times: (N,) of the rows; two equal ones mark a jump.
    """
    first = np.flatnonzero(np.diff(times) > 0)
    return np.stack([first, first + 1], axis=1)


def lagrange(at: Array, degree: int) -> Array:
    """Returns the weights (..., d + 1) of a step's values in the value at a share.

    At the points of the step they are exactly 0 and 1.

    Args:
        at: (...,) shares of a step, 0 at its begin and 1 at its end.
    """
    nodes = shares(degree)
    weights = []
    for k, node in enumerate(nodes):
        others = np.delete(nodes, k)
        weights.append(math.prod((at - x) / (node - x) for x in others))
    return np.stack(weights, axis=-1)


def interpolate(times: Array, values: Array, steps: Indices, query: Array) -> Array:
    """Returns a signal (M, k) at any times, before a jump at the instant of the jump.

    Args:
        times: (N,) of the rows.
        values: (N, k) rows of the signal.
        steps: (S, d + 1).
        query: (M,) times, clamped to the span of the steps.
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
    """Returns times, signals and steps between two instants.

    Args:
        series: Times (N,), signals (N, k) by name, steps.
        begin: From when on, s. A step that begins before is cut there.
        end: Until when, s, later.
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


def finite_part(series: Series) -> Series:
    """Returns the steps before the first row that is not finite; none if it is first.

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
    """Returns the integrals (S, d, k) of the product of two signals, exactly.

    From each point of a step to the next one, over the share of the step.

    Args:
        first: (S, d + 1, k) a signal in its steps.
    """
    mass = products_of_values(first.shape[1] - 1)
    return np.einsum("sak,jab,sbk->sjk", first, mass, second, optimize=True)
