"""Writes the living diagram: one HTML file in which a block diagram simulates."""

import dataclasses
import inspect
import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from typing import Any, TypeAlias

import numpy as np
from pydrake.systems.framework import Context, System

from teleop_drake.arrays import Array
from teleop_drake.blocks.environments import Surface
from teleop_drake.page.colors import PageColor
from teleop_drake.page.diagram_inputs import MakeDiagramInputs
from teleop_drake.page.document import Page
from teleop_drake.page.fields import (
    FieldNumbers,
    FindFields,
    FixedNumbers,
    WithNumbers,
)
from teleop_drake.page.hand import HandData
from teleop_drake.page.inputs import Input, Maker
from teleop_drake.page.late_wires import LateWires, MarginsInto
from teleop_drake.page.levels import Levels
from teleop_drake.page.model import MakeModel, Model
from teleop_drake.page.plants import ViewOf
from teleop_drake.page.python_lines import DiagramParts, ScenarioParts
from teleop_drake.page.scenario_model import PERIOD, ModelOf
from teleop_drake.page.sliders import DataOfInputs, MakeInputs, Ranges, Runs
from teleop_drake.parameters import Scalar, ScalarsIn, SetNumbers
from teleop_drake.scenario import (
    AnyScenario,
    AsTeleoperation,
    LoadOverridden,
)
from teleop_drake.scenario.overrides import Overrides
from teleop_drake.signals import NameOf
from teleop_drake.simulation.inputs import CheckInputs
from teleop_drake.simulation.run import Job
from teleop_drake.simulation.system_run import MakeJob
from teleop_drake.tasks import TaskOf
from teleop_drake.tasks.insertion_metrics import FirstNormal
from teleop_drake.validation import CheckChoice, CheckNames, Refuse, RefuseGiven

DURATION = 10.0
"""The default duration of the runs of a diagram, s."""

# The longest drive, s.
_LONGEST_DRIVE = 600.0


# A scenario, its name or file; a system; or a function that makes one.
Shown: TypeAlias = str | os.PathLike[str] | AnyScenario | System | Callable[[], System]


def Explore(
    scenario_or_diagram: Shown,
    overrides: Overrides = (),
    *,
    controllers: Sequence[str] | None = None,
    signals: Sequence[str] = (),
    context: Context | None = None,
    **ranges: Sequence[Any],
) -> Page:
    """Returns the living diagram for a notebook, with a slider for each range.

    Args:
        context: The initial Context of the runs of a diagram.
        **ranges: As `vary` of MakePage(), except that the range of a number may be
            given by any values, of which the least and the largest are its ends. All
            other arguments and errors are those of MakePage().
    """
    for key, values in ranges.items():
        if np.ndim(values) == 0 or not len(values):
            Refuse(key, values, "values to vary it: (LEAST, LARGEST), or several kinds")
    vary = {
        key: values if isinstance(values[0], str) else (min(values), max(values))
        for key, values in ranges.items()
    }
    return MakePage(
        scenario_or_diagram,
        controllers=controllers,
        signals=signals,
        vary=vary or None,
        overrides=overrides,
        context=context,
    )


def WritePage(
    scenario_or_diagram: Shown,
    path: str | os.PathLike[str],
    *,
    controllers: Sequence[str] | None = None,
    signals: Sequence[str] = (),
    vary: Ranges | None = None,
    overrides: Overrides = (),
    duration: float = DURATION,
    context: Context | None = None,
    suppress_initialization_events: bool = False,
    has_hand: bool = False,
    delays: str | None = None,
) -> list[str]:
    """Writes a living diagram.

    All arguments except the path are those of MakePage().

    Returns:
        Sentences on missing parts of the page, with reasons.

    Raises:
        OSError: If the file cannot be written. All others are those of MakePage().
    """
    page = MakePage(
        scenario_or_diagram,
        controllers=controllers,
        signals=signals,
        vary=vary,
        overrides=overrides,
        duration=duration,
        context=context,
        suppress_initialization_events=suppress_initialization_events,
        has_hand=has_hand,
        delays=delays,
    )
    page.Save(path)
    return page.notes


def MakePage(
    scenario_or_diagram: Shown,
    *,
    controllers: Sequence[str] | None = None,
    signals: Sequence[str] = (),
    vary: Ranges | None = None,
    overrides: Overrides = (),
    duration: float = DURATION,
    context: Context | None = None,
    suppress_initialization_events: bool = False,
    has_hand: bool = False,
    delays: str | None = None,
) -> Page:
    """Makes a page that shows a block diagram and simulates it.

    The page opens from disk in any current browser. It needs no network and loads no
    other file.

    Args:
        scenario_or_diagram: A scenario, its name or file; any system whose blocks have
            kernels; or a function that makes one, whose docstring is the page's story.
        controllers: The kinds of controllers to show side by side; None: those that the
            task compares. A diagram has none.
        signals: The signals that the scopes show at first, by their names in
            recordings; empty: velocity, force and position of the tool.
        vary: The numbers that can be changed, each with its least and largest value.
            Constant delays of a scenario can always be changed. A field that is not a
            number, such as `surgeon.kind`, has the values to choose from, each with a
            separate program. For a diagram, the keys are names of parameters and
            initial states, or `delay`; see SetNumbers(). None: all delays and, of a
            diagram, four parameters. Its other parameters have fields in the boxes of
            blocks.
        overrides: Overrides of the scenario, as for LoadScenario().
        duration: The duration of a diagram's runs, s.
        context: The initial Context of a diagram's runs, with parameters and fixed
            inputs; None: the default Context.
        suppress_initialization_events: As for simulate(), for a diagram's runs.
        has_hand: Whether the user of the page takes the operator's place.
        delays: "all": each connection of vectors has a delay of 0 s that can be
            changed; a click on it shows the delay and the margin by DelayMargins(),
            linearised where the run begins. None: only the delays of blocks.

    Raises:
        UnsupportedSystem: If a block has no kernel; the message names the block.
        ScenarioError: If a scenario or a range is not allowed, or if the changes of a
            number by two of `vary` do not add up.
    """
    notes: list[str] = []
    if delays not in (None, "all") or (delays and has_hand):
        Refuse("delays", delays, "'all' or None, and None where a hand drives")
    if isinstance(scenario_or_diagram, System) or callable(scenario_or_diagram):
        if controllers or overrides or has_hand:
            Refuse("controllers, overrides, has_hand", "given", "left out of a diagram")
        story = _Story(scenario_or_diagram)
        job = _DiagramJob(
            scenario_or_diagram, duration, context, suppress_initialization_events
        )
        data = _OfDiagram(job, vary, notes, has_late_wires=delays is not None)
        data["python"] = DiagramParts(scenario_or_diagram, job)
    else:
        RefuseGiven(
            "left out where a page is of a scenario",
            context=context,
            suppress_initialization_events=suppress_initialization_events,
        )
        scenario, _ = LoadOverridden(scenario_or_diagram, overrides)
        story = scenario.story
        data = _OfScenario(
            scenario,
            controllers,
            vary or {},
            notes,
            has_hand=has_hand,
            has_late_wires=delays is not None,
        )
        data["python"] = ScenarioParts(scenario_or_diagram, overrides)
        if has_hand:
            data["hand"] = HandData(
                AsTeleoperation(scenario),
                scenario_or_diagram,
                overrides,
                list(dict.fromkeys(loop["kind"] for loop in data["controllers"])),
                [one["name"] for one in data["inputs"]],
            )
    # A signal may exist with some controllers only.
    known = set().union(*(loop["signals"] for loop in data["controllers"]))
    CheckNames("signals", signals)
    for signal in signals:
        CheckChoice("signals", signal, sorted(known))
    data |= {"scopes": list(signals), "notes": notes}
    return Page(data["title"], story, data, notes)


def _DiagramJob(
    source: System | Callable[[], System],
    duration: float,
    context: Context | None,
    suppress_initialization_events: bool,
) -> Job:
    """Returns the specification of the runs of a diagram, or of one that is made."""
    system = source if isinstance(source, System) else source()
    if not isinstance(system, System):
        Refuse("scenario_or_diagram", source, "a function that returns a System")
    job = MakeJob(
        system,
        context,
        duration,
        None,
        suppress_initialization_events=suppress_initialization_events,
    )
    CheckInputs(system, job.context)
    return job


def _OfDiagram(
    job: Job, vary: Ranges | None, notes: list[str], *, has_late_wires: bool
) -> dict[str, Any]:
    """Returns the data of a diagram's page for its script, except the scopes."""
    system = job.diagram
    base: Model | None = None
    wires = LateWires.Of(system) if has_late_wires else None

    def Make(values: Mapping[str, float]) -> Model:
        """Returns the run at values of inputs; the first one is without any."""
        nonlocal base
        context = job.context.Clone()
        constants: dict[System, dict[str, Array]] = {}
        late = wires and wires.With(values)
        own = {x: v for x, v in values.items() if wires is None or not wires.Has(x)}
        changed = SetNumbers(system, context, own, constants)
        model = MakeModel(
            system,
            job.config,
            job.duration,
            context,
            suppress_initialization_events=job.suppress_initialization_events,
            like=base,
            changed=changed,
            constants=constants,
            late=late,
        )
        base = base or model
        return model

    # A diagram has one run, which takes the place of a controller's.
    title = NameOf(system)
    runs = Runs({(title,): Make}, notes)
    model = runs.models[(title,)]
    left_out = model.run.evaluator.left_out
    if left_out:
        paths = ", ".join(left_out)
        notes.append(f"{paths}: left out, as nothing depends on them")
    numbers = {
        name: number
        for name, number in ScalarsIn(system, job.context).items()
        if not set(number.paths) <= set(left_out)
    }
    inputs = MakeDiagramInputs(numbers, runs, vary)
    if wires is not None:
        numbers = wires.Scalars() | numbers
    fields, why = FindFields([FieldNumbers(numbers, inputs)], inputs, runs)
    data = {
        **_Data(title.replace("_", " "), [*inputs, *fields], {}, runs),
        "fixed": FixedNumbers([numbers], why),
        "view": ViewOf(plant.tree for plant in model.plants.values()),
        "hand": None,
        "isDiagram": True,
    }
    _AddWires(data, runs, job.context, notes)
    return data


def _AddWires(
    data: dict[str, Any], runs: Runs, context: Context | None, notes: list[str]
) -> None:
    """Adds the names of the delays of connections, and the margins of these.

    Args:
        data: The data of the page.
        runs: The runs of the page.
        context: The Context where they begin; None: the default Context of each.
        notes: The list to which the reasons for missing margins are added.
    """
    for loop, model in zip(data["controllers"], runs.models.values(), strict=True):
        if model.late is not None:
            start = context or model.diagram.CreateDefaultContext()
            loop["wires"] = model.late.Names(model.diagram)
            loop["margins"] = MarginsInto(model.diagram, start, notes)


def _OfScenario(
    scenario: AnyScenario,
    controllers: Sequence[str] | None,
    vary: Ranges,
    notes: list[str],
    *,
    has_hand: bool,
    has_late_wires: bool,
) -> dict[str, Any]:
    """Returns the data of a scenario's page for its script, except the scopes."""
    kinds = TaskOf(scenario).controllers if controllers is None else controllers
    kinds = list(kinds) or [scenario.controller.kind]
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
        **_Data(scenario.title or scenario.name, [*inputs, *fields], choices, runs),
        "fixed": FixedNumbers(numbers, why),
        "view": _View(scenario, first.surfaces),
        "hand": None,
        "isDiagram": False,
    }
    _AddWires(data, runs, None, notes)
    return data


def DiagramPage(diagram: System) -> Page:
    """Makes a page that shows any block diagram of Drake, without simulating it."""
    title = NameOf(diagram)
    shown: dict[str, Any] = {"kind": title, "title": title, "levels": Levels(diagram)}
    shown |= {"ports": {}, "signals": {}, "choice": {}}
    data = {"title": title, "notes": [], "inputs": [], "controllers": [shown]}
    return Page(title, _Story(diagram), data, [])


def _Story(source: System | Callable[[], System]) -> str:
    """Returns the first paragraph of the docstring of a class or a function."""
    documented = type(source) if isinstance(source, System) else source
    if documented.__module__.startswith("pydrake."):
        return ""
    return " ".join((inspect.getdoc(documented) or "").partition("\n\n")[0].split())


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


def _Data(
    title: str, inputs: list[Input], choices: Mapping[str, list[str]], runs: Runs
) -> dict[str, Any]:
    """Returns the data that the script needs in every page with runs."""
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
        "inputs": DataOfInputs(inputs, choices),
        "controllers": controllers,
    }
