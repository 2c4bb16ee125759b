"""The inputs of a Diagram's page: numbers of its Context, as sliders and as fields."""

from collections.abc import Sequence

from pydrake.systems.framework import Context, System

from teleop_drake.page.inputs import Input, NotSums
from teleop_drake.page.sliders import Ranges, RangeWith, Runs
from teleop_drake.parameters import (
    DelayNames,
    InitialStates,
    ScalarsIn,
)
from teleop_drake.validation import Choices, Refuse

# Parameters that have sliders if no ranges are given.
_NUM_SLIDERS = 4

# Parameters that have fields in the opened boxes of their blocks, at most.
_MOST_FIELDS = 40

# The range of a field, as multiples of the parameter's value; and those that are tried
# where it is 0.
_FIELD = (0.25, 4.0)
_FIELDS_AT_ZERO = ((-1.0, 1.0), (0.0, 1.0))


class DiagramNumbers:
    """The numbers of a diagram's Context.

    Args:
        diagram: The diagram.
        context: Where runs begin.

    Attributes:
        scalars: Values and units of all elements of parameters.
        delays: Names of the parameters that are delays.
        values: Values of parameters and initial states, and `delay` if all are equal.
    """

    def __init__(self, diagram: System, context: Context):
        self.scalars = ScalarsIn(diagram, context)
        self.delays = DelayNames(diagram, context)
        self.values = {name: value for name, (value, _) in self.scalars.items()}
        self.values |= InitialStates(diagram, context)
        delays = {self.values[name] for name in self.delays}
        if len(delays) == 1:
            (self.values["delay"],) = delays

    def Input(
        self,
        key: str,
        ends: Sequence[float],
        *,
        is_wanted: bool = False,
        is_field: bool = False,
    ) -> Input:
        """Returns an input for a number; the box of a field has its block's path."""
        low, high = RangeWith(key, ends, self.values[key])
        unit = "s" if key == "delay" else ""
        if key in self.scalars:
            _, unit = self.scalars[key]
        name = key.rpartition("/")[2] if is_field else key
        return Input(
            key=key,
            low=low,
            high=high,
            value=self.values[key],
            is_wanted=is_wanted,
            label=f"{name} [{unit}]" if unit else name,
            owners=[_PathOf(x) for x in (self.delays if key == "delay" else [key])],
            is_delay=key in (*self.delays, "delay"),
            is_field=is_field,
        )


def MakeDiagramInputs(
    numbers: DiagramNumbers, runs: Runs, vary: Ranges | None, notes: list[str]
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
        if key not in numbers.values:
            Refuse("vary", key, Choices(key, list(numbers.values)))
    is_wanted = vary is not None
    varied = [
        numbers.Input(key, ends, is_wanted=is_wanted) for key, ends in wanted.items()
    ]
    inputs = runs.FindInputs([varied])
    return inputs + _Fields(numbers, inputs, runs, notes)


def _DefaultRanges(numbers: DiagramNumbers, runs: Runs) -> Ranges:
    """Returns ranges of the delays, and of the first parameters that have a size."""
    values = numbers.values
    ranges: dict[str, Sequence[float]] = {
        name: runs.DelayRange(values[name]) for name in numbers.delays
    }
    others = [x for x in numbers.scalars if x not in ranges and values[x] != 0]
    for name in others[:_NUM_SLIDERS]:
        value = values[name]
        ranges[name] = sorted((0.5 * value, 2 * value))
    return ranges


def _Fields(
    numbers: DiagramNumbers, inputs: Sequence[Input], runs: Runs, notes: list[str]
) -> list[Input]:
    """Returns the parameters that can be changed in the boxes of their blocks."""
    known = {one.key for one in inputs}
    if "delay" in known:
        known |= {*numbers.delays}
    rest = [name for name in numbers.scalars if name not in known]
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


def _Field(numbers: DiagramNumbers, name: str, runs: Runs) -> Input | None:
    """Returns the field of a parameter; None if no range has a linear effect."""
    value = numbers.values[name]
    ranges: Sequence[Sequence[float]] = _FIELDS_AT_ZERO
    if name in numbers.delays:
        ranges = [runs.DelayRange(value)]
    elif value != 0:
        ranges = [sorted(share * value for share in _FIELD)]
    for ends in ranges:
        one = numbers.Input(name, ends, is_field=True)
        if runs.HasChanges(one) and one.is_continuous:
            return one
    return None


def _PathOf(key: str) -> str:
    """Returns the path of a number's block, as `robot/plant` of `robot/plant.mass`."""
    folder, slash, name = key.rpartition("/")
    if name.endswith("(0)") and "." not in name:
        return folder
    return f"{folder}{slash}{name.partition('.')[0]}"
