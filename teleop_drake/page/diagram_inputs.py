"""The inputs of a Diagram's page: numbers of its Context, as sliders and as fields."""

from collections.abc import Mapping, Sequence

from teleop_drake.page.inputs import Input, NotSums
from teleop_drake.page.sliders import Ranges, RangeWith, Runs
from teleop_drake.parameters import Scalar
from teleop_drake.validation import CheckChoice

# Parameters that have sliders if no ranges are given.
_NUM_SLIDERS = 4

# Parameters that have fields in the opened boxes of their blocks, at most.
_MOST_FIELDS = 40

# The range of a field, as multiples of the parameter's value; and those that are tried
# where it is 0.
_FIELD = (0.25, 4.0)
_FIELDS_AT_ZERO = ((-1.0, 1.0), (0.0, 1.0))


Numbers = Mapping[str, Scalar]
"""The numbers of a diagram's Context; see ScalarsIn()."""


def _MakeInput(
    numbers: Numbers,
    key: str,
    ends: Sequence[float],
    *,
    is_wanted: bool = False,
    is_field: bool = False,
) -> Input:
    """Returns an input for a number; the box of a field has its block's path."""
    number = numbers[key]
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


def MakeDiagramInputs(
    numbers: Numbers, runs: Runs, vary: Ranges | None, notes: list[str]
) -> list[Input]:
    """Returns the inputs of a diagram's page.

    Args:
        runs: Those of `numbers`.
        vary: The least and the largest value of numbers by name; see SetNumbers().
            None: all delays, and some parameters.
        notes: Gets what has no slider, and why.

    Raises:
        ScenarioError: If a number of `vary` does not exist or cannot be changed.
    """
    wanted = _DefaultRanges(numbers, runs) if vary is None else vary
    for key in wanted:
        CheckChoice("vary", key, numbers)
    is_wanted = vary is not None
    varied = [
        _MakeInput(numbers, key, ends, is_wanted=is_wanted)
        for key, ends in wanted.items()
    ]
    inputs = runs.FindInputs([varied])
    return inputs + _Fields(numbers, inputs, runs, notes)


def _DefaultRanges(numbers: Numbers, runs: Runs) -> Ranges:
    """Returns ranges of the delays, and of the first parameters that have a size."""
    parameters = _Parameters(numbers)
    ranges: dict[str, Sequence[float]] = {
        name: runs.DelayRange(x.value) for name, x in parameters.items() if x.is_delay
    }
    others = [name for name, x in parameters.items() if not x.is_delay and x.value != 0]
    for name in others[:_NUM_SLIDERS]:
        value = numbers[name].value
        ranges[name] = sorted((0.5 * value, 2 * value))
    return ranges


def _Parameters(numbers: Numbers) -> dict[str, Scalar]:
    """Returns the parameters, each by its own name."""
    return {
        name: number
        for name, number in numbers.items()
        if name != "delay" and not number.is_state
    }


def _Fields(
    numbers: Numbers, inputs: Sequence[Input], runs: Runs, notes: list[str]
) -> list[Input]:
    """Returns the parameters that can be changed in the boxes of their blocks."""
    known = {one.key for one in inputs}
    rest = [
        name
        for name, number in _Parameters(numbers).items()
        if name not in known and not (number.is_delay and "delay" in known)
    ]
    if len(rest) > _MOST_FIELDS:
        more = len(rest) - _MOST_FIELDS
        notes.append(f"{more} more parameters have no field: name them in `vary`")
    fields: list[Input] = []
    for name in rest[:_MOST_FIELDS]:
        one = _Field(numbers, name, runs)
        if one is None:
            continue
        change = one.changes[0]
        others = [*inputs, *fields]
        met = [other for other in others if other.changes[0].Meets(change)]
        try:
            if met:
                runs.Check([*met, one])
            fields.append(one)
        except NotSums:
            continue
    return fields


def _Field(numbers: Numbers, name: str, runs: Runs) -> Input | None:
    """Returns the field of a parameter; None if no range has a linear effect."""
    value = numbers[name].value
    ranges: Sequence[Sequence[float]] = _FIELDS_AT_ZERO
    if numbers[name].is_delay:
        ranges = [runs.DelayRange(value)]
    elif value != 0:
        ranges = [sorted(share * value for share in _FIELD)]
    for ends in ranges:
        one = _MakeInput(numbers, name, ends, is_field=True)
        if runs.HasChanges(one) and one.is_continuous:
            return one
    return None
