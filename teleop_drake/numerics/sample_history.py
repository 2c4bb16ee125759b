"""Samples of a signal on their way through a delay."""

import math
from bisect import bisect_left
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_drake.numerics.interpolation import IntervalPolynomial

# How many samples stay in the history after they were delivered.
_NUM_KEPT = 32


@dataclass(frozen=True, eq=False)
class SampleHistory:
    """The samples of a vector signal that are under way, in ascending order.

    Immutable, so that a copy of the state is the object itself: a Context may be
    cloned at every step for the price of a reference.

    Attributes:
        times: When the samples were taken or will arrive, s; two equal ones mark a
            jump.
        values: The samples (one row each).
        jumps: When those jumps of the signal that are known will be delivered, s.
        now: Up to where in `times` the signal has been delivered, s.
        polynomials: By the interval, what eval() has worked out so far. All but that
            at `now` are functions of the samples. That one stays what it was when the
            signal came to the interval: otherwise each new sample would move the
            signal, by as much as its error, at the very time of the sample.
    """

    times: tuple[float, ...] = ()
    values: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 1)))
    jumps: tuple[float, ...] = ()
    now: float = -math.inf
    polynomials: dict[int, IntervalPolynomial] = field(default_factory=dict)

    def __deepcopy__(self, memo: dict[int, Any]) -> "SampleHistory":
        return self

    def record(
        self,
        key: float,
        value: NDArray[np.float64],
        *,
        jump: NDArray[np.float64] | None,
        now: float,
        spacing: float,
    ) -> "SampleHistory":
        """Returns the history at the end of a step, itself if nothing is new.

        Args:
            key: Time of the new sample in s.
            value: The sample (k).
            jump: What the events of the last step made of the last sample (k), None
                if they left it alone.
            now: Up to where the signal has been delivered, s.
            spacing: Samples closer together than this, in s, are redundant.
        """
        if now <= self.now:
            return self
        if self.times and key <= self.times[-1]:
            # Two steps so close that their keys are rounded to one.
            return replace(self, now=now)
        history = self
        if jump is not None:
            history = history.append(self.times[-1], jump, now=now, spacing=spacing)
        return history.append(key, value, now=now, spacing=spacing)

    def append(
        self, time: float, value: NDArray[np.float64], *, now: float, spacing: float
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
        first = 0
        # The samples just before the oldest one in use serve its stencil.
        while first + _NUM_KEPT < keep and self.times[first + _NUM_KEPT] < now:
            first += 1
        polynomials = {}
        i = self._interval(now)
        if 0 <= i < keep - 1 and self.times[i] < self.times[i + 1]:
            polynomials[i - first] = self._polynomial(i)
        values = np.empty((keep - first + 1, len(value)))
        values[:-1] = self.values[first:keep]
        values[-1] = value
        jumps = self.jumps
        if keep == 0 or self.times[-1] == time:
            jumps = (*jumps, time)
        if jumps and jumps[0] <= now:
            jumps = tuple(jump for jump in jumps if jump > now)
        times = (*self.times[first:keep], time)
        return SampleHistory(times, values, jumps, now, polynomials)

    def eval(self, time: float) -> NDArray[np.float64]:
        """Returns the signal (k) at a time between (or just behind) the samples.

        Args:
            time: In s.
        """
        if len(self.times) == 1:
            return np.asarray(self.values[0])
        i = min(max(self._interval(time), 0), len(self.times) - 2)
        if self.times[i] == self.times[i + 1]:
            return np.asarray(self.values[i + 1])  # Just behind a jump.
        return self.eval_interval(i, time)

    def eval_interval(self, i: int, time: float) -> NDArray[np.float64]:
        """Returns what eval() does in the interval between the samples i and i + 1.

        Args:
            i: Index of a sample that is older than the next.
            time: In s.
        """
        return self._polynomial(i).eval(time)

    def _polynomial(self, i: int) -> IntervalPolynomial:
        """Returns the polynomial between the samples i and i + 1."""
        polynomial = self.polynomials.get(i)
        if polynomial is None:
            polynomial = IntervalPolynomial(np.array(self.times), self.values, i)
            self.polynomials[i] = polynomial
        return polynomial

    def _interval(self, time: float) -> int:
        """Returns the index of the sample before a time, -1 if there is none."""
        return bisect_left(self.times, time) - 1
