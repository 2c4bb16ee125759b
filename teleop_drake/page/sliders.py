"""The sliders of a page: which numbers can be changed, and in which range."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

from teleop_drake.figures.style import AxisLabel
from teleop_drake.page.inputs import Change, CheckSums, FindChange, NotSums, Stops
from teleop_drake.page.model import Model
from teleop_drake.scenario import AnyScenario, ScenarioError
from teleop_drake.sweep import ALIASES
from teleop_drake.validation import Refuse

_DELAYS = ("forward_delay", "return_delay")

# The least delay of a slider, s, where a loop without any is another program.
_LEAST_DELAY = 0.005

# What stands for no delay where programs are compared, s.
_ALMOST_ZERO = 1e-6

# The largest one is at least this, s, and at least twice that of the scenario.
_LARGE_DELAY = 0.5

# Fields of whole numbers.
WHOLE = ("seed",)

Ranges = Mapping[str, Sequence[Any]]

# Whose an input is beside the block that its key begins with.
_OWNERS = {
    "delay": ["forward_channel", "return_channel"],
    "seed": ["forward_channel", "return_channel"],
    "surgeon": ["master"],
}

# By the controller and what is chosen.
Models = Mapping[tuple[str, ...], Model]
Makers = Mapping[tuple[str, ...], Callable[[Mapping[str, float]], Model]]


@dataclass(kw_only=True)
class Input:
    """A number that can be changed.

    Attributes:
        key: Dotted path in the scenario, or an alias of several.
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
    is_wanted: bool
    label: str
    owners: list[str]
    is_delay: bool = False
    is_field: bool = False
    changes: list[Change] = field(default_factory=list)

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of its range at which runs are compared.

        A block that is made without a delay has another program.
        """
        return _ALMOST_ZERO if self.is_delay and self.low == 0 else self.low, self.high

    @property
    def stops(self) -> list[float]:
        """Its values if it is not continuous."""
        are_whole = self.key.rpartition(".")[2] in WHOLE
        return Stops(self.low, self.high, self.value, are_whole=are_whole)

    @property
    def is_continuous(self) -> bool:
        """Whether it is, for every controller."""
        return not any(change.stops for change in self.changes)


def MakeInputs(
    scenario: AnyScenario,
    vary: Ranges,
    makers: Makers,
    models: Models,
    notes: list[str],
) -> list[Input]:
    """Returns the inputs of a page.

    Where the delays change a number together, as gains that derive from the round trip,
    they are one input.
    """
    # Each key by the name that it has as an option.
    names = {paths[0]: alias for alias, paths in ALIASES.items() if alias in _DELAYS}
    vary = {names.get(key, key): values for key, values in vary.items()}
    reason = NotSums()
    others = [key for key in vary if key not in ("delay", *_DELAYS)]
    choices: list[tuple[str, ...]] = [_DELAYS, ("delay",)]
    if len(others) == len(vary):
        choices.append(())
    for delays in choices:
        inputs = [_MakeInput(key, scenario, vary, models) for key in (*delays, *others)]
        found = [x for x in inputs if x and FindChanges(x, makers, models, notes)]
        try:
            CheckInputs(found, makers, models)
            if not delays:
                notes.append(f"the delays have no sliders: {reason}")
            return found
        except NotSums as error:
            reason = error
    raise ScenarioError(f"vary = {reason}") from None


def _MakeInput(
    key: str, scenario: AnyScenario, vary: Ranges, models: Models
) -> Input | None:
    """Returns an input with its range; None if it is a delay that there is not."""
    is_delay = key in ("delay", *_DELAYS)
    wanted = vary.get(key, vary.get("delay") if is_delay else None)
    try:
        value = scenario.Value(ALIASES.get(key, (key,))[0])
    except ScenarioError:
        if is_delay:
            return None  # The tracking of chapter 3 has no channels.
        raise
    if isinstance(value, bool) or not isinstance(value, int | float):
        Refuse(key, value, "a number in the scenario, to be varied")
    low, high = RangeWith(key, wanted or DelayRange(value, models), value)
    return Input(
        key=key,
        low=low,
        high=high,
        value=value,
        is_wanted=wanted is not None,
        label=AxisLabel(key),
        owners=_OwnersOf(key),
        is_delay=is_delay,
    )


def DelayRange(value: float, models: Models) -> tuple[float, float]:
    """Returns the range of a delay's slider if none is given, s."""
    least = 0.0 if _MayBeZero(models) else _LEAST_DELAY
    return least, max(_LARGE_DELAY, 2 * value)


def RangeWith(key: str, ends: Sequence[Any], value: float) -> tuple[float, float]:
    """Returns a range that has a value in it, too."""
    if len(ends) != 2 or not all(isinstance(end, Real) for end in ends):
        Refuse(key, ends, "two numbers, the least and the largest value")
    low, high = ends
    if not low < high:
        Refuse(key, f"{low:g}:{high:g}", "LO:HI, the larger one behind")
    return min(low, value), max(high, value)


def FindChanges(one: Input, makers: Makers, models: Models, notes: list[str]) -> bool:
    """Finds out what an input changes; returns whether it can be one."""
    try:
        if one.is_delay and one.low <= 0:
            _CheckZero(one, models)
        one.changes = [
            FindChange(
                one.key,
                *one.ends,
                one.value,
                lambda v, make=make: make({one.key: v}),  # type: ignore[misc]
                one.stops,
                are_whole=one.key.rpartition(".")[2] in WHOLE,
            )
            for make in makers.values()
        ]
        if not any(change.names for change in one.changes):
            words = "a number that changes something in the run"
            Refuse(one.key, f"{one.low:g}:{one.high:g}", words)
    except ScenarioError as error:
        if one.is_wanted:
            raise
        if one.is_delay and one.low == 0:
            one.low = _LEAST_DELAY
            return FindChanges(one, makers, models, notes)
        notes.append(f"{one.key} has no slider: {error}")
        return False
    return True


def _CheckZero(one: Input, models: Models) -> None:
    """Refuses a delay that is negative, or is 0 where a loop needs it."""
    if one.low == 0 and _MayBeZero(models):
        return
    allowed = "0 s or more"
    if one.low == 0:
        allowed = "above 0 s, because without it a signal depends on itself"
    Refuse(one.key, f"{one.low:g}:{one.high:g}", allowed)


def _MayBeZero(models: Models) -> bool:
    """Returns whether constant delays may be 0 in all programs."""
    return all(model.has_zero_delays for model in models.values())


def CheckInputs(inputs: Sequence[Input], makers: Makers, models: Models) -> None:
    """Checks that the runs are the sum of what each input changes; see CheckSums()."""
    for i, (which, make) in enumerate(makers.items()):
        CheckSums(
            models[which].numbers,
            {
                one.key: (
                    one.value,
                    one.ends if one.is_continuous else one.stops,
                    one.changes[i],
                )
                for one in inputs
            },
            make,
        )


def DataOfInputs(
    inputs: Sequence[Input], choices: Mapping[str, list[str]]
) -> list[dict[str, Any]]:
    """Returns what the page says of inputs: that of both delays comes first."""
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
    ways = [x for x in result if x["name"] in _DELAYS and not x["stops"]]
    if len(ways) == 2:
        both = {**ways[0], "name": "delay", "parts": _DELAYS, "owners": []}
        both["label"] = "delay each way [s]"
        both["value"] = sum(x["value"] for x in ways) / 2
        both["min"] = max(x["min"] for x in ways)
        both["max"] = min(x["max"] for x in ways)
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
