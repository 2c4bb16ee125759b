"""What a number of a scenario changes in a run: the inputs of a page.

Each number z of a run is a function of the inputs. Where it is affine in an input, at
values at which that was not assumed too, the input is continuous; else it has stops.
With several inputs z is the sum of what each changes, which is checked as well.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from teleop_drake.arrays import Array
from teleop_drake.page.model import Model
from teleop_drake.validation import Refuse

Numbers = dict[str, Array]

Slopes = dict[str, tuple[NDArray[np.int64], Array]]
"""By the name of an array: places in it, and the change for each unit of an input."""

Maker = Callable[[Mapping[str, float]], Model]
"""Returns the run at values of inputs."""

# Shares of a range at which an input is looked at beside its ends.
_SHARES = (0.31, 0.5, 0.77)

# What two numbers may differ by, as a share of the larger one.
_ROUNDING = 1e-9

# What stands for no delay where programs are compared, s.
_ALMOST_ZERO = 1e-6

NUM_STOPS = 21
"""Stops of an input that is not continuous."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """What an input changes in the runs of one controller.

    Attributes:
        value: The input's value in the scenario.
        values: The ends of its range, or its stops.
        slopes: Of the numbers that are affine.
        stops: Of the others, by the name of the array: the array at each stop.
    """

    value: float
    values: Sequence[float]
    slopes: Slopes
    stops: dict[str, list[Array]]

    @property
    def names(self) -> set[str]:
        """The arrays that change."""
        return {*self.slopes, *self.stops}

    def Meets(self, other: "Change") -> bool:
        """Returns whether another input changes one of the numbers, too."""
        for name in self.names & other.names:
            mine = self.slopes.get(name)
            its = other.slopes.get(name)
            if mine is None or its is None or np.isin(mine[0], its[0]).any():
                return True
        return False

    def Added(self, name: str, base: Array, z: Array, value: float) -> Array:
        """Returns an array with what the input changes, as the page's script does.

        Args:
            name: Of the array.
            base: The array at the scenario's own values.
            z: The array with what other inputs change.
            value: Of the input.
        """
        if name in self.slopes:
            z = z.copy()
            places, slopes = self.slopes[name]
            z[places] += (value - self.value) * slopes
        elif name in self.stops:
            stop = self.stops[name][list(self.values).index(value)]
            if stop.shape != base.shape or not np.isfinite(base).all():
                return stop
            z = z + (stop - base) if z.shape == stop.shape else stop
        return z


@dataclass(kw_only=True)
class Input:
    """A number that can be changed.

    Attributes:
        key: Dotted path in the scenario, an alias of several, or a number's name.
        low, high, value: Its range, and its value in the scenario.
        is_wanted: Whether it is an error if it cannot be changed.
        label: Its name in the page, with its unit in brackets.
        owners: Paths of the blocks to which it belongs.
        is_delay: Whether it is one.
        is_field: Whether it is shown only in the opened box of its block.
        changes: Of each controller.
    """

    key: str
    low: float
    high: float
    value: float
    label: str
    owners: list[str]
    is_wanted: bool = False
    is_delay: bool = False
    is_field: bool = False
    changes: list[Change] = field(default_factory=list)

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of its range at which runs are compared.

        A block that is made without a delay has another program.
        """
        is_zero = self.is_delay and self.low == 0
        least = _ALMOST_ZERO if is_zero else self.low
        return least, self.high

    @property
    def span(self) -> str:
        """Its range, for messages."""
        return f"{self.low:g}:{self.high:g}"

    @property
    def is_whole(self) -> bool:
        """Whether it has whole numbers only, as seeds are."""
        return self.key.rpartition(".")[2] == "seed"

    @property
    def stops(self) -> list[float]:
        """Its values if it is not continuous, that of now among them."""
        if self.is_whole:
            end = math.floor(self.high) + 1
            return [float(k) for k in range(math.ceil(self.low), end)]
        return sorted({*np.linspace(self.low, self.high, NUM_STOPS), self.value})

    @property
    def is_continuous(self) -> bool:
        """Whether it is, for every controller."""
        return not any(change.stops for change in self.changes)


class NotSums(ValueError):
    """Two inputs that change the same number together."""


def FindChange(one: Input, make: Maker) -> Change:
    """Returns what an input changes.

    Raises:
        ScenarioError: If another structure or whole numbers come out at a value.
    """
    base = make({one.key: one.value})

    def At(v: float) -> Numbers:
        model = make({one.key: v})
        if model.structure != base.structure:
            allowed = f"values with the program of {one.value:g}: it has another one"
            Refuse(one.key, v, allowed)
        return model.numbers

    if not one.is_whole:
        low, high = one.ends
        inside = [low + share * (high - low) for share in _SHARES]
        looked = [low, high, *inside]
        known = [(v, At(v)) for v in looked]
        slopes = _FindSlopes(known, one.value, base.numbers)
        if slopes is not None:
            return Change(value=one.value, values=one.ends, slopes=slopes, stops={})
    # All of it comes from the tables, so that no number is between two stops.
    tables = [At(v) for v in one.stops]
    stops = {
        name: [table[name] for table in tables]
        for name, z in base.numbers.items()
        if not all(np.array_equal(z, table[name]) for table in tables)
    }
    return Change(value=one.value, values=one.stops, slopes={}, stops=stops)


def _FindSlopes(
    known: list[tuple[float, Numbers]], value: float, base: Numbers
) -> Slopes | None:
    """Returns the slopes of numbers, None if not all are affine.

    Args:
        known: Values of the input and the numbers there, at the ends of its range
            first.
        value: Its value in the scenario.
        base: The numbers there.
    """
    (low, first), (high, last) = known[:2]
    slopes = {}
    for name, z in base.items():
        if any(x[name].shape != z.shape for _, x in known):
            return None
        with np.errstate(invalid="ignore"):
            slope = np.nan_to_num((last[name] - first[name]) / (high - low))
        for v, x in known:
            if not _IsSame(z + (v - value) * slope, x[name]):
                return None
        places = np.flatnonzero(slope)
        if places.size:
            slopes[name] = places, slope[places]
    return slopes


def CheckSums(base: Numbers, changes: Mapping[str, Change], make: Maker) -> None:
    """Checks that the numbers are the sum of what each input changes.

    That is done where all inputs are at one end of their ranges, and at the corners of
    each two that change one number.

    Args:
        base: At the scenario's own values.
        changes: What each input changes, by its name.
        make: Returns the run at values of the inputs.

    Raises:
        NotSums: Naming two of them and an array.
    """
    highest = {name: change.values[-1] for name, change in changes.items()}
    lowest = {name: change.values[0] for name, change in changes.items()}
    corners = []
    for one, other in itertools.combinations(changes, 2):
        if changes[one].Meets(changes[other]):
            for values in (lowest, highest):
                corners.append({one: values[one], other: highest[other]})
    corners += [lowest, highest]
    for corner in corners:
        for key, x in make(corner).numbers.items():
            expected = base[key]
            for name, value in corner.items():
                expected = changes[name].Added(key, base[key], expected, value)
            if expected.shape != x.shape or not _IsSame(expected, x):
                raise NotSums(
                    f"{', '.join(corner)}: must not change {key} together, of which "
                    "each is to change its own part"
                )


def _IsSame(a: Array, b: Array) -> bool:
    """Returns whether two arrays are equal but for rounding."""
    scale = np.maximum(np.abs(a), np.abs(b))
    with np.errstate(invalid="ignore"):
        is_near = np.abs(a - b) <= _ROUNDING * scale + 1e-15
    return bool(np.all(is_near | (a == b)))
