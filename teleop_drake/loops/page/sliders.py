"""The sliders of a page: which numbers can be changed, and in which range."""

from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from numbers import Real
from typing import Any

from pydrake.systems.framework import Context

from teleop_drake.loops.engine.flatten import AlgebraicLoop
from teleop_drake.loops.framework.validation import Refuse, ScenarioError
from teleop_drake.loops.page.colors import PageColor
from teleop_drake.loops.page.inputs import CheckSums, FindChange, Input, Maker, NotSums
from teleop_drake.loops.page.late_wires import MarginsInto
from teleop_drake.loops.page.model import PERIOD, Model

# The least delay of a slider, s, where a loop without delay is another program.
LEAST_DELAY = 0.005

# The end of a delay's default range, s; twice the scenario's delay if that is more.
_LARGE_DELAY = 0.5

Ranges = Mapping[str, Sequence[Any]]


class Runs:
    """The runs of a page, whose numbers are changed by inputs.

    Args:
        makers: Functions that make a run, keyed by its controller and chosen values.
        notes: The list to which the reasons for missing sliders are added.

    Attributes:
        models: The runs at the scenario's or the Context's own values, keyed as in
            `makers`.
        makers: See above.
        notes: See above.
        may_be_zero: Whether constant delays may be 0 in all programs.
    """

    def __init__(self, makers: Mapping[tuple[str, ...], Maker], notes: list[str]):
        self.models = {which: make({}) for which, make in makers.items()}
        self.makers = makers
        self.notes = notes
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
                    is_known = bool(one.changes)
                    has_changes[one.key] = is_known or self.HasChanges(one)
            found = [one for one in inputs if has_changes[one.key]]
            try:
                self.Check(found)
            except NotSums as error:
                reason = error
                continue
            if reason and not any(one.is_delay for one in inputs):
                self.notes.append(f"the delays have no sliders: {reason}")
            return found
        raise ScenarioError(f"vary = {reason}")

    def HasChanges(self, one: Input) -> bool:
        """Sets the changes by an input; returns whether there are any.

        A range of a delay that cannot begin at 0 begins at LEAST_DELAY. The reason why
        a delay cannot be changed is noted.

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
            one.changes = []
            if one.is_delay and not one.is_field:
                self.notes.append(f"{one.key} has no slider: {error}")
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


def _DataOfInputs(inputs: Iterable[Input]) -> list[dict[str, Any]]:
    """Returns the data of inputs for the page's script."""
    return [
        {
            "name": one.key,
            "label": one.label,
            "unit": one.label.partition("[")[2].rstrip("]"),
            "owners": one.owners,
            "isField": one.is_field,
            "isDelay": one.is_delay,
            "isTried": one.is_tried,
            "value": one.value,
            "min": one.low if one.is_continuous else one.stops[0],
            "max": one.high if one.is_continuous else one.stops[-1],
            "stops": None if one.is_continuous else one.stops,
        }
        for one in inputs
    ]


def DataOfRuns(
    title: str,
    inputs: Sequence[Input],
    choices: Iterable[str],
    runs: Runs,
    context: Context | None = None,
) -> dict[str, Any]:
    """Returns the data that the script needs in every page with runs.

    Args:
        title: The title of the page.
        inputs: The inputs of the runs.
        choices: The fields whose values have a program each.
        context: The Context where the runs begin; None: the default Context of each.
    """
    kinds = list(dict.fromkeys(which[0] for which in runs.models))
    controllers = []
    for i, (which, model) in enumerate(runs.models.items()):
        controllers.append(
            {
                "kind": which[0],
                "choice": dict(zip(choices, which[1:], strict=True)),
                "title": which[0].replace("_", " "),
                "color": PageColor(kinds.index(which[0])),
                **model.Data(),
                **_DataOfWires(model, context, runs.notes),
                "changes": {
                    one.key: {
                        "slopes": one.changes[i].slopes,
                        "stops": one.changes[i].stops,
                    }
                    for one in inputs
                },
            }
        )
    return {
        "title": title,
        "version": metadata.version("teleop-drake"),
        "period": PERIOD,
        "inputs": _DataOfInputs(inputs),
        "controllers": controllers,
    }


def _DataOfWires(
    model: Model, context: Context | None, notes: list[str]
) -> dict[str, Any]:
    """Returns the names and the margins of delays on connections; {} without them."""
    if model.late is None:
        return {}
    diagram = model.diagram
    start = context or diagram.CreateDefaultContext()
    return {
        "wires": model.late.Names(diagram),
        "margins": MarginsInto(diagram, start, notes),
    }
