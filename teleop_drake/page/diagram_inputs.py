"""The inputs of a Diagram's page: numbers of its Context, as sliders and as fields."""

import math
from collections.abc import Mapping, Sequence

from teleop_drake.page.inputs import Input, NotSums
from teleop_drake.page.sliders import DelayRange, Ranges, RangeWith, Runs
from teleop_drake.parameters import NumberName, Scalar
from teleop_drake.validation import CheckChoice

# The number of parameters with sliders, beside the delays, if no ranges are given.
_NUM_SLIDERS = 4

# The largest number of parameters with fields in the opened boxes of their blocks.
_MOST_FIELDS = 40

# A range reaches from a parameter's value divided by this to its value times this.
_FACTOR_OF_SLIDER = 2
_FACTOR_OF_FIELD = 4


def MakeDiagramInputs(
    numbers: Mapping[str, Scalar], runs: Runs, vary: Ranges | None, notes: list[str]
) -> list[Input]:
    """Returns the inputs of a diagram's page: first the sliders, then the fields.

    Args:
        numbers: The numbers of the diagram's Context, keyed by name; see ScalarsIn().
        runs: The runs of the diagram.
        vary: The least and the largest value of each number with a slider, keyed by
            name; see SetNumbers(). None selects all delays and some parameters.
        notes: The list to which the reasons for missing sliders and fields are added.

    Raises:
        ScenarioError: If a number of `vary` does not exist or cannot be changed.
    """
    parameters = {
        name: number
        for name, number in numbers.items()
        if name != "delay" and not number.is_state and math.isfinite(number.value)
    }
    # Elements of matrices have a slider if they are named in `vary`.
    constants = [x for x, number in parameters.items() if number.is_constant]
    for name in constants:
        number = parameters.pop(name)
        if "," not in name:
            parameters[name] = number
    ranges = _DefaultRanges(parameters) if vary is None else vary
    for key in ranges:
        CheckChoice("vary", NumberName(key), numbers)
    sliders = [
        _MakeInput(key, numbers[NumberName(key)], ends, is_wanted=vary is not None)
        for key, ends in ranges.items()
    ]
    inputs = runs.FindInputs([sliders])
    shown = {NumberName(one.key) for one in inputs}
    rest = [name for name in parameters if name not in shown]
    if len(rest) > _MOST_FIELDS:
        more = len(rest) - _MOST_FIELDS
        notes.append(f"{more} more parameters have no field: name them in `vary`")
    for name in rest[:_MOST_FIELDS]:
        for ends in _Ranges(parameters[name], _FACTOR_OF_FIELD):
            field = _MakeInput(name, parameters[name], ends, is_field=True)
            if _CanAdd(field, inputs, runs):
                inputs.append(field)
                break
    return inputs


def _DefaultRanges(parameters: Mapping[str, Scalar]) -> Ranges:
    """Returns the ranges of all delays and of the first parameters that are not 0."""
    delays = [name for name, x in parameters.items() if x.is_delay]
    sizes = [name for name, x in parameters.items() if not x.is_delay and x.value != 0]
    return {
        name: _Ranges(parameters[name], _FACTOR_OF_SLIDER)[0]
        for name in delays + sizes[:_NUM_SLIDERS]
    }


def _Ranges(number: Scalar, factor: float) -> list[Sequence[float]]:
    """Returns ranges for a number; a field takes the first one that is possible."""
    value = number.value
    if number.is_delay:
        return [DelayRange(value)]
    if value == 0:
        return [(-1.0, 1.0), (0.0, 1.0)]
    low, high = sorted((value / factor, value * factor))
    if number.range is not None:
        low = max(low, number.range.minimum)
        high = min(high, number.range.maximum)
    return [(low, high)]


def _MakeInput(
    key: str,
    number: Scalar,
    ends: Sequence[float],
    *,
    is_wanted: bool = False,
    is_field: bool = False,
) -> Input:
    """Returns an input for a number.

    The label of a field omits the path of its block, in whose box the field is.
    """
    low, high = RangeWith(key, ends, number.value)
    name = key.rpartition("/")[2] if is_field else key
    return Input(
        key=key,
        low=low,
        high=high,
        value=number.value,
        is_wanted=is_wanted,
        label=f"{name} [{number.unit}]" if number.unit else name,
        owners=number.paths,
        is_delay=number.is_delay,
        is_field=is_field,
    )


def _CanAdd(field: Input, inputs: Sequence[Input], runs: Runs) -> bool:
    """Returns whether a field is continuous, and its changes add to other inputs'."""
    if not (runs.HasChanges(field) and field.is_continuous):
        return False
    change = field.changes[0]
    met = [one for one in inputs if one.changes[0].Meets(change)]
    try:
        if met:
            runs.Check([*met, field])
    except NotSums:
        return False
    return True
