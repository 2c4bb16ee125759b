"""The sliders of a Diagram's page: numbers of its Context."""

from collections.abc import Mapping, Sequence

from teleop_drake.loops.engine.parameters import NumberName, Scalar
from teleop_drake.loops.framework.validation import CheckChoice
from teleop_drake.loops.page.fields import FieldNumbers, RangeAround
from teleop_drake.loops.page.inputs import Input
from teleop_drake.loops.page.sliders import DelayRange, Ranges, RangeWith, Runs

# The number of parameters with sliders, beside the delays, if no ranges are given.
_NUM_SLIDERS = 4

# A range reaches from a parameter's value divided by this to its value times this.
_FACTOR = 2


def MakeDiagramInputs(
    numbers: Mapping[str, Scalar], runs: Runs, vary: Ranges | None
) -> list[Input]:
    """Returns the sliders of a diagram's page.

    Args:
        numbers: The numbers of the diagram's Context, keyed by name; see ScalarsIn().
        runs: The runs of the diagram.
        vary: The least and the largest value of each number with a slider, keyed by
            name; see SetNumbers(). None selects all delays and some parameters.

    Raises:
        ScenarioError: If a number of `vary` does not exist or cannot be changed.
    """
    ranges = _DefaultRanges(numbers) if vary is None else vary
    for key in ranges:
        CheckChoice("vary", NumberName(key), numbers)
    sliders = [
        _MakeInput(key, numbers[NumberName(key)], ends, is_wanted=vary is not None)
        for key, ends in ranges.items()
    ]
    return runs.FindInputs([sliders])


def _DefaultRanges(numbers: Mapping[str, Scalar]) -> Ranges:
    """Returns the ranges of all delays and of the first parameters that are not 0."""
    parameters = FieldNumbers(numbers, ())
    delays = [name for name, x in parameters.items() if x.is_delay]
    # Elements of matrices have a slider if they are named in `vary`.
    sizes = [
        name
        for name, x in parameters.items()
        if not x.is_delay and x.value != 0 and not (x.is_constant and "," in name)
    ]
    return {
        **{name: DelayRange(parameters[name].value) for name in delays},
        **{
            name: RangeAround(parameters[name], _FACTOR)
            for name in sizes[:_NUM_SLIDERS]
        },
    }


def _MakeInput(
    key: str, number: Scalar, ends: Sequence[float], *, is_wanted: bool
) -> Input:
    """Returns the slider of a number."""
    low, high = RangeWith(key, ends, number.value)
    return Input(
        key=key,
        low=low,
        high=high,
        value=number.value,
        is_wanted=is_wanted,
        label=f"{key} [{number.unit}]" if number.unit else key,
        owners=number.paths,
        is_delay=number.is_delay,
    )
