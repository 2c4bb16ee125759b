"""Keeps simulated time with the clock on the wall, and says when it cannot."""

import math
import time
from collections.abc import Callable

_PATIENCE = 0.25
"""How late a picture may be, in s of real time, before the clock is set back."""


class Pace:
    """Lets simulated time go on as fast as real time does.

    A simulation that was too slow for a moment does not hurry afterwards: no hand could
    follow. The clock is set back instead, and `was_late` tells.

    Attributes:
        was_late: Whether the simulation could not keep the rate somewhere.
    """

    def __init__(
        self,
        rate: float = 1.0,
        *,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self._rate, self._now, self._sleep = rate, now, sleep
        self.was_late = False
        self.Start(0.0)

    def Start(self, simulated: float) -> None:
        """Begins at a simulated time."""
        self._begin = self._zero = self._now()
        self._first = self._base = simulated

    def Wait(self, simulated: float) -> None:
        """Waits until it is the time."""
        if math.isinf(self._rate):
            return
        ahead = self._zero + (simulated - self._base) / self._rate - self._now()
        if ahead > 0:
            self._sleep(ahead)
        elif ahead < -_PATIENCE:
            self.was_late = True
            self._zero, self._base = self._now(), simulated

    def MeasuredRate(self, simulated: float) -> float:
        """Returns the simulated s in a second since the start."""
        passed = self._now() - self._begin
        return (simulated - self._first) / passed if passed > 0 else math.inf
