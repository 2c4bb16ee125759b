"""A recording as pieces of time, in each of which every signal is a polynomial.

The pieces are the steps of the recording, cut at what happens within one. Instants are
roots of the polynomials, peaks are their extremes, and integrals are exact for them.
Metrics thus converge with the solver, not with the sampling.

A signal is held as its values (M, d + 1) or (M, d + 1, k) in M pieces; see
numerics.step_polynomials.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from teleop_drake.numerics.step_polynomials import (
    DEGREE,
    crossings,
    lagrange,
    maxima,
    mean_square,
    shares,
    trace,
)
from teleop_drake.recording import Recording


@dataclass(kw_only=True)
class Pieces:
    """Pieces of time, ascending, a jump between two of them at most.

    Attributes:
        begin, end: (M,) in s.
        rows: (M, d + 1) the rows of the steps in which they lie.
        cut: (C,) numbers of those that are only a part of a step.
        weights: (C, d + 1, d + 1) of the rows in the values there.
    """

    begin: np.ndarray
    end: np.ndarray
    rows: np.ndarray
    cut: np.ndarray
    weights: np.ndarray

    def Sample(self, values: np.ndarray) -> np.ndarray:
        """Returns a signal (N, k) of the recording in the pieces (M, d + 1, k)."""
        result = np.take(values, self.rows, axis=0)
        if len(self.cut):
            result[self.cut] = self.weights @ result[self.cut]
        return result

    def Integral(self, y: np.ndarray) -> np.ndarray:
        """Returns the integral over time of a signal (M, d + 1, n) from the start."""
        powers = np.arange(y.shape[1])
        nodes = shares(y.shape[1] - 1)[:, None]
        weights = nodes ** (powers + 1) / (powers + 1) @ np.linalg.inv(nodes**powers)
        within = (self.end - self.begin)[:, None, None] * (weights @ y)
        before = np.cumsum(within[:, -1], axis=0) - within[:, -1]
        return np.asarray(within + before[:, None])

    def Times(self, at: np.ndarray) -> np.ndarray:
        """Returns the times (M, ...) in s at shares (...) of each piece."""
        begin, end = self.begin[:, None], self.end[:, None]
        return np.asarray(begin + at * (end - begin))

    def Crossings(self, *signals: np.ndarray) -> list[tuple[float, int, bool]]:
        """Returns when signals (M, d + 1) cross 0, ascending.

        Returns:
            The time in s, the number of the signal, and whether it goes up.
        """
        if not signals:
            return []
        i, at, is_upwards = crossings(np.concatenate(signals))
        number, i = np.divmod(i, len(self.begin))
        times = self.begin[i] + at * (self.end[i] - self.begin[i])
        return sorted(
            zip(times.tolist(), number.tolist(), is_upwards.tolist(), strict=True)
        )

    def CountBefore(self, time: float) -> int:
        """Returns how many pieces lie before a time."""
        return int(np.count_nonzero(self.begin + self.end < 2 * time))

    def ValueBefore(self, y: np.ndarray, time: float) -> float:
        """Returns the value of a signal (M, d + 1) just before a time.

        Before the first piece, it is the value with which that one begins.
        """
        i = self.CountBefore(time)
        return float(y[i - 1, -1] if i > 0 else y[0, 0])

    def Maxima(
        self, stretches: Mapping[str, tuple[np.ndarray, float, float]]
    ) -> dict[str, float]:
        """Returns maxima of signals (M, d + 1), each from one time to another.

        Where no piece lies between the two, it is the value before the first one.
        """
        parts = []
        for y, begin, end in stretches.values():
            part = y[self.CountBefore(begin) : self.CountBefore(end)]
            if len(part) == 0:
                part = np.full((1, y.shape[1]), self.ValueBefore(y, begin))
            parts.append(part)
        return dict(zip(stretches, maxima(parts), strict=True))

    def RootMeanSquare(self, error: np.ndarray) -> list[float]:
        """Returns the rms over time of a signal (M, d + 1, n), per axis."""
        length = self.end - self.begin
        total = length.sum()
        share = length / total if total > 0 else np.ones(len(length))
        return np.sqrt(share @ mean_square(error)).tolist()


def Split(recording: Recording, instants: Sequence[float] = ()) -> Pieces:
    """Returns the pieces of a run; one of no length if it has no steps.

    Args:
        instants: Times in s at which a piece ends and the next one begins.
    """
    time, steps = recording.time, recording.steps
    if len(steps) == 0:
        steps = np.full((1, DEGREE + 1), len(time) - 1)
    starts, ends = time[steps[:, 0]], time[steps[:, -1]]
    cuts = np.array(sorted(set(instants)), dtype=float)
    i = np.clip(np.searchsorted(starts, cuts) - 1, 0, None)
    is_within = (cuts > starts[i]) & (cuts < ends[i])
    begin = np.sort(np.concatenate([starts, cuts[is_within]]))
    i = np.searchsorted(starts, begin, side="right") - 1
    end = np.minimum(ends[i], np.append(begin[1:], np.inf))
    cut = np.flatnonzero((begin > starts[i]) | (end < ends[i]))
    k = i[cut]
    low, high = ((x[cut] - starts[k]) / (ends[k] - starts[k]) for x in (begin, end))
    degree = steps.shape[1] - 1
    nodes = low[:, None] + shares(degree) * (high - low)[:, None]
    nodes[:, -1] = high
    return Pieces(
        begin=begin, end=end, rows=steps[i], cut=cut, weights=lagrange(nodes, degree)
    )


def Traces(y: np.ndarray) -> np.ndarray:
    """Returns values between which a signal is monotonic, per axis (n, ...).

    Args:
        y: (M, d + 1, n) the signal in the pieces.
    """
    axes = np.moveaxis(y, 2, 0)
    return trace(axes.reshape(-1, y.shape[1])).reshape(len(axes), -1)
