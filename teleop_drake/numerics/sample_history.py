"""Samples of a signal on their way through a delay.

Between two samples the signal is an essentially non-oscillatory (ENO) polynomial, as
accurate as the integrator's steps that made the samples. Its stencil never reaches
across a jump, and grows towards the side on which the divided differences are smaller:
away from a non-smooth point, of which nothing is known here. Its Newton series ends
where its terms fall no longer. Where they are not small there, the polynomial is drawn
towards the chord until it stays between the two samples.

Sources: A. Harten, B. Engquist, S. Osher, S. R. Chakravarthy, "Uniformly high order
accurate essentially non-oscillatory schemes, III", J. Comput. Phys. 71 (1987); for
drawing a polynomial towards values that are safe X. Zhang, C.-W. Shu, "On
maximum-principle-satisfying high order schemes for scalar conservation laws",
J. Comput. Phys. 229 (2010).
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import sub, truediv
from typing import Any

import numpy as np

from teleop_drake.arrays import Array

# Points of a stencil: its error is O(step^8), well below the integrator's.
_NUM_POINTS = 8

# How many samples on either side of an interval its polynomial may use.
_REACH = _NUM_POINTS - 2

# The last two terms of a series that converges are at most this share of the largest.
# Twelve samples in a period of a sine reach it even if all lie on one side.
_CONVERGED = 1 / 32

# How many samples stay in the history after they were delivered.
NUM_KEPT = 32


@dataclass(frozen=True, eq=False)
class SampleHistory:
    """The samples of a vector signal that are under way, in ascending order.

    Immutable, so that a copy of the state is the object itself: a Context may be
    cloned at every step for the price of a reference.

    Attributes:
        times: When the samples were taken or will arrive, s; two equal ones mark a
            jump.
        values: The samples (k each).
        now: Up to where in `times` the signal has been delivered, s.
        bends: Where steps have to end besides the jumps among the samples, s.
        polynomials: By the interval, what eval() has worked out so far. All but that
            at `now` are functions of the samples. That one stays what it was when the
            signal came to the interval: otherwise each new sample would move the
            signal, by as much as its error, at the very time of the sample.
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

        It lacks what has long been delivered, and what is redundant.

        Args:
            time: Time of the sample in s, not less than the last.
            value: The sample (k).
            now: Up to where the signal has been delivered, s.
            spacing: Samples closer together than this, in s, are redundant.
        """
        keep = len(self.times)
        if (
            keep >= 2
            and self.times[-2] < self.times[-1] < time
            and time - self.times[-2] < spacing
        ):
            keep -= 1  # The sample between the two adds nothing but length.
        # The samples just before the oldest one in use serve its stencil.
        first = max(0, bisect_left(self.times, now, 0, keep) - NUM_KEPT)
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
        """Returns when the signal starts, jumps or bends after a time, s.

        Other ones may happen between the last sample and the next one.
        """
        ahead = self.times[bisect_right(self.times, time) :]
        jumps = [t for t, after in pairwise(ahead) if t == after]
        bends = [bend for bend in self.bends if bend > time]
        starts = [t for t in self.times[:1] if t > time]
        return [*starts, *jumps, *bends]

    def eval(self, time: float) -> Array:
        """Returns the signal (k) at a time between (or just behind) the samples.

        Args:
            time: In s.
        """
        if len(self.times) == 1:
            return self.values[0]
        i = min(max(self._interval(time), 0), len(self.times) - 2)
        if self.times[i] == self.times[i + 1]:
            return self.values[i + 1]  # Just behind a jump.
        return self.polynomial(i).eval(time)

    def polynomial(self, i: int) -> "EnoPolynomial":
        """Returns the polynomial between the samples i and i + 1, no jump."""
        polynomial = self.polynomials.get(i)
        if polynomial is None:
            polynomial = EnoPolynomial(self.times, self.values, i)
            self.polynomials[i] = polynomial
        return polynomial

    def _interval(self, time: float) -> int:
        """Returns the index of the sample before a time, -1 if there is none."""
        return bisect_left(self.times, time) - 1


class EnoPolynomial:
    """The ENO polynomials of a vector signal between two samples.

    They have the Newton form c0 + (t - n0) (c1 + (t - n1) (c2 + ...)).

    Args:
        times: (N,) ascending; two equal ones mark a jump.
        values: The samples (k each).
        i: The first of the two samples, older than the second.
    """

    def __init__(self, times: Sequence[float], values: Sequence[Array], i: int):
        window = stencil_window(times, i)
        t = [times[j] for j in window]
        left = window.index(i)
        # Of so few numbers, Python's own are faster than arrays.
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
    """Returns the nodes and coefficients of an ENO polynomial, the last ones first.

    Args:
        t: The times of the samples y that it may be built from.
        left: The first of the two samples between which it is.
    """
    begin = t[left]
    end = t[left + 1]
    change = abs(y[left + 1] - y[left])
    nodes = [begin]
    coefficients = [y[left]]
    for order in range(1, min(len(t), _NUM_POINTS)):
        # The divided differences of this order, of all stencils.
        rises = map(sub, y[1:], y)
        gaps = map(sub, t[order:], t)
        y = list(map(truediv, rises, gaps))
        # The first one makes the line through both samples.
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
    """Returns bounds of the terms of a series between its first node and an end.

    Those of the line through both ends are 0.
    """
    begin = nodes[0]
    terms = [0.0, 0.0]
    # |(t - begin) (t - end)| is largest in the middle, each further factor at an end.
    factor = (end - begin) ** 2 / 4
    for node, coefficient in zip(nodes[2:], coefficients[2:], strict=True):
        terms.append(abs(coefficient) * factor)
        factor *= max(abs(begin - node), abs(end - node))
    return terms


def _trusted(terms: list[float], change: float) -> tuple[int, float]:
    """Returns how many terms of a series can be trusted, and how much of the curved.

    With T_m a bound of the m-th term, the series ends with M where
    max(T_(M-1), T_M) falls no longer (two terms, because one may vanish by
    symmetry). Unless that is small against the largest term, the terms from the second
    order on are scaled by change / (4 sum T_m) where that is less than 1.
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
    """Returns the samples from which the polynomial behind sample i may be built.

    They lie between the jumps on either side, and not closer together than a quarter of
    the interval: polynomials through denser samples would amplify rounding errors.

    Args:
        times: Ascending; two equal ones mark a jump.
        i: A sample that is older than the next.
    """
    spacing = (times[i + 1] - times[i]) / 4
    older = _neighbours(times, range(i, -1, -1), spacing)
    newer = _neighbours(times, range(i + 1, len(times)), spacing)
    return [*older[::-1], i, i + 1, *newer]


def _neighbours(times: Sequence[float], indices: range, spacing: float) -> list[int]:
    """Returns the samples behind the first one that a polynomial may be built from.

    They end at a jump, and at the largest number of them.

    Args:
        indices: Of the samples, from the first one on.
        spacing: The shortest time in s from one to the next.
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
