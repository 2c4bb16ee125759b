"""Signals that are affine in the continuous state, between the ends of steps."""

from collections.abc import Callable, Sequence

import numpy as np
from pydrake.systems.framework import Context

from teleop_drake.loops.framework.arrays import Array

Moving = tuple[Callable[[Context], Array], Context, slice]
"""What evaluates a signal, the Context of its system, and its place in a sample."""

Ends = tuple[Array, Array, Array, Array]
"""The states (n) at both ends of a step, and their rates there."""

HERMITE = np.array(
    [[1.0, 0, 0, 0], [0, 0, 1, 0], [-3, 3, -2, -1], [2, -2, 1, 1]],
)
"""The coefficients of a cubic Hermite polynomial, by ascending powers.

They are those of the values at both ends, and of the rates at both ends times the
length."""


class Affine:
    """Fills in the samples of affine signals within steps, when all steps are known.

    Args:
        context: A Context of the System, which is changed.
        signals: The signals, evaluated in this Context.
    """

    def __init__(self, context: Context, signals: Sequence[Moving]):
        self._columns = np.concatenate(
            [np.arange(place.start, place.stop) for _, _, place in signals]
        )

        def At(state: Array) -> Array:
            context.SetContinuousState(state)
            return np.concatenate([evaluate(own) for evaluate, own, _ in signals])

        units = np.eye(context.num_continuous_states())
        offset = At(0.0 * units[0])
        self._slopes = np.array([At(unit) - offset for unit in units])
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        self._ends: list[Ends] = []

    def Store(self, first: int, last: int, ends: Ends) -> None:
        """Stores a step.

        Args:
            first: The row at its beginning.
            last: The row at its end.
            ends: The states at its ends and their rates there.
        """
        self._firsts.append(first)
        self._lasts.append(last)
        self._ends.append(ends)

    def Fill(self, times: Array, rows: Array) -> None:
        """Sets the signals in the rows between the ends of each step.

        Args:
            times: The times of the rows, s (N).
            rows: The samples (N, k).
        """
        firsts = np.array(self._firsts, int)
        lasts = np.array(self._lasts, int)
        counts = lasts - firsts - 1
        step = np.repeat(np.arange(len(counts)), counts)
        before = np.cumsum(counts) - counts
        row = firsts[step] + 1 + np.arange(len(step)) - before[step]
        lengths = times[lasts] - times[firsts]
        shares = (times[row] - times[firsts[step]]) / lengths[step]
        weights = np.vander(shares, 4, increasing=True) @ HERMITE
        states = np.array(self._ends).reshape(-1, 4, len(self._slopes))
        inside = rows[np.ix_(firsts, self._columns)][step]
        # The weights of both ends add up to 1.
        states[:, 1] -= states[:, 0]
        states[:, 2:] *= lengths[:, np.newaxis, np.newaxis]
        for k in (1, 2, 3):
            change = states[:, k] @ self._slopes
            inside += weights[:, k, np.newaxis] * change[step]
        rows[np.ix_(row, self._columns)] = inside
