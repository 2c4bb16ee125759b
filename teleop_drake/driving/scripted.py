"""A hand that does what a function says: for tests, and to show what is shown."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.driving.settings import Settings

Array = NDArray[np.float64]


class ScriptedHand:
    """Commands what a function says, and changes settings as time goes by.

    Args:
        command: Takes the simulated time of the segment in s and returns the share of
            the full speed along each axis (n), -1 to 1.
        settings: With which it begins.
        changes: Times in s, over all segments, and the settings from then on.
        anew: Times in s, over all segments, at which the task begins from its start.

    Attributes:
        felt: Force in N and velocity in m/s that were shown, by picture.
    """

    def __init__(
        self,
        command: Callable[[float], ArrayLike],
        settings: Settings,
        *,
        changes: Sequence[tuple[float, Settings]] = (),
        anew: Sequence[float] = (),
    ):
        self._command, self._settings = command, settings
        self._changes, self._anew = list(changes), list(anew)
        self._total = self._last = 0.0
        self.felt: list[tuple[Array, Array]] = []

    def Command(self, time: float) -> Array:
        """Returns the share of the full speed along each axis (n), -1 to 1."""
        self._total += time - self._last if time > self._last else 0.0
        self._last = time
        return np.asarray(self._command(time), dtype=float)

    def Wanted(self) -> Settings:
        """Returns the settings that are wanted now."""
        while self._changes and self._total >= self._changes[0][0]:
            self._settings = self._changes.pop(0)[1]
        return self._settings

    def WantsAnew(self) -> bool:
        """Returns whether the task is to begin from its start, once for each time."""
        if self._anew and self._total >= self._anew[0]:
            self._anew.pop(0)
            return True
        return False

    def WantsEnd(self) -> bool:
        """Returns False: it never has enough."""
        return False

    def Show(self, force: Array, velocity: Array, rate: float) -> None:
        """Keeps what is felt."""
        self.felt.append((np.array(force), np.array(velocity)))
