"""The data of a scenario's page: its controllers, choices, sliders and hand."""

import dataclasses
import itertools
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from teleop_drake.loops.engine.parameters import Scalar, ScalarsIn
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.page.fields import (
    FieldNumbers,
    FindFields,
    FixedNumbers,
)
from teleop_drake.loops.page.inputs import Input, Maker
from teleop_drake.loops.page.model import Model, WithNumbers
from teleop_drake.loops.page.sliders import (
    DataOfRuns,
    DelayRange,
    Ranges,
    RangeWith,
    Runs,
)
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.scenario import AnyScenario, AsTeleoperation, LoadOverridden
from teleop_drake.model.scenario.overrides import ALIASES, Overrides, ParseOverrides
from teleop_drake.model.tasks import ComparedControllers, TaskOf
from teleop_drake.model.tasks.insertion_metrics import FirstNormal
from teleop_drake.study.figures.labels import AxisLabel
from teleop_drake.study.page.hand import HandData
from teleop_drake.study.page.scenario_model import ModelOf

_DELAYS = ("forward_delay", "return_delay")

# The blocks to which an input belongs, where its key does not begin with their name.
_OWNERS = {
    "delay": ["forward_channel", "return_channel"],
    "seed": ["forward_channel", "return_channel"],
    "surgeon": ["master"],
}

# The longest drive, s.
_LONGEST_DRIVE = 600.0


def DataOfScenario(
    source: Any,
    overrides: Overrides,
    controllers: Sequence[str] | None,
    vary: Ranges,
    notes: list[str],
    *,
    has_hand: bool,
    has_late_wires: bool,
) -> tuple[str, dict[str, Any]]:
    """Returns the story of a scenario, and the data of its page but the scopes.

    Args:
        source: The scenario, its name or file. Other arguments are those of MakePage().
        notes: The list to which notes are added.
        has_late_wires: Whether each connection has a delay, of 0 s.
    """
    scenario, _ = LoadOverridden(source, overrides)
    kinds = ComparedControllers(scenario) if controllers is None else list(controllers)
    kinds = kinds or [scenario.controller.kind]
    choices, ranges = _Choices(scenario, vary, has_hand)
    makers = {}
    for which in itertools.product(kinds, *choices.values()):
        chosen = dict(zip(["controller.kind", *choices], which, strict=True))
        makers[which] = _Maker(scenario, chosen, has_hand, has_late_wires)
    runs = Runs(makers, notes)
    first = next(iter(runs.models.values()))
    if not first.facts["metrics"]:
        notes.append("the metrics of this task are its own: `run` prints them")
    inputs = MakeInputs(scenario, ranges, runs)
    numbers = [] if has_hand else [_ScalarsOf(x) for x in runs.models.values()]
    fields, why = FindFields(
        [FieldNumbers(own, inputs) for own in numbers], inputs, runs
    )
    data = {
        **DataOfRuns(
            scenario.title or scenario.name, [*inputs, *fields], choices, runs
        ),
        "fixed": FixedNumbers(numbers, why),
        "view": _View(scenario, first.surfaces),
        "hand": None,
        "isDiagram": False,
        "python": _PythonParts(source, overrides),
    }
    data["inputs"] = _InputsWith(choices, data["inputs"])
    if has_hand:
        data["hand"] = HandData(
            AsTeleoperation(scenario),
            source,
            overrides,
            list(dict.fromkeys(loop["kind"] for loop in data["controllers"])),
            [one["name"] for one in data["inputs"]],
        )
    return scenario.story, data


def _PythonParts(source: Any, overrides: Overrides) -> dict[str, Any]:
    """Returns the parts of the Python lines that make the state of the page.

    They are `source`, an expression for the scenario's name or file, and `given`, the
    overrides as items of a dictionary.
    """
    is_named = isinstance(source, str | os.PathLike)
    return {
        "source": repr(os.fspath(source)) if is_named else "scenario_of_this_page",
        "given": [f"{path!r}: {value!r}" for path, value in ParseOverrides(overrides)],
    }


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


def _Choices(
    scenario: AnyScenario, vary: Ranges, has_hand: bool
) -> tuple[dict[str, list[str]], Ranges]:
    """Returns the choices in `vary`, the scenario's own value first, and its ranges."""
    choices: dict[str, list[str]] = {}
    ranges: dict[str, Sequence[float]] = {}
    for key, values in vary.items():
        if not all(isinstance(x, str) for x in values):
            ranges[key] = values
            continue
        if has_hand and key == "surgeon.kind":
            Refuse("vary", key, "left out: the user's hand is the operator")
        own = scenario.Value(key)
        if not isinstance(own, str):
            Refuse(f"vary.{key}", ",".join(values), "LO:HI of a number")
        choices[key] = list(dict.fromkeys([own, *values]))
    return choices, ranges


def _View(scenario: AnyScenario, surfaces: tuple[Surface, ...]) -> list[list[float]]:
    """Returns the directions to the right and upwards in the drawing of the task."""
    if scenario.num_axes < 3:
        up = 1.0 if scenario.num_axes == 2 else 0.0
        return [[1.0, 0.0, 0.0], [0.0, up, 0.0]]
    x, _, z = np.eye(3)
    v_d = x
    if hasattr(scenario, "surgeon"):
        v_d = np.asarray(scenario.surgeon.velocity, float)
    # The horizontal part of the normal.
    forward = FirstNormal(surfaces, v_d)[:3] * [1, 1, 0]
    size = np.linalg.norm(forward)
    forward = forward / size if size > 0.1 else x
    return [forward.tolist(), z.tolist()]


def _Maker(
    source: AnyScenario,
    overrides: Mapping[str, Any],
    has_hand: bool,
    has_late_wires: bool,
) -> Maker:
    """Returns a function that makes the run of a scenario from values of inputs."""

    base: Model | None = None
    names: set[str] = set()

    def Make(values: Mapping[str, float]) -> Model:
        """Returns the run at values of inputs; the first one is without any."""
        nonlocal base
        keys = {key: value for key, value in values.items() if key not in names}
        model = base
        if keys or model is None:
            scenario, _ = LoadOverridden(source, {**overrides, **keys})
            if has_hand:
                scenario = dataclasses.replace(scenario, duration=_LONGEST_DRIVE)
            TaskOf(scenario).Check(scenario)
            model = ModelOf(scenario, has_hand=has_hand, has_late_wires=has_late_wires)
        if base is None:
            base = model
            names.update(_ScalarsOf(base))
        own = {name: value for name, value in values.items() if name in names}
        return WithNumbers(model, own) if own else model

    return Make


def _ScalarsOf(model: Model) -> dict[str, Scalar]:
    """Returns the numbers of a scenario's blocks that no key of the scenario sets.

    Delays have sliders, and metrics depend on the operator.
    """
    diagram = model.diagram
    scalars = ScalarsIn(diagram, diagram.CreateDefaultContext())
    late = {} if model.late is None else model.late.Scalars()
    return late | {
        name: number
        for name, number in scalars.items()
        if not number.is_delay and not name.startswith("master/surgeon.")
    }


def _InputsWith(
    choices: Mapping[str, list[str]], inputs: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Returns the data of inputs and choices for the page's script.

    If both delays are continuous inputs, the first entry changes them together.

    Args:
        choices: The values of each field with several programs, its own value first.
        inputs: The data of the inputs.
    """
    # The slider of both delays covers the values that both may have.
    ways = [x for x in inputs if x["name"] in _DELAYS and not x["stops"]]
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
        inputs = [both, *inputs]
    return inputs + [
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
