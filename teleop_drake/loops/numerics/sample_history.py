"""Stored samples of a delayed signal, and their interpolation.

Between two samples the signal is an essentially non-oscillatory (ENO) polynomial, as
accurate as the integrator's steps that made the samples. Its stencil is the set of
samples that it passes through. The stencil never reaches across a jump. It grows
towards the side on which the divided differences are smaller, and so away from
non-smooth points, whose positions are not given. The polynomial's Newton series is
truncated where its terms stop decreasing. If they are not small there, the polynomial
is scaled towards the chord until it stays between the two samples.

Sources: A. Harten, B. Engquist, S. Osher, S. R. Chakravarthy, "Uniformly high order
accurate essentially non-oscillatory schemes, III", J. Comput. Phys. 71 (1987); for the
scaling towards the chord X. Zhang, C.-W. Shu, "On maximum-principle-satisfying high
order schemes for scalar conservation laws", J. Comput. Phys. 229 (2010).
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import sub, truediv
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array

# Points of a stencil: its error is O(step^8), well below the integrator's.
_NUM_POINTS = 8

# The number of samples on either side of an interval, beyond the interval's two ends,
# that its polynomial may use.
_REACH = _NUM_POINTS - 2

# A series counts as convergent if its last two terms are at most this share of the
# largest one. Twelve samples per period of a sine suffice for that, even if the stencil
# lies on one side of the interval.
_CONVERGED = 1 / 32

NUM_KEPT = 32
"""The number of samples that stay in the history after their delivery."""


@dataclass(frozen=True, eq=False)
class SampleHistory:
    """The samples of a vector signal in a delay, in ascending order of time.

    The object is immutable, so that its copy is the object itself: a Context can be
    cloned at every step without copying the samples.

    Attributes:
        times: The time at which each sample was taken or will arrive, s; two equal
            times mark a jump.
        values: The samples (k each).
        now: The time in `times` up to which the signal has been delivered, s.
        bends: Further times at which a step of the solver must end, s; jumps among the
            samples are not repeated here.
        polynomials: A cache of eval(), keyed by the index of the interval. The
            polynomial of the interval that contains `now` is fixed when the signal
            enters the interval. A later sample could enlarge its stencil and so move
            the signal, by the interpolation error, at the time of that sample. All
            other polynomials are functions of the samples.
    """

    times: tuple[float, ...] = ()
    values: tuple[Array, ...] = ()
    now: float = -math.inf
    bends: tuple[float, ...] = ()
    polynomials: dict[int, "EnoPolynomial"] = field(default_factory=dict)

    def __deepcopy__(self, memo: dict[int, Any]) -> "SampleHistory":
        return self

    def append(
        self, time: float, value: Array, *, now: float, spacing: float
    ) -> "SampleHistory":
        """Returns the history with one more sample.

        Samples that were delivered long ago and redundant samples are left out.

        Args:
            time: The time of the sample in s, not less than the last one.
            value: The sample (k).
            now: The time up to which the signal has been delivered, s.
            spacing: The distance in s below which samples are redundant: the last
                sample is left out if its neighbours are closer together than this.
        """
        keep = len(self.times)
        if (
            keep >= 2
            and self.times[-2] < self.times[-1] < time
            and time - self.times[-2] < spacing
        ):
            keep -= 1  # The last sample is redundant.
        # The stencils of the interval in use reach back to some delivered samples.
        first = max(0, bisect_left(self.times, now, 0, keep) - NUM_KEPT)
        # Only the polynomial of the interval in use is handed on: see `polynomials`.
        polynomials = {}
        i = self._interval(now)
        if 0 <= i < keep - 1 and self.times[i] < self.times[i + 1]:
            polynomials[i - first] = self.polynomial(i)
        return SampleHistory(
            times=(*self.times[first:keep], time),
            values=(*self.values[first:keep], np.array(value)),
            now=now,
            bends=tuple(bend for bend in self.bends if bend >= now),
            polynomials=polynomials,
        )

    def jumps_after(self, time: float) -> list[float]:
        """Returns the instants in s after a time at which the signal starts or jumps.

        They include `bends`. Jumps after the last sample are not known yet.
        """
        ahead = self.times[bisect_right(self.times, time) :]
        jumps = [t for t, after in pairwise(ahead) if t == after]
        bends = [bend for bend in self.bends if bend > time]
        starts = [t for t in self.times[:1] if t > time]
        return [*starts, *jumps, *bends]

    def eval(self, time: float) -> Array:
        """Returns the signal (k) at a time in s among or just after the samples."""
        if len(self.times) == 1:
            return self.values[0]
        i = min(max(self._interval(time), 0), len(self.times) - 2)
        if self.times[i] == self.times[i + 1]:
            return self.values[i + 1]  # The last two samples are a jump.
        return self.polynomial(i).eval(time)

    def polynomial(self, i: int) -> "EnoPolynomial":
        """Returns the polynomial between the samples i and i + 1, which are no jump."""
        polynomial = self.polynomials.get(i)
        if polynomial is None:
            polynomial = EnoPolynomial(self.times, self.values, i)
            self.polynomials[i] = polynomial
        return polynomial

    def _interval(self, time: float) -> int:
        """Returns the index of the last sample before a time, -1 if there is none."""
        return bisect_left(self.times, time) - 1


class EnoPolynomial:
    """The ENO polynomials of a vector signal between two samples, one per component.

    They have the Newton form c0 + (t - n0) (c1 + (t - n1) (c2 + ...)).

    Args:
        times: The times of all samples in s (N,), ascending; two equal ones mark a
            jump.
        values: The samples (k each).
        i: The index of the first of the two samples, which are no jump.
    """

    def __init__(self, times: Sequence[float], values: Sequence[Array], i: int):
        window = stencil_window(times, i)
        t = [times[j] for j in window]
        left = window.index(i)
        # For so few numbers, lists are faster than arrays.
        columns = zip(*(values[j].tolist() for j in window), strict=True)
        self._series = [_newton_series(t, list(column), left) for column in columns]

    def eval(self, t: float) -> Array:
        """Returns the signal (k) at a time."""
        result = []
        for series in self._series:
            value = 0.0
            for node, coefficient in series:
                value = coefficient + (t - node) * value
            result.append(value)
        return np.array(result)


def _newton_series(
    t: list[float], y: list[float], left: int
) -> list[tuple[float, float]]:
    """Returns the nodes and coefficients of an ENO polynomial, highest order first.

    Args:
        t: The times of the samples from which the stencil may be chosen.
        y: The samples of one component at these times.
        left: The index in t of the first of the two samples that bound the interval.
    """
    begin = t[left]
    end = t[left + 1]
    change = abs(y[left + 1] - y[left])
    nodes = [begin]
    coefficients = [y[left]]
    for order in range(1, min(len(t), _NUM_POINTS)):
        # From here y has the divided differences of this order: y[j] is that of the
        # stencil from t[j] to t[j + order]. The chosen stencil begins at t[left].
        rises = map(sub, y[1:], y)
        gaps = map(sub, t[order:], t)
        y = list(map(truediv, rises, gaps))
        # Order 1 is the line through both samples. Later orders extend the stencil to
        # the side with the smaller difference.
        grows_left = order > 1 and left > 0
        if grows_left and left < len(y):
            grows_left = abs(y[left - 1]) < abs(y[left])
        if grows_left:
            left -= 1
            nodes.append(t[left])
        else:
            nodes.append(t[left + order])
        coefficients.append(y[left])
    terms = _term_bounds(nodes, coefficients, end)
    num_terms, share = _trusted(terms, change)
    coefficients[2:] = [share * c for c in coefficients[2:]]
    series = list(zip(nodes, coefficients, strict=True))[:num_terms]
    return series[::-1]


def _term_bounds(
    nodes: list[float], coefficients: list[float], end: float
) -> list[float]:
    """Returns bounds of the terms of a Newton series between its first node and `end`.

    The bounds of the first two terms, the line through both ends, are set to 0.
    """
    begin = nodes[0]
    terms = [0.0, 0.0]
    # |(t - begin) (t - end)| is largest in the middle, each further factor at one of
    # the ends.
    factor = (end - begin) ** 2 / 4
    for node, coefficient in zip(nodes[2:], coefficients[2:], strict=True):
        terms.append(abs(coefficient) * factor)
        factor *= max(abs(begin - node), abs(end - node))
    return terms


def _trusted(terms: list[float], change: float) -> tuple[int, float]:
    """Returns the number of terms of a series to use and a factor on the curved terms.

    With T_m a bound of the m-th term, the series ends with the first M at which
    max(T_(M-1), T_M) stops decreasing. Two terms are compared because a single one may
    vanish by symmetry. If this maximum is not small relative to the largest term, the
    terms from the second order on are scaled by change / (4 sum T_m), at most 1.

    Args:
        terms: The bounds T_m, which begin with the two zeros of the line.
        change: The distance between the samples at both ends.
    """
    terms = terms + [0.0] * (4 - len(terms))
    pairs = list(map(max, terms[2:], terms[3:]))
    last = 0
    while last + 1 < len(pairs) and pairs[last + 1] <= pairs[last]:
        last += 1
    num_terms = last + 4
    is_trusted = pairs[last] <= _CONVERGED * max(terms[:num_terms])
    deviation = 4 * sum(terms[:num_terms])
    if is_trusted or change >= deviation:
        return num_terms, 1.0
    return num_terms, change / deviation


def stencil_window(times: Sequence[float], i: int) -> list[int]:
    """Returns the indices of samples that the polynomial after sample i may use.

    They lie between the nearest jumps on either side. They are at least a quarter of
    the interval apart: polynomials through denser samples would amplify rounding
    errors.

    Args:
        times: The times of the samples, ascending; two equal ones mark a jump.
        i: The index of a sample that is older than the next one.
    """
    spacing = (times[i + 1] - times[i]) / 4
    older = _neighbours(times, range(i, -1, -1), spacing)
    newer = _neighbours(times, range(i + 1, len(times)), spacing)
    return [*older[::-1], i, i + 1, *newer]


def _neighbours(times: Sequence[float], indices: range, spacing: float) -> list[int]:
    """Returns the indices of usable samples on one side of an interval, nearest first.

    The search ends at a jump or with the largest number of samples, `_REACH`.

    Args:
        times: The times of all samples, ascending; two equal ones mark a jump.
        indices: The candidates in the order of the search. The first one is an end of
            the interval and is not returned.
        spacing: The shortest allowed time in s from one sample to the next.
    """
    found: list[int] = []
    last = times[indices[0]]
    before = last
    for j in indices[1:]:
        if times[j] == before or len(found) == _REACH:
            break
        before = times[j]
        if abs(before - last) >= spacing:
            found.append(j)
            last = before
    return found
