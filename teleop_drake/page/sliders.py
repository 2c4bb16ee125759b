"""The sliders of a page: which numbers can be changed, and in which range."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import Any

from teleop_drake.engine.flatten import AlgebraicLoop
from teleop_drake.figures.labels import AxisLabel
from teleop_drake.page.inputs import CheckSums, FindChange, Input, Maker, NotSums
from teleop_drake.scenario import AnyScenario, ScenarioError
from teleop_drake.scenario.overrides import ALIASES
from teleop_drake.tasks import TaskOf
from teleop_drake.validation import Refuse

_DELAYS = ("forward_delay", "return_delay")

# The least delay of a slider, s, where a loop without delay is another program.
LEAST_DELAY = 0.005

# The end of a delay's default range, s; twice the scenario's delay if that is more.
_LARGE_DELAY = 0.5

Ranges = Mapping[str, Sequence[Any]]

# The blocks to which an input belongs, where its key does not begin with their name.
_OWNERS = {
    "delay": ["forward_channel", "return_channel"],
    "seed": ["forward_channel", "return_channel"],
    "surgeon": ["master"],
}


class Runs:
    """The runs of a page, whose numbers are changed by inputs.

    Args:
        makers: Functions that make a run, keyed by its controller and chosen values.
        notes: The list to which the reasons for missing sliders are added.

    Attributes:
        models: The runs at the scenario's or the Context's own values, keyed as in
            `makers`.
        makers: See above.
        may_be_zero: Whether constant delays may be 0 in all programs.
    """

    def __init__(self, makers: Mapping[tuple[str, ...], Maker], notes: list[str]):
        self.models = {which: make({}) for which, make in makers.items()}
        self.makers = makers
        self._notes = notes
        self.may_be_zero = all(x.has_zero_delays for x in self.models.values())

    def FindInputs(self, alternatives: Iterable[Sequence[Input]]) -> list[Input]:
        """Returns those inputs of an alternative that can be changed.

        Args:
            alternatives: Lists of inputs, which may share inputs. The first list is
                used whose changes of the runs add up; see CheckSums().

        Raises:
            ScenarioError: If a wanted input cannot be changed, or if the changes add up
                in no alternative.
        """
        reason = None
        has_changes: dict[str, bool] = {}
        for inputs in alternatives:
            for one in inputs:
                if one.key not in has_changes:
                    has_changes[one.key] = self.HasChanges(one)
            found = [one for one in inputs if has_changes[one.key]]
            try:
                self.Check(found)
            except NotSums as error:
                reason = error
                continue
            if reason and not any(one.is_delay for one in inputs):
                self._notes.append(f"the delays have no sliders: {reason}")
            return found
        raise ScenarioError(f"vary = {reason}")

    def HasChanges(self, one: Input) -> bool:
        """Sets the changes by an input; returns whether there are any.

        A range of a delay that cannot begin at 0 begins at LEAST_DELAY. The reason why
        an input cannot be changed is noted, unless it is a field.

        Raises:
            ScenarioError: If an input is wanted, but cannot be changed.
            AlgebraicLoop: If a wanted input makes a signal depend on itself.
        """
        try:
            self._CheckZero(one)
            one.changes = [FindChange(one, make) for make in self.makers.values()]
            if not any(change.names for change in one.changes):
                words = "a number that changes something in the run"
                Refuse(one.key, one.span, words)
        except (ScenarioError, AlgebraicLoop) as error:
            if one.is_wanted:
                raise
            if one.is_delay and one.low == 0 < one.value:
                one.low = min(LEAST_DELAY, one.value)
                return self.HasChanges(one)
            if not one.is_field:
                self._notes.append(f"{one.key} has no slider: {error}")
            return False
        return True

    def _CheckZero(self, one: Input) -> None:
        """Refuses a delay that is negative, or is 0 where a loop needs it."""
        if not one.is_delay or one.low > 0:
            return
        allowed = "0 s or more"
        if one.low == 0:
            if self.may_be_zero:
                return
            allowed = "above 0 s, because without it a signal depends on itself"
        Refuse(one.key, one.span, allowed)

    def Check(self, inputs: Iterable[Input]) -> None:
        """Checks for every run that the changes by inputs add up; see CheckSums().

        Raises:
            NotSums: If they do not.
        """
        for i, (which, make) in enumerate(self.makers.items()):
            changes = {one.key: one.changes[i] for one in inputs}
            CheckSums(self.models[which].numbers, changes, make)


def MakeInputs(scenario: AnyScenario, vary: Ranges, runs: Runs) -> list[Input]:
    """Returns the inputs of a scenario's page.

    One input changes both delays if their changes of a number do not add up, as with
    gains that depend on the round trip.
    """
    # The paths of the delays are replaced by the names of their options.
    names = {ALIASES[delay][0]: delay for delay in _DELAYS}
    vary = {names.get(key, key): values for key, values in vary.items()}
    others = [key for key in vary if key not in ("delay", *_DELAYS)]
    choices: list[tuple[str, ...]] = []
    if TaskOf(scenario).Channels(scenario):
        choices += [_DELAYS, ("delay",)]
    if len(others) == len(vary) or not choices:
        choices.append(())
    keys = dict.fromkeys([*itertools.chain(*choices), *others])
    inputs = {key: _MakeInput(key, scenario, vary) for key in keys}
    return runs.FindInputs(
        [inputs[key] for key in (*delays, *others)] for delays in choices
    )


def _MakeInput(key: str, scenario: AnyScenario, vary: Ranges) -> Input:
    """Returns an input with its range."""
    is_delay = key in ("delay", *_DELAYS)
    wanted = vary.get(key, vary.get("delay") if is_delay else None)
    value = scenario.Value(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        Refuse(key, value, "a number in the scenario, to be varied")
    low, high = RangeWith(key, wanted or DelayRange(value), value)
    return Input(
        key=key,
        low=low,
        high=high,
        value=value,
        label=AxisLabel(key),
        owners=_OwnersOf(key),
        is_wanted=wanted is not None,
        is_delay=is_delay,
    )


def DelayRange(value: float) -> tuple[float, float]:
    """Returns the default range of a delay's slider, s; see Runs.HasChanges()."""
    return 0.0, max(_LARGE_DELAY, 2 * value)


def RangeWith(key: str, ends: Sequence[Any], value: float) -> tuple[float, float]:
    """Returns a range, extended if necessary to include a value.

    Raises:
        ScenarioError: If the ends are not two ascending numbers.
    """
    are_numbers = all(isinstance(end, Real) for end in ends)
    if len(ends) != 2 or not are_numbers:
        Refuse(key, ends, "two numbers, the least and the largest value")
    low, high = ends
    if not low < high:
        Refuse(key, f"{low:g}:{high:g}", "LO:HI, the larger one behind")
    return min(low, value), max(high, value)


def DataOfInputs(
    inputs: Sequence[Input], choices: Mapping[str, list[str]]
) -> list[dict[str, Any]]:
    """Returns the data of inputs and choices for the page's script.

    If both delays are continuous inputs, the first entry changes them together.
    """
    result: list[dict[str, Any]] = [
        {
            "name": one.key,
            "label": one.label,
            "unit": one.label.partition("[")[2].rstrip("]"),
            "owners": one.owners,
            "isField": one.is_field,
            "value": one.value,
            "min": one.low if one.is_continuous else one.stops[0],
            "max": one.high if one.is_continuous else one.stops[-1],
            "stops": None if one.is_continuous else one.stops,
        }
        for one in inputs
    ]
    # The slider of both delays covers the values that both may have.
    ways = [x for x in result if x["name"] in _DELAYS and not x["stops"]]
    if len(ways) == 2:
        both = {
            **ways[0],
            "name": "delay",
            "label": "delay each way [s]",
            "parts": _DELAYS,
            "owners": [],
            "value": sum(x["value"] for x in ways) / 2,
            "min": max(x["min"] for x in ways),
            "max": min(x["max"] for x in ways),
        }
        result.insert(0, both)
    return result + [
        {
            "name": key,
            "label": AxisLabel(key),
            "owners": _OwnersOf(key),
            "value": values[0],
            "choices": values,
        }
        for key, values in choices.items()
    ]


def _OwnersOf(key: str) -> list[str]:
    """Returns the blocks of the loop to which an input belongs."""
    first = key.replace("_delay", "_channel").partition(".")[0]
    return _OWNERS.get(first, [first])
