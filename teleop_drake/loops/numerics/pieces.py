"""Signals of a run in pieces, and the instants at which they change their sign.

A piece is a step of a recording, or a part of a step that was cut at an instant. A
signal in pieces is an array (p, 5, ...) of its values at five equally spaced points of
each of p pieces, both ends included. Between the points it is the quartic through them.
All functions here are therefore exact for the polynomials of a run, and metrics
converge with the accuracy of the solver, not with the density of samples.

Signals in pieces are added and multiplied as arrays. A product is represented by the
quartic through its values.
"""

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyval

from teleop_drake.loops.framework.arrays import Array, Flags, Indices
from teleop_drake.loops.numerics.bisection import ROUNDS, bisect
from teleop_drake.loops.numerics.step_polynomials import (
    DEGREE,
    interpolate,
    lagrange,
    shares,
    to_powers,
)

NODES = shares(DEGREE)
"""The points of a piece at which a signal is given, as shares of its length."""

SAME_INSTANT = 5e-12
"""Instants closer together than this, in s, count as the same.

It allows for the rounding of sums of times.
"""

# The ends of a piece are moved inwards by this time in s before a delayed signal is
# evaluated, which may jump there.
_INWARDS = 2 * SAME_INSTANT


class Crossings(NamedTuple):
    """The instants in s at which a signal changes its sign.

    Attributes:
        upwards: Changes from negative to positive.
        downwards: Changes from positive to negative.
    """

    upwards: list[float]
    downwards: list[float]


class Pieces:
    """The steps of a recording, cut at instants.

    A recording of a single row is one piece.

    Attributes:
        begin: The start of each piece, s (p).
        end: The end of each piece, s (p).
        length: The length of each piece, s (p); 1 for a recording of a single row, so
            that it can be a divisor.
    """

    def __init__(self, times: Array, steps: Indices, cuts: Iterable[float] = ()):
        """Cuts the steps of a recording.

        Args:
            times: The times of the recording's rows in s (N).
            steps: The rows of each step (S, d + 1); see numerics.step_polynomials.
            cuts: The instants in s at which steps are cut.
        """
        # A step between two instants that count as the same belongs to a jump.
        steps = steps[times[steps[:, -1]] - times[steps[:, 0]] > SAME_INSTANT]
        if len(steps) == 0:
            steps = np.full((1, len(NODES)), len(times) - 1)
        begin = times[steps[:, 0]]
        end = times[steps[:, -1]]
        # `inside` is the step that contains each instant. An instant at an end of a
        # step, or a repeated one, cuts nothing.
        instants = np.array(sorted(cuts))
        inside = np.minimum(np.searchsorted(end, instants), len(end) - 1)
        is_cut = instants > begin[inside] + SAME_INSTANT
        is_cut &= instants < end[inside] - SAME_INSTANT
        is_cut[1:] &= np.diff(instants) > SAME_INSTANT
        instants = instants[is_cut]
        self.begin = np.sort(np.append(begin, instants))
        self.end = np.sort(np.append(end, instants))
        self.length = self.end - self.begin
        step = np.searchsorted(begin, self.begin, side="right") - 1
        self._times = times
        self._steps = steps
        self._rows = steps[step]
        self._instants = self.begin[:, None] + NODES * self.length[:, None]
        # A piece that is a part of a step has other points than the step. Its values
        # are interpolated from those of the step.
        self._parts = np.flatnonzero(self.length < (end - begin)[step])
        owner = step[self._parts, None]
        share = (self._instants[self._parts] - begin[owner]) / (end - begin)[owner]
        self._weights_of_parts = lagrange(share, steps.shape[1] - 1)
        if self.length[0] == 0:
            self.length = np.ones(1)

    def signal(self, samples: Array, delay: float = 0.0) -> Array:
        """Returns a signal, which may be delayed, in pieces (p, 5, n).

        Args:
            samples: The signal in the rows of the recording (N, n).
            delay: The delay in s. Before the first row the signal is 0.
        """
        if delay > 0:
            return self._delayed(samples, delay)
        values: Array = samples[self._rows]
        signal = values
        if values.shape[1] != len(NODES):
            signal = lagrange(NODES, values.shape[1] - 1) @ values
        signal[self._parts] = self._weights_of_parts @ values[self._parts]
        return signal

    def _delayed(self, samples: Array, delay: float) -> Array:
        """Returns a delayed signal in pieces (p, 5, n)."""
        sent = self._instants - delay
        # The signal may jump at an end of a piece. A point inside of the piece is on
        # the right side of the jump.
        inwards = np.minimum(_INWARDS, (self.end - self.begin) / 8)
        sent[:, 0] += inwards
        sent[:, -1] -= inwards
        signal = interpolate(self._times, samples, self._steps, sent.ravel())
        signal[sent.ravel() < self._times[0]] = 0.0
        return signal.reshape(*sent.shape, -1)

    def between(self, begin: float | None = None, end: float | None = None) -> slice:
        """Returns the pieces between two instants; None is the run's start or end."""
        limits = [-math.inf if begin is None else begin]
        limits.append(math.inf if end is None else end)
        first, last = np.searchsorted((self.begin + self.end) / 2, limits).tolist()
        return slice(first, last)

    def crossings(self, y: Array) -> Crossings:
        """Returns the sign changes of a signal (p, 5); 0 counts as positive."""
        is_in = y >= 0
        with np.errstate(invalid="ignore"):  # A surface may be at infinity.
            powers = powers_of(y)
        piece, node, share = changes_of(
            lambda piece, x: polyval(x, powers[:, piece], tensor=False) >= 0, is_in
        )
        times = self.begin[piece] + share * self.length[piece]
        was_in = is_in[piece, node]
        return Crossings(times[~was_in].tolist(), times[was_in].tolist())


def changes_of(
    holds: Callable[[Indices, Array], Flags], is_in: Flags, rounds: int = ROUNDS
) -> tuple[Indices, Indices, Array]:
    """Returns the changes of a condition between neighbouring points of the pieces.

    Args:
        holds: Returns whether the condition holds in pieces (k) at shares of their
            lengths (m, k).
        is_in: Whether the condition holds at the points of all pieces (p, 5).
        rounds: The number of times an interval is divided; see bisect().

    Returns:
        For each change the index of the piece, the index of the point before the
        change, and the change's instant as a share of the piece (k each).
    """
    piece, node = np.nonzero(is_in[:, 1:] != is_in[:, :-1])
    was_in = is_in[piece, node]
    share = bisect(
        lambda x: holds(piece, x) == was_in, NODES[node], NODES[node + 1], rounds
    )
    return piece, node, share


def powers_of(y: Array) -> Array:
    """Returns the coefficients of ascending powers (5, k, ...) of quartics on [0, 1].

    For a constant, all but the first one are exactly 0.
    """
    first = y[:, 0]
    powers = np.tensordot(to_powers(DEGREE), y - y[:, :1], axes=(1, 1))
    powers[0] += first
    return powers
