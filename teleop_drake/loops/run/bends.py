"""Where recorded signals bend more than a polynomial between their samples follows."""

from collections.abc import Collection, Sequence

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.numerics.step_polynomials import (
    DEGREE,
    Series,
    lagrange,
    shares,
)

INSIDE: list[float] = shares(DEGREE)[1:-1].tolist()
"""The instants of samples within a piece of a step, as shares of its length."""

CHECKED = 0.382
"""The instant of the sample with which the polynomial is compared, as such a share."""

# The weights of the five samples and of the compared one: of the fourth difference, and
# of four times what the polynomial misses the compared sample by. At a kink anywhere in
# a piece, the error of the polynomial is at most 2.2 times the larger one of both.
_WEIGHTS = np.array(
    [
        [1.0, -4.0, 6.0, -4.0, 1.0, 0.0],
        [*(4 * lagrange(np.array(CHECKED), DEGREE)), -4.0],
    ]
)

# The larger one of both as a share of a signal's range, for an error of at most 1e-4.
_TOLERANCE = 4e-5

# Rounding as a share of the largest value of any signal. Differences of large values
# may be signals that consist of rounding.
_ROUNDING = 1e-13

# The range of a signal is brought up to date after so many pieces at the latest.
_MOST_AHEAD = 100

_NO_SIGNAL: Indices = np.empty(0, dtype=np.intp)


class Bends:
    """Finds the signals that the polynomial of a piece does not follow.

    The polynomial passes through the samples at the ends of a piece and at INSIDE.

    Args:
        sizes: The size of each signal.
    """

    def __init__(self, sizes: Sequence[int]):
        self._owners = np.repeat(np.arange(len(sizes)), sizes)
        # The range of each component so far.
        self._lowest = np.full(sum(sizes), np.inf)
        self._highest = -self._lowest
        # The misfit that is no bend, of each component: too small until the range is
        # brought up to date.
        self._allowed = np.zeros(sum(sizes))
        # Samples that are not in the range yet: with a range that is too small, a piece
        # is followed all the more.
        self._ahead: list[Array] = []
        self._is_followed = np.ones(len(sizes), dtype=bool)

    def Find(self, rows: Array) -> tuple[Indices, Indices]:
        """Returns the pieces that a polynomial does not follow, each with the signal.

        Args:
            rows: The elements of all signals at the five instants of each piece, and at
                CHECKED (m, 6, k).

        Returns:
            The indices of the pieces, and for each of them that of a signal.
        """
        self.See(rows.reshape(-1, rows.shape[-1]))
        # An infinite or undefined signal is not compared.
        with np.errstate(invalid="ignore"):
            misfits = np.abs(_WEIGHTS @ rows)
            if len(self._ahead) < _MOST_AHEAD and not (misfits > self._allowed).any():
                return _NO_SIGNAL, _NO_SIGNAL
            self._WidenRange()
            is_bent = (misfits > self._allowed).any(axis=1)
        pieces, elements = np.nonzero(is_bent)
        signals = self._owners[elements]
        is_followed = self._is_followed[signals]
        return pieces[is_followed], signals[is_followed]

    def See(self, samples: Array) -> None:
        """Extends the range of each element by samples (N, k)."""
        self._ahead.append(samples)

    def _WidenRange(self) -> None:
        """Extends the range of each element by the rows that have not been seen yet."""
        rows = np.concatenate(self._ahead)
        self._ahead = []
        self._lowest = np.minimum(self._lowest, rows.min(axis=0))
        self._highest = np.maximum(self._highest, rows.max(axis=0))
        largest = np.maximum(np.abs(self._lowest), np.abs(self._highest))
        rounding = _ROUNDING * largest[np.isfinite(largest)].max(initial=0.0)
        tolerance = _TOLERANCE * (self._highest - self._lowest)
        self._allowed = np.maximum(tolerance, rounding)

    def Leave(self, signals: Indices) -> None:
        """Ends the search for bends of some signals, given by their indices."""
        self._is_followed[signals] = False


# The fourth difference of a step with a kink is larger than those of its neighbours by
# this factor, which the change of smooth signals from step to step is far below.
_SPIKE = 30.0


def Kinked(series: Series) -> list[str]:
    """Returns the names of signals that jump or bend within a step of a compiled run.

    A fourth difference, divided by the fourth power of the step, is a derivative. It
    changes little from one step to the next, unless there is a kink in a step. The last
    step is left out: a jump that is due at the end may change its last sample.

    Args:
        series: Times, signals and steps of the run.
    """
    time, signals, steps = series
    steps = steps[:-1]
    if len(steps) < 5:
        return []
    lengths = time[steps[:, -1]] - time[steps[:, 0]]
    is_step = lengths > 0
    steps = steps[is_step]
    fourth_powers = lengths[is_step, np.newaxis] ** 4
    names = []
    for name, values in signals.items():
        differences = np.abs(np.einsum("i,sik->sk", _WEIGHTS[0, :5], values[steps]))
        rounding = _ROUNDING * np.abs(values).max(initial=0.0)
        is_large = differences > _TOLERANCE * np.ptp(values, axis=0) + rounding
        if not is_large.any():
            continue
        derivatives = (differences + rounding) / fourth_powers
        around = np.full_like(derivatives, -np.inf)
        for shift in (-2, -1, 1, 2):
            begin, end = max(0, -shift), len(steps) - max(0, shift)
            moved = derivatives[begin + shift : end + shift]
            around[begin:end] = np.maximum(around[begin:end], moved)
        if np.any(is_large & (derivatives > _SPIKE * around)):
            names.append(name)
    return names


def NotesOnBends(names: Collection[str], sent: Collection[str] = ()) -> list[str]:
    """Returns notes on signals that are not accurate where they jump or bend.

    Args:
        names: The signals that are not accurate between rows.
        sent: The inputs of delays that jump or bend within a step.
    """
    meanings = {
        "between the rows around it the signal is not accurate": names,
        "within a step around it the delayed signal, and what depends on it, is not "
        "accurate": sent,
    }
    return [
        f"{', '.join(sorted(found))}: jumps or bends at an instant that no event "
        f"announces, or changes too fast for the steps; {meaning}"
        for meaning, found in meanings.items()
        if found
    ]
