"""The inputs of a page: numbers of a scenario, and what each changes in a run.

Each number z of a run, see Model.numbers, is a function of the inputs. An input is
continuous if every z is affine in it, which is checked at further values inside the
range. Otherwise it has stops, for which the numbers are tabulated. With several inputs
their changes of z are added, which is checked as well.
"""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.page.model import Model

Numbers = dict[str, Array]

Slopes = dict[str, tuple[NDArray[np.int64], Array]]
"""Keyed by array: the indices of elements, and their change per unit of an input."""

Maker = Callable[[Mapping[str, float]], Model]
"""A function that makes the model of a run from values of inputs, keyed by input."""

# Fractions of a range at which an input is checked, in addition to the ends.
_SHARES = (0.31, 0.5, 0.77)

# The relative difference up to which two numbers are equal.
_ROUNDING = 1e-9

# The delay, in s, that takes the place of 0 where programs are compared.
_ALMOST_ZERO = 1e-6

NUM_STOPS = 21
"""The number of stops of an input that is neither continuous nor whole."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """The changes of a run's numbers by an input.

    Attributes:
        value: The input's value in the scenario.
        values: The ends of the range of a continuous input; the stops of any other.
        slopes: The slopes of a continuous input; empty for any other.
        stops: For an input with stops: the changed arrays by name, each at every stop.
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
        """Returns whether another input may change the same number."""
        for name in self.names & other.names:
            mine = self.slopes.get(name)
            its = other.slopes.get(name)
            if mine is None or its is None or np.isin(mine[0], its[0]).any():
                return True
        return False

    def Added(self, name: str, base: Array, z: Array, value: float) -> Array:
        """Returns an array with the input's change added, as the page's script does.

        Args:
            name: The name of the array.
            base: The array at the scenario's own values.
            z: The array with the changes by other inputs.
            value: The value of the input.
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
    """A number that can be changed in the page.

    Attributes:
        key: A dotted path in the scenario, an alias of several paths, or the name of a
            number of a Context.
        low, high, value: Its range, and its value in the scenario or the Context.
        is_wanted: Whether an error is raised if it cannot be changed.
        label: Its name in the page, with its unit in brackets.
        owners: The paths of the blocks to which it belongs.
        is_delay: Whether it is a delay.
        is_field: Whether it is shown only in the opened box of its block.
        is_tried: Whether the page offers a value of it to try.
        changes: Its changes of each run, in the order of Runs.models.
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
    is_tried: bool = True
    changes: list[Change] = field(default_factory=list)

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of its range at which runs are compared.

        A delay of 0 is replaced by a tiny one, because a block that is made without a
        delay has another program.
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
        """Whether its values are whole numbers; true for seeds."""
        return self.key.rpartition(".")[2] == "seed"

    @property
    def stops(self) -> list[float]:
        """Its values if it is not continuous, including its value in the scenario."""
        if self.is_whole:
            end = math.floor(self.high) + 1
            return [float(k) for k in range(math.ceil(self.low), end)]
        return sorted({*np.linspace(self.low, self.high, NUM_STOPS), self.value})

    @property
    def is_continuous(self) -> bool:
        """Whether it is continuous in every run."""
        return not any(change.stops for change in self.changes)


class NotSums(ValueError):
    """The error that the changes of a number by several inputs do not add up."""


def FindChange(one: Input, make: Maker) -> Change:
    """Returns the changes of a run by an input.

    Raises:
        ScenarioError: If Model.structure differs at a value.
    """
    base = make({one.key: one.value})

    @functools.cache
    def At(v: float) -> Numbers:
        if v == one.value:
            return base.numbers
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
    # If one number is not affine, all are tabulated: none is between two stops.
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
    """Returns the slopes of all numbers that change; None if one is not affine.

    Args:
        known: Values of the input, each with the numbers at this value. The first two
            are the ends of the range.
        value: The input's value in the scenario.
        base: The numbers at this value.
    """
    (low, first), (high, last) = known[:2]
    slopes = {}
    for name, z in base.items():
        if any(x[name].shape != z.shape for _, x in known):
            return None
        with np.errstate(invalid="ignore"):
            slope = np.nan_to_num((last[name] - first[name]) / (high - low))
        for v, x in known:
            if not NearlyEqual(z + (v - value) * slope, x[name]).all():
                return None
        places = np.flatnonzero(slope)
        if places.size:
            slopes[name] = places, slope[places]
    return slopes


def CheckSums(base: Numbers, changes: Mapping[str, Change], make: Maker) -> None:
    """Checks that the changes of numbers by several inputs add up.

    They are checked with all inputs at the lower ends of their ranges, with all at the
    upper ends, and at two corners for each pair of inputs that may change one number.

    Args:
        base: The numbers at the scenario's own values.
        changes: The changes by each input, keyed by input.
        make: Makes the run at values of the inputs.

    Raises:
        NotSums: If they do not; the message names the inputs and an array.
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
            if expected.shape != x.shape or not NearlyEqual(expected, x).all():
                raise NotSums(
                    f"{', '.join(corner)}: must not change {key} together, of which "
                    "each is to change its own part"
                )


def NearlyEqual(a: Array, b: Array) -> NDArray[np.bool_]:
    """Returns which elements of two arrays are equal but for rounding."""
    scale = np.maximum(np.abs(a), np.abs(b))
    with np.errstate(invalid="ignore"):
        is_near = np.abs(a - b) <= _ROUNDING * scale + 1e-15
    return is_near | (a == b)
