"""The sliders of a Diagram's page: numbers of its Context."""

import re
from collections.abc import Mapping, Sequence

from teleop_drake.loops.engine.parameters import NumberName, Scalar
from teleop_drake.loops.framework.signals import HasName, SystemsByPath
from teleop_drake.loops.framework.validation import CheckChoice
from teleop_drake.loops.page.fields import FieldNumbers, RangeAround
from teleop_drake.loops.page.inputs import Input
from teleop_drake.loops.page.sliders import DelayRange, Ranges, RangeWith, Runs

# The number of parameters with sliders, beside the delays, if no ranges are given.
_NUM_SLIDERS = 4

# A range reaches from a parameter's value divided by this to its value times this.
_FACTOR = 2

# What one drags first: gains, then masses, lengths, limits and what is held.
_SOUGHT = (
    re.compile(r"k[pid]?|\w*gain\w*|stiffness"),
    re.compile(r"m\d*|mass|l\d*|length|value|(min|max)_value"),
)

# Numbers that Drake has named, or nobody: they have an index for a name, and there may
# be hundreds, as the weights of a network.
_NAMELESS = re.compile(r"parameter\d+|[ABCD]|[fy]0|gear_ratio")


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
    if vary is None:
        sliders = _DefaultSliders(numbers, runs)
        return runs.FindInputs([sliders])
    for key in vary:
        CheckChoice("vary", NumberName(key), numbers)
    sliders = [
        _MakeInput(key, numbers[NumberName(key)], ends, is_wanted=True)
        for key, ends in vary.items()
    ]
    return runs.FindInputs([sliders])


def _DefaultSliders(numbers: Mapping[str, Scalar], runs: Runs) -> list[Input]:
    """Returns the sliders of all delays and of the parameters that are sought first.

    Of each array it is the first element that is not 0 and changes the run.
    """
    parameters = FieldNumbers(numbers, ())
    delays = {name: x for name, x in parameters.items() if x.is_delay}
    others = {name: x for name, x in parameters.items() if not x.is_delay and x.value}
    (model,) = runs.models.values()
    systems = SystemsByPath(model.diagram)
    chosen = {path for path, system in systems.items() if HasName(system)}
    ranks = {name: _RankOf(name, x, chosen) for name, x in others.items()}
    sliders = [
        _MakeInput(name, x, DelayRange(x.value), is_wanted=False)
        for name, x in delays.items()
    ]
    arrays = set()
    for name in sorted(others, key=lambda x: (ranks[x], x.count("/"))):
        whole, _, index = name.partition("(")
        is_listed = ranks[name] == len(_SOUGHT) + 1 and bool(index)
        if whole in arrays or is_listed:
            continue
        one = _MakeInput(name, others[name], RangeAround(others[name], _FACTOR))
        one.is_tried = ranks[name] <= len(_SOUGHT)
        if runs.HasChanges(one):
            arrays.add(whole)
            sliders.append(one)
        if len(arrays) == _NUM_SLIDERS:
            break
    return sliders


def _RankOf(name: str, number: Scalar, chosen: set[str]) -> int:
    """Returns how soon a person would drag a number: 0 is the first.

    A gain of -1 is a sign, and comes last.

    Args:
        chosen: The paths of systems that their user has named.
    """
    path = number.paths[0]
    own = name.removeprefix(f"{path}.").partition("(")[0].rpartition(".")[2]
    is_sign = own == "k" and number.value == -1
    if path not in chosen or is_sign or _NAMELESS.fullmatch(own):
        return len(_SOUGHT) + 1
    fitting = (i for i, words in enumerate(_SOUGHT) if words.fullmatch(own))
    return next(fitting, len(_SOUGHT))


def _MakeInput(
    key: str, number: Scalar, ends: Sequence[float], *, is_wanted: bool = False
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
