"""The instants at which the discrete states of a sampled loop change."""

import bisect
import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import NamedTuple

from teleop_drake.loops.framework.validation import Refuse

# Periods are commensurate if their ratios are fractions with at most this denominator,
# up to the relative error.
_LARGEST_DENOMINATOR = 64
_RATIO_ERROR = 1e-9

# The most updates of the fastest discrete state in a common period.
_MOST_UPDATES = 1000

# Instants nearer than this share of the common period are the same.
_SAME_INSTANT = 1e-9
DIGITS = 12


class Clock(NamedTuple):
    """The instants offset + k period at which a discrete state changes, s."""

    period: float
    offset: float = 0.0


class Lagged(NamedTuple):
    """x_number(t - lag) or q_number(t - lag), the lag a share of the common period."""

    is_held: bool
    number: int
    lag: float


def common_period(clocks: Iterable[Clock]) -> float:
    """Returns the least common multiple of the periods in s.

    Raises:
        ScenarioError: If the periods are not commensurate, or if their multiple is too
            long.
    """
    periods = sorted({clock.period for clock in clocks})
    shortest = periods[0]
    ratios = [
        Fraction(period / shortest).limit_denominator(_LARGEST_DENOMINATOR)
        for period in periods
    ]
    for ratio, period in zip(ratios, periods, strict=True):
        if abs(float(ratio) * shortest - period) > _RATIO_ERROR * period:
            Refuse("periods", periods, "commensurate: multiples of one period (s)")
    denominator = math.lcm(*(ratio.denominator for ratio in ratios))
    multiples = [int(ratio * denominator) for ratio in ratios]
    num_updates = Fraction(math.lcm(*multiples), denominator)
    if num_updates > _MOST_UPDATES:
        allowed = f"such that {_MOST_UPDATES} of the shortest are a common multiple (s)"
        Refuse("periods", periods, allowed)
    return float(num_updates) * shortest


class Schedule:
    """The instants of a common period, as shares of it from 0 to 1.

    Attributes:
        updates: The discrete states that change at an instant, by the instant.
        instants: All instants, ascending from 0: updates, and updates that arrive.
        lengths: For each discrete state the number of its values that the map needs,
            the present value included.
    """

    def __init__(self, clocks: Sequence[Clock], held: Sequence[Lagged], period: float):
        self._shares = [clock.period / period for clock in clocks]
        self._offsets = [clock.offset / period for clock in clocks]
        self.updates: dict[float, list[int]] = {}
        for j, share in enumerate(self._shares):
            for k in range(round(1 / share)):
                instant = _instant(self._offsets[j] % share + k * share)
                self.updates.setdefault(instant, []).append(j)
        arrivals = [
            _instant(instant + term.lag)
            for term in held
            for instant, changed in self.updates.items()
            if term.number in changed
        ]
        self.instants = _distinct([0.0, *self.updates, *arrivals])
        self.updates = {
            self._nearest(instant): changed for instant, changed in self.updates.items()
        }
        longest = dict.fromkeys(range(len(clocks)), 0.0)
        for term in held:
            longest[term.number] = max(longest[term.number], term.lag)
        self.lengths = [
            1 + math.ceil(lag / self._shares[j] - _SAME_INSTANT)
            for j, lag in longest.items()
        ]

    def _nearest(self, instant: float) -> float:
        """Returns the listed instant that is the same as an instant."""
        place = bisect.bisect_left(self.instants, instant - 2 * _SAME_INSTANT)
        return self.instants[place % len(self.instants)]

    def age(self, term: Lagged, now: float, seen: float) -> int:
        """Returns by how many updates a lagged discrete state is behind the newest one.

        Args:
            now: The time at which the history ends, as a share of the common period. It
                lies between two instants.
            seen: The time at which the lagged state is read. It lies between two
                instants.
        """
        share = self._shares[term.number]
        offset = self._offsets[term.number]
        newest = math.floor((now - offset) / share)
        return newest - math.floor((seen - term.lag - offset) / share)

    def middle(self, k: int) -> float:
        """Returns the middle of the interval that follows instant k."""
        return (self.instants[k] + self.end(k)) / 2

    def end(self, k: int) -> float:
        """Returns the end of the interval that follows instant k."""
        last = k + 1 == len(self.instants)
        return 1.0 if last else self.instants[k + 1]


def _instant(share: float) -> float:
    """Returns a share of the period from 0 to 1; 0 also if it is nearly 1."""
    share = round(share % 1, DIGITS)
    return 0.0 if share > 1 - _SAME_INSTANT else share


def _distinct(shares: Iterable[float]) -> list[float]:
    """Returns ascending shares of which no two are nearly the same."""
    distinct: list[float] = []
    for share in sorted(shares):
        if not distinct or share - distinct[-1] > _SAME_INSTANT:
            distinct.append(share)
    return distinct
