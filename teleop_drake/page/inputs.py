"""What a number of a scenario changes in a run: the inputs of a page.

Each number z of a run is a function of the inputs. Where it is affine in an input, at
values at which that was not assumed too, the input is continuous; else it has stops.
With several inputs z is the sum of what each changes, which is checked as well.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_drake.arrays import Array
from teleop_drake.page.model import Model
from teleop_drake.validation import Refuse

Numbers = dict[str, Array]

# Shares of a range at which an input is looked at beside its ends.
_SHARES = (0.31, 0.5, 0.77)

# What two numbers may differ by, as a share of the larger one.
_ROUNDING = 1e-9

NUM_STOPS = 21
"""Stops of an input that is not continuous."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """What an input changes in the runs of one controller.

    Attributes:
        slopes: Of the numbers that are affine, by the name of the array: the places in
            it, and the change for each unit of the input.
        stops: Of the others: the array at each stop.
    """

    slopes: dict[str, tuple[NDArray[np.int64], Array]]
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


class NotSums(ValueError):
    """Two inputs that change the same number together."""


def FindChange(
    name: str,
    low: float,
    high: float,
    value: float,
    make: Callable[[float], Model],
    stops: Sequence[float],
    *,
    are_whole: bool,
) -> Change:
    """Returns what an input changes.

    Args:
        name: Of the input.
        low: Its least value.
        high: Its largest value.
        value: Its value in the scenario.
        make: Returns the run at a value.
        stops: The values that it has if it is not continuous.
        are_whole: Whether it has whole numbers only.

    Raises:
        ScenarioError: If another structure or whole numbers come out at a value.
    """
    base = make(value)

    def At(v: float) -> Numbers:
        model = make(v)
        if model.structure != base.structure:
            Refuse(name, v, f"values with the program of {value:g}: it has another one")
        return model.numbers

    z = base.numbers
    if not are_whole:
        looked = [low, high, *(low + share * (high - low) for share in _SHARES)]
        known = [(v, At(v)) for v in looked]
        slopes = {
            key: _Slope([(v, x[key]) for v, x in known], value, z[key]) for key in z
        }
        if all(slope is not None for slope in slopes.values()):
            places = {k: np.flatnonzero(s) for k, s in slopes.items() if s is not None}
            changes = {
                key: (place, slopes[key][place])  # type: ignore[index]
                for key, place in places.items()
                if place.size
            }
            return Change(slopes=changes, stops={})
    # All of it comes from the tables, so that no number is between two stops.
    tables = [At(v) for v in stops]
    changing = [k for k in z if any(not np.array_equal(z[k], x[k]) for x in tables)]
    return Change(slopes={}, stops={key: [x[key] for x in tables] for key in changing})


def _Slope(known: list[tuple[float, Array]], value: float, z: Array) -> Array | None:
    """Returns the slopes of numbers, None if not all are affine.

    Args:
        known: Values of the input and the numbers there, at the ends of its range
            first.
        value: Its value in the scenario.
        z: The numbers there.
    """
    if any(x.shape != z.shape for _, x in known):
        return None
    (low, first), (high, last) = known[:2]
    with np.errstate(invalid="ignore"):
        slope: Array = np.nan_to_num((last - first) / (high - low))
    is_line = all(_IsSame(z + (v - value) * slope, x) for v, x in known)
    return slope if is_line else None


def CheckSums(
    base: Numbers,
    inputs: Mapping[str, tuple[float, Sequence[float], Change]],
    make: Callable[[Mapping[str, float]], Model],
) -> None:
    """Checks that the numbers are the sum of what each input changes.

    That is done where all inputs are at one end of their ranges, and at the corners of
    each two that change one number.

    Args:
        base: At the scenario's own values.
        inputs: By name: the scenario's value, those at which it is looked at, of which
            the stops have as many, and what it changes.
        make: Returns the run at values of the inputs.

    Raises:
        NotSums: Naming two of them and an array.
    """
    ends = {name: (values[0], values[-1]) for name, (_, values, _) in inputs.items()}
    corners = [
        {one: v, other: ends[other][1]}
        for one, other in itertools.combinations(inputs, 2)
        if inputs[one][2].Meets(inputs[other][2])
        for v in ends[one]
    ]
    for k in (0, 1):
        corners.append({name: values[k] for name, values in ends.items()})
    for corner in corners:
        for key, x in make(corner).numbers.items():
            expected = base[key]
            for name, value in corner.items():
                at, values, change = inputs[name]
                expected = Added(base[key], expected, key, value, at, values, change)
            if expected.shape != x.shape or not _IsSame(expected, x):
                raise NotSums(
                    f"{', '.join(corner)}: must not change {key} together, of which "
                    "each is to change its own part"
                )


def Added(
    base: Array,
    z: Array,
    key: str,
    value: float,
    at: float,
    values: Sequence[float],
    change: Change,
) -> Array:
    """Returns numbers with what an input changes; the page's script does the same.

    Args:
        base: The array at the scenario's own values.
        z: The same with what other inputs change.
        key: Its name.
        value: Of the input.
        at: That of the scenario.
        values: Those of the stops.
        change: What the input changes.
    """
    if key in change.slopes:
        z = z.copy()
        places, slopes = change.slopes[key]
        z[places] += (value - at) * slopes
    elif key in change.stops:
        stop = change.stops[key][list(values).index(value)]
        if stop.shape != base.shape or not np.isfinite(base).all():
            return stop
        z = z + (stop - base) if z.shape == stop.shape else stop
    return z


def _IsSame(a: Array, b: Array) -> bool:
    scale = np.maximum(np.abs(a), np.abs(b))
    with np.errstate(invalid="ignore"):
        return bool(((a == b) | (np.abs(a - b) <= _ROUNDING * scale + 1e-15)).all())


def Stops(low: float, high: float, value: float, *, are_whole: bool) -> list[float]:
    """Returns the values of an input that is not continuous, that of now among them."""
    if are_whole:
        return [float(x) for x in range(math.ceil(low), math.floor(high) + 1)]
    even = np.linspace(low, high, NUM_STOPS).tolist()
    return sorted({*even, value})
