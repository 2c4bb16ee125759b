"""The stability margins of a loop, and what would stabilise an unstable one."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from teleop_drake.loops.framework.arrays import Interval

LARGEST_GAIN = 100.0
"""Gains are searched up to this factor and its inverse."""

# A smaller gain of signals without dynamics is a rounding error of 0.
_NEUTRAL = 1e-6


@dataclass(frozen=True, kw_only=True)
class Margins:
    """The stability margins of a loop at a cut, for all signals of the cut alike.

    `print` shows them in words.

    Attributes:
        is_stable: Whether the loop is stable without additional delay, phase or gain;
            neutral roots at 0 are allowed. If it is unstable, the margins are 0, and 1
            for the gain.
        delay: The smallest additional delay in s that makes the loop unstable; infinity
            if the loop is stable with every delay.
        frequency: The frequency of the oscillation at this delay, rad/s; 0 if no delay
            makes the loop unstable.
        phase: The smallest additional phase in rad, of either sign, that makes the loop
            unstable; infinity if the loop is stable with every phase.
        phase_frequency: The frequency of the oscillation at this phase, rad/s.
        gain: The limits of the additional gain, one below and one above 1, between
            which the loop is stable; 0 and infinity if there is no limit from 1/100 to
            100.
        gain_frequencies: The frequencies of the oscillations at these limits, rad/s.
        stable_gains: All intervals of the additional gain in which an unstable loop is
            stable, from 1/100 to 100; an end of 0 or infinity is beyond. If there is
            none, those of negative gains, which reverse the sign of the feedback.
        stable_delays: All intervals of the additional delay in s in which an unstable
            loop is stable.
        gain_at_once: The mean gain from one delay to the next, the additional one
            included, of signals that go round the loop without dynamics; an upper bound
            of it if it is below 1. The loop is of retarded type if it is 0, else of
            neutral type. From 1 on, no additional delay, however short, is tolerated.
    """

    is_stable: bool
    delay: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0
    phase_frequency: float = 0.0
    gain: Interval = (1.0, 1.0)
    gain_frequencies: Interval = (0.0, 0.0)
    stable_gains: tuple[Interval, ...] = ()
    stable_delays: tuple[Interval, ...] = ()
    gain_at_once: float = 0.0

    def __str__(self) -> str:
        """Returns the margins or the remedies, and the type of the loop, in words."""
        words = self._margins() if self.is_stable else f"unstable; {self.remedy}"
        if self.gain_at_once > _NEUTRAL:
            words += f"; {neutral_words(self.gain_at_once)}"
        return words

    @property
    def remedy(self) -> str:
        """The gains and the delays that would stabilise an unstable loop, in words."""
        return remedy_words(self.stable_gains, self.stable_delays)

    def _margins(self) -> str:
        delay = "any additional delay"
        if self.delay < math.inf:
            delay = f"{self.delay:.4g} s of additional delay"
        if self.frequency > 0:
            delay += f" ({self.frequency:.4g} rad/s)"
        phase = "any phase"
        if self.phase < math.inf:
            phase = f"{math.degrees(self.phase):.4g} degrees of phase"
        return f"stable up to {delay} and {phase}, with {_gain_words(self.gain)}"


def remedy_words(
    gains: Iterable[Interval],
    delays: Iterable[Interval],
    delay: str = "additional delay",
) -> str:
    """Returns what would stabilise an unstable loop, in words.

    Args:
        gains: See Margins.stable_gains.
        delays: See Margins.stable_delays.
        delay: The name of these delays.
    """
    found = [_gain_words(window) for window in gains]
    times = [f"{low:.4g} to {high:.4g}" for low, high in delays]
    found += [f"{', '.join(times)} s of {delay}"] * bool(times)
    if not found:
        return "no gain up to 100 times as large or small and no delay stabilises it"
    return f"stable with {', or '.join(found)}"


def _gain_words(window: Interval) -> str:
    low, high = window
    if high <= 0:
        return f"the sign reversed and {_gain_words((-high, -low))}"
    if low > 0 and high < math.inf:
        return f"{low:.4g} to {high:.4g} times the gain"
    if low > 0:
        return f"more than {low:.4g} times the gain"
    return f"less than {high:.4g} times the gain" if high < math.inf else "any gain"


def neutral_words(gain: float) -> str:
    """Returns what a gain of signals without dynamics means, in words."""
    effect = "which keeps infinitely many fast roots to the left of the axis"
    if gain >= 1:
        effect = "and any additional delay puts infinitely many roots right of the axis"
        effect += ", or near it"
    return (
        "of neutral type: a signal goes from one delay to the next without dynamics, "
        f"by a gain of {gain:.3g}, {effect}"
    )
