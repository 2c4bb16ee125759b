"""The fields of a page: the numbers of its blocks, shown in the opened boxes.

All fields of a run are changed at once to random values, three times. A number of the
run that changes by the same multiple of one field's change each time is affine in this
field and in no other. Where this does not explain all changes, the fields are halved.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.parameters import Scalar
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import GainRange, ScenarioError
from teleop_drake.loops.page.inputs import Change, Input, Maker, NearlyEqual, Slopes
from teleop_drake.loops.page.model import Model
from teleop_drake.loops.page.sliders import LEAST_DELAY, DelayRange, Runs

# The largest number of fields in a page.
_MOST_FIELDS = 120

# A range reaches from a value divided by this to the value times this.
_FACTOR = 4

_NUM_DRAWS = 3

# The share of its range in which an element of a matrix changes, and any field whose
# slopes are known: numbers that are allowed only together remain allowed.
_NEAR = 0.1

# The relative difference up to which ratios of changes are equal.
_SAME_RATIO = 1e-6

_OTHER_PROGRAM = "it needs another program: make the page again with it"
_NOT_AFFINE = "its effect is no straight line"
_OF_SLIDER = "a slider changes it, or changes its effect"
_TOO_MANY = "the page has too many numbers"
_NO_EFFECT = "it changes nothing in this run"


def FieldNumbers(
    numbers: Mapping[str, Scalar], inputs: Iterable[Input]
) -> dict[str, Scalar]:
    """Returns the numbers that may be fields: finite parameters that are no sliders."""
    shown = {"delay", *(one.key for one in inputs)}
    return {
        name: number
        for name, number in numbers.items()
        if name not in shown and not number.is_state and math.isfinite(number.value)
    }


def FindFields(
    numbers: Sequence[Mapping[str, Scalar]], inputs: Sequence[Input], runs: Runs
) -> tuple[list[Input], dict[str, str]]:
    """Returns the numbers that are fields, and the reasons why others are not.

    Args:
        numbers: The numbers of each run's blocks, in the order of Runs.models.
        inputs: The sliders of the page.
        runs: The runs of the page.
    """
    fields: dict[str, Input] = {}
    for known in numbers:
        for name, number in known.items():
            fields.setdefault(name, _MakeField(name, number, runs))
    why = dict.fromkeys(list(fields)[_MOST_FIELDS:], _TOO_MANY)
    for i, (which, make) in enumerate(runs.makers.items() if numbers else ()):
        own: dict[str, Input] = {}
        for name, number in numbers[i].items():
            reason = why.get(name) or _ReasonAgainst(name, number, fields[name])
            if reason:
                why[name] = reason
            else:
                own[name] = fields[name]
        finder = _Finder(own, make, runs.models[which], inputs, i)
        finder.Find(list(own))
        finder.CheckSliders(list(finder.found))
        why |= finder.why
        for name, one in fields.items():
            slopes = finder.found.get(name, {})
            ends = (one.low, one.high)
            one.changes.append(
                Change(value=one.value, values=ends, slopes=slopes, stops={})
            )
    found = []
    for name, one in fields.items():
        if name in why:
            continue
        if any(change.names for change in one.changes):
            found.append(one)
        else:
            why[name] = _NO_EFFECT
    return found, why


def _ReasonAgainst(name: str, number: Scalar, field: Input) -> str:
    """Returns a reason known in advance why a number has no field; "" without one."""
    if number.value != field.value:
        return "each controller has another value of it"
    if isinstance(number.range, GainRange):
        row, _, column = name.partition("(")[2].rstrip(")").partition(",")
        if column and row != column:
            return "the matrix must remain symmetric"
    if name.endswith(".gear_ratio"):
        return _NOT_AFFINE  # It is squared, and multiplied by the rotor inertia.
    if number.is_constant and number.value == 0 and re.search(r"\.D\b", name):
        return _OTHER_PROGRAM  # Most inputs have no direct feedthrough.
    return ""


def FixedNumbers(
    numbers: Iterable[Mapping[str, Scalar]], why: Mapping[str, str]
) -> dict[str, list[list[Any]]]:
    """Returns label, value and reason of the numbers without a field, keyed by path."""
    fixed: dict[str, dict[str, list[Any]]] = {}
    for own in numbers:
        for name, number in own.items():
            if name in why:
                rows = fixed.setdefault(number.paths[0], {})
                rows[name] = [_LabelOf(name, number), number.value, why[name]]
    return {path: list(rows.values()) for path, rows in fixed.items()}


def _LabelOf(name: str, number: Scalar) -> str:
    """Returns the label of a number in the box of its block."""
    short = name.removeprefix(f"{number.paths[0]}.")
    return f"{short} [{number.unit}]" if number.unit else short


def _MakeField(name: str, number: Scalar, runs: Runs) -> Input:
    """Returns the input of a number."""
    low, high = RangeAround(number, _FACTOR)
    if number.is_delay:
        low, high = DelayRange(number.value)
        low = low if runs.may_be_zero else LEAST_DELAY
    return Input(
        key=name,
        low=min(low, number.value),
        high=max(high, number.value),
        value=number.value,
        label=_LabelOf(name, number),
        owners=number.paths,
        is_delay=number.is_delay,
        is_field=True,
    )


def RangeAround(number: Scalar, factor: float) -> tuple[float, float]:
    """Returns a range around a number's value, within the allowed values."""
    value = number.value
    low, high = sorted((value / factor, value * factor)) if value else (-1.0, 1.0)
    if number.range is None:
        return low, high
    return max(low, number.range.minimum), min(high, number.range.maximum)


class _Finder:
    """Finds the slopes of a run's numbers in each field.

    Args:
        fields: The fields of the run by their names.
        make: Makes the run at values of inputs and fields.
        model: The run at its own values.
        inputs: The sliders, whose changes are known.
        place: The index of the run among the runs of the page.

    Attributes:
        found: The slopes of each field that can be changed.
        why: Why the others cannot.
    """

    def __init__(
        self,
        fields: Mapping[str, Input],
        make: Maker,
        model: Model,
        inputs: Sequence[Input],
        place: int,
    ):
        self.found: dict[str, Slopes] = {}
        self.why: dict[str, str] = {}
        self._fields = fields
        self._make = make
        self._model = model
        self._sliders = {one.key: one.changes[place] for one in inputs}
        self._random = np.random.default_rng(1)

    def Find(self, names: list[str]) -> None:
        """Finds the slopes of some fields, or the reasons why there are none."""
        if not names:
            return
        try:
            slopes = self._Explain(names)
        except (ScenarioError, UnsupportedSystem) as error:
            slopes = str(error).partition(": ")[2] or str(error)
        if not isinstance(slopes, str):
            self.found |= slopes
        elif len(names) == 1:
            self.why[names[0]] = slopes
        else:
            half = len(names) // 2
            self.Find(names[:half])
            self.Find(names[half:])

    def _Explain(self, names: list[str]) -> dict[str, Slopes] | str:
        """Returns the slopes of fields that explain all changes, or why there are none.

        Fields whose slopes are known change, too: the changes must add up.
        """
        steps = np.empty((_NUM_DRAWS, len(names)))
        draws = []
        for k in range(_NUM_DRAWS):
            values = self._Draw([*names, *self.found])
            steps[k] = [values[name] - self._fields[name].value for name in names]
            model = self._make(values)
            if model.structure != self._model.structure:
                return _OTHER_PROGRAM
            draws.append((model.numbers, self._Known(values, self.found)))
        slopes: dict[str, Slopes] = {name: {} for name in names}
        for array in self._model.numbers:
            pairs = [(new[array], known[array]) for new, known in draws]
            if any(new.shape != known.shape for new, known in pairs):
                return _OTHER_PROGRAM
            found = _Attribute(pairs, steps)
            if found is None:
                return _NOT_AFFINE
            for i, part in found.items():
                slopes[names[i]][array] = part
        return slopes

    def CheckSliders(self, names: list[str]) -> None:
        """Gives up the fields whose changes do not add to those by the sliders."""
        if not names or not self._sliders:
            return
        values = self._Draw(names)
        sliders = self._DrawSliders()
        model = self._make({**sliders, **values})
        known = self._Known(values, names, sliders)
        if all(
            z.shape == known[array].shape and NearlyEqual(z, known[array]).all()
            for array, z in model.numbers.items()
        ):
            return
        if len(names) == 1:
            del self.found[names[0]]
            self.why[names[0]] = _OF_SLIDER
            return
        half = len(names) // 2
        self.CheckSliders(names[:half])
        self.CheckSliders(names[half:])

    def _Draw(self, names: Iterable[str]) -> dict[str, float]:
        """Returns random values of fields, near the present ones where necessary."""
        values = {}
        for name in names:
            one = self._fields[name]
            is_near = name in self.found or "," in name
            share = _NEAR if is_near else 1.0
            low, high = (one.value + share * (end - one.value) for end in one.ends)
            values[name] = self._random.uniform(low, high)
        return values

    def _DrawSliders(self) -> dict[str, float]:
        """Returns random values of the sliders."""
        values = {}
        for name, change in self._sliders.items():
            ends = change.values[0], change.values[-1]
            values[name] = self._random.uniform(*ends)
            if change.stops or not change.slopes:
                values[name] = float(self._random.choice(change.values))
        return values

    def _Known(
        self,
        values: Mapping[str, float],
        names: Iterable[str],
        sliders: Mapping[str, float] = MappingProxyType({}),
    ) -> dict[str, Array]:
        """Returns the numbers as known fields and sliders change them."""
        result = {}
        for array, base in self._model.numbers.items():
            z = base
            for name, value in sliders.items():
                z = self._sliders[name].Added(array, base, z, value)
            for name in names:
                if array in self.found[name]:
                    z = z.copy()
                    places, rates = self.found[name][array]
                    z[places] += (values[name] - self._fields[name].value) * rates
            result[array] = z
        return result


def _Attribute(
    pairs: Sequence[tuple[Array, Array]], steps: Array
) -> dict[int, tuple[Any, Array]] | None:
    """Returns the places of an array that each field changes, and the slopes.

    Returns None if a place is not affine in one field alone.

    Args:
        pairs: For each draw, the array and what it is without the fields.
        steps: The change of each field in each draw (draws, fields).
    """
    with np.errstate(invalid="ignore"):
        changes = np.nan_to_num(np.array([new - known for new, known in pairs]))
    found: dict[int, tuple[list[int], list[float]]] = {}
    is_same = np.all([NearlyEqual(*pair) for pair in pairs], axis=0)
    for j in np.flatnonzero(~is_same):
        ratios = changes[:, j, np.newaxis] / steps
        slopes = ratios.mean(axis=0)
        spread = np.ptp(ratios, axis=0)
        (fitting,) = np.nonzero(spread <= _SAME_RATIO * np.abs(slopes))
        if len(fitting) != 1:
            return None
        places, rates = found.setdefault(int(fitting[0]), ([], []))
        places.append(int(j))
        rates.append(float(f"{slopes[fitting[0]]:.12g}"))
    return {i: (np.array(places), np.array(r)) for i, (places, r) in found.items()}
