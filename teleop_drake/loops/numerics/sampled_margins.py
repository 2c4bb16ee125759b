"""Stability margins of a sampled loop at a port, and its response at the sampler.

The loop that u(t) = k y(t - T) closes is stable if its lifted map has no root of a
magnitude of 1 or more, neutral roots at 1 apart. The margins are searched from the
actual loop, k = 1 and T = 0, on a grid, and located by bisection. If that loop is
unstable, so are the gains and the delays at which it is stable. A range that lies
between two neighbouring points of the grid is not found.
"""

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array, ComplexArray, Interval
from teleop_drake.loops.numerics.margins import LARGEST_GAIN, Margins
from teleop_drake.loops.numerics.sample_schedule import common_period
from teleop_drake.loops.numerics.sampled_loop import SampledLoop, lift

# The number of gains that are searched from 1 to LARGEST_GAIN, and to its inverse.
_NUM_GAINS = 100
_NUM_PHASES = 90

# The delays that are searched: so many of the shortest periods, and points in a period.
# The number of points is no integer, so that delays are no multiples of the period.
NUM_PERIODS = 40
_POINTS_IN_PERIOD = 5.83

# A loop counts as unstable if a root has a magnitude of 1 and this more.
_BEYOND = 1e-11

# Two roots nearer than this count as the same root at 1.
_NEUTRAL = 1e-6

_ACCURACY = 1e-11


class _Edge(NamedTuple):
    """The value at which a loop becomes unstable.

    Attributes:
        value: The value.
        angle: The angle of the root that passes the unit circle there, rad, 0 to pi.
    """

    value: float
    angle: float = 0.0


class _Search:
    """The search for the changes that make a loop unstable.

    Args:
        loop: The open loop.
    """

    def __init__(self, loop: SampledLoop):
        self._loop = loop
        shortest = min(clock.period for clock in loop.clocks)
        # Roots at 1 that no gain and no delay moves stand for a set of equilibria.
        others = (loop.closed(), loop.closed(0.93), loop.closed(1.0, 0.31 * shortest))
        self._num_neutral = min(
            int(np.sum(np.abs(other.roots() - 1) < _NEUTRAL)) for other in others
        )

    def roots(self, gain: complex = 1.0, delay: float = 0.0) -> ComplexArray:
        """Returns the roots of a changed loop except the neutral ones."""
        roots = self._loop.closed(gain, delay).roots()
        order = np.argsort(np.abs(roots - 1))
        return roots[order[self._num_neutral :]]

    def first(
        self,
        grid: list[float],
        change: Callable[[float], ComplexArray],
        otherwise: float = math.inf,
    ) -> _Edge:
        """Returns the first value on a grid at which a loop becomes unstable.

        Args:
            grid: Values, of which the loop is stable at the first one.
            change: A function that returns the roots at a value.
            otherwise: The value of the result if the loop is stable on the whole grid.
        """
        for stable, unstable in itertools.pairwise(grid):
            if _is_unstable(change(unstable)):
                return _edge(stable, unstable, change)
        return _Edge(otherwise)

    def windows(
        self, grid: list[float], change: Callable[[float], ComplexArray]
    ) -> list[Interval]:
        """Returns the intervals in which a loop is stable, those of a grid's points.

        An end at an end of the grid is that of the grid.

        Args:
            grid: Ascending values.
            change: A function that returns the roots at a value.
        """
        stable = [not _is_unstable(change(value)) for value in grid]
        ends = [grid[0]] if stable[0] else []
        for k in np.flatnonzero(np.diff(stable)).tolist():
            inside, outside = (k, k + 1) if stable[k] else (k + 1, k)
            ends.append(_edge(grid[inside], grid[outside], change).value)
        ends += [grid[-1]] if stable[-1] else []
        return list(zip(ends[::2], ends[1::2], strict=True))


def _edge(
    inside: float, outside: float, change: Callable[[float], ComplexArray]
) -> _Edge:
    """Locates the edge between a value with a stable loop and another one."""
    while abs(outside - inside) > _ACCURACY * max(abs(outside), 1e-3):
        middle = (inside + outside) / 2
        if _is_unstable(change(middle)):
            outside = middle
        else:
            inside = middle
    roots = change(outside)
    root = roots[np.argmax(np.abs(roots))]
    return _Edge(outside, abs(float(np.angle(root))))


def _is_unstable(roots: ComplexArray) -> bool:
    return bool(np.abs(roots).max(initial=0.0) > 1 + _BEYOND)


def sampled_margins(loop: SampledLoop, *, remedies: bool = True) -> Margins:
    """Returns the stability margins of a sampled loop at its port.

    The delay is searched up to NUM_PERIODS of the shortest period; infinity: there is
    no limit up to there. Its frequency is the lowest that its roots can mean.

    Args:
        loop: The open loop from u to y.
        remedies: Whether to search for what stabilises an unstable loop.

    Raises:
        ContinuousDelayLoop: If a delay is in a loop without a discrete state.
        ScenarioError: If the periods are not commensurate.
    """
    search = _Search(loop)
    gains = np.geomspace(1.0, LARGEST_GAIN, _NUM_GAINS)
    shortest = min(clock.period for clock in loop.clocks)
    num_delays = math.ceil(NUM_PERIODS * _POINTS_IN_PERIOD)
    longest = (num_delays - 1) * shortest / _POINTS_IN_PERIOD
    delays = np.linspace(0.0, longest, num_delays)
    if _is_unstable(search.roots()):
        if not remedies:
            return Margins(is_stable=False)
        return _remedies(search, gains, delays)
    upper = search.first(gains.tolist(), search.roots)
    lower = search.first((1 / gains).tolist(), search.roots, otherwise=0.0)
    phases = np.linspace(0.0, math.pi, _NUM_PHASES)
    # A real loop has the same margin against a phase of the other sign.
    ahead = search.first(
        phases.tolist(), lambda phase: search.roots(np.exp(1j * phase))
    )
    late = search.first(delays.tolist(), lambda delay: search.roots(delay=delay))
    period = common_period(loop.clocks)
    return Margins(
        is_stable=True,
        delay=late.value,
        frequency=late.angle / period,
        phase=ahead.value,
        phase_frequency=ahead.angle / period,
        gain=(lower.value, upper.value),
        gain_frequencies=(lower.angle / period, upper.angle / period),
    )


def _remedies(search: _Search, gains: Array, delays: Array) -> Margins:
    """Returns the gains and the delays that stabilise an unstable loop.

    Args:
        search: The search.
        gains: The gains from 1 on that are searched, and whose inverses are.
        delays: The delays in s that are searched.
    """
    sizes = np.concatenate([1 / gains[:0:-1], gains])
    windows: list[Interval] = []
    for signed in (sizes, -sizes[::-1]):
        windows = windows or search.windows(signed.tolist(), search.roots)
    low, high = 1 / LARGEST_GAIN, LARGEST_GAIN
    beyond = {low: 0.0, -low: 0.0, high: math.inf, -high: -math.inf}
    late = search.windows(delays.tolist(), lambda delay: search.roots(delay=delay))
    return Margins(
        is_stable=False,
        stable_gains=tuple((beyond.get(a, a), beyond.get(b, b)) for a, b in windows),
        stable_delays=tuple(late),
    )


def sampled_response(
    loop: SampledLoop, sampled: list[int], frequencies: Array
) -> ComplexArray:
    """Returns the response L(exp(j w h)) of a loop that is cut at a sampled signal.

    Args:
        loop: The open loop. Its input enters the updates of the discrete states
            `sampled` only, all of which have the period h, the common period of all.
        frequencies: w in rad/s, up to pi/h (K).

    Returns:
        The response (K, p, p).
    """
    lifted = lift(loop, sampled)
    return lifted.response(frequencies * lifted.period)
