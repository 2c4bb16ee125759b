"""The page of a System: its block diagram, which the page simulates."""

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydrake.systems.framework import Context, System

from teleop_drake.loops.engine.parameters import ScalarsIn
from teleop_drake.loops.framework.signals import NameOf
from teleop_drake.loops.framework.validation import CheckChoice, CheckNames, Refuse
from teleop_drake.loops.page.diagram_inputs import MakeDiagramInputs
from teleop_drake.loops.page.document import Page
from teleop_drake.loops.page.fields import FieldNumbers, FindFields, FixedNumbers
from teleop_drake.loops.page.late_wires import LateWires
from teleop_drake.loops.page.levels import Levels
from teleop_drake.loops.page.model import MakeModel, Model, WithNumbers
from teleop_drake.loops.page.plants import ViewOf
from teleop_drake.loops.page.python_lines import DiagramParts
from teleop_drake.loops.page.sliders import DataOfRuns, Ranges, Runs
from teleop_drake.loops.run.inputs import CheckInputs
from teleop_drake.loops.run.run import Job
from teleop_drake.loops.run.system_run import MakeJob

DURATION = 10.0
"""The default duration of the runs of a diagram, s."""


def WritePage(
    diagram: System | Callable[[], System],
    path: str | os.PathLike[str],
    *,
    signals: Sequence[str] = (),
    vary: Ranges | None = None,
    duration: float = DURATION,
    context: Context | None = None,
    suppress_initialization_events: bool = False,
    delays: str | None = None,
) -> list[str]:
    """Writes the page of a System.

    All arguments except the path are those of MakePage().

    Returns:
        Sentences on missing parts of the page, with reasons.

    Raises:
        OSError: If the file cannot be written. All others are those of MakePage().
    """
    page = MakePage(
        diagram,
        signals=signals,
        vary=vary,
        duration=duration,
        context=context,
        suppress_initialization_events=suppress_initialization_events,
        delays=delays,
    )
    page.Save(path)
    return page.notes


def MakePage(
    diagram: System | Callable[[], System],
    *,
    signals: Sequence[str] = (),
    vary: Ranges | None = None,
    duration: float = DURATION,
    context: Context | None = None,
    suppress_initialization_events: bool = False,
    delays: str | None = None,
) -> Page:
    """Makes a page that shows the block diagram of a System and simulates it.

    The arguments and errors are those of teleop_drake.MakePage().
    """
    notes: list[str] = []
    CheckDelays(delays)
    job = _JobOf(diagram, duration, context, suppress_initialization_events)
    data = _DataOf(job, vary, notes, has_late_wires=delays is not None)
    data["python"] = DiagramParts(diagram, job)
    return FinishPage(StoryOf(diagram), data, signals, notes)


def CheckDelays(delays: str | None, *, has_hand: bool = False) -> None:
    """Refuses a value of the argument `delays`."""
    if delays not in (None, "all") or (delays and has_hand):
        Refuse("delays", delays, "'all' or None, and None where a hand drives")


def FinishPage(
    story: str, data: dict[str, Any], signals: Sequence[str], notes: list[str]
) -> Page:
    """Returns the page with some data, whose scopes show the given signals."""
    # A signal may exist with some controllers only.
    known = set().union(*(loop["signals"] for loop in data["controllers"]))
    CheckNames("signals", signals)
    for signal in signals:
        CheckChoice("signals", signal, sorted(known))
    data |= {"scopes": list(signals), "notes": notes}
    return Page(data["title"], story, data, notes)


def _JobOf(
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


def _DataOf(
    job: Job, vary: Ranges | None, notes: list[str], *, has_late_wires: bool
) -> dict[str, Any]:
    """Returns the data of a diagram's page for its script, except the scopes."""
    system = job.diagram
    base: Model | None = None
    wires = LateWires.Of(system) if has_late_wires else None

    def Make(values: Mapping[str, float]) -> Model:
        """Returns the run at values of inputs; the first one is without any."""
        nonlocal base
        if base is None:
            suppress = job.suppress_initialization_events
            base = MakeModel(
                system,
                job.config,
                job.duration,
                job.context,
                suppress_initialization_events=suppress,
                late=wires,
            )
        return WithNumbers(base, values) if values else base

    # A diagram has one run, which takes the place of a controller's.
    title = NameOf(system)
    runs = Runs({(title,): Make}, notes)
    model = runs.models[(title,)]
    left_out = model.run.evaluator.left_out
    if left_out:
        paths = ", ".join(left_out)
        notes.append(f"{paths}: left out, without an effect on the signals")
    numbers = {
        name: number
        for name, number in ScalarsIn(system, job.context).items()
        if not set(number.paths) <= set(left_out)
    }
    inputs = MakeDiagramInputs(numbers, runs, vary)
    if wires is not None:
        numbers = wires.Scalars() | numbers
    fields, why = FindFields([FieldNumbers(numbers, inputs)], inputs, runs)
    return {
        **DataOfRuns(
            title.replace("_", " "), [*inputs, *fields], {}, runs, job.context
        ),
        "fixed": FixedNumbers([numbers], why),
        "view": ViewOf(plant.tree for plant in model.plants.values()),
        "hand": None,
        "isDiagram": True,
    }


def DiagramPage(diagram: System) -> Page:
    """Makes a page that shows any block diagram of Drake, without simulating it."""
    title = NameOf(diagram)
    shown: dict[str, Any] = {"kind": title, "title": title, "levels": Levels(diagram)}
    shown |= {"ports": {}, "signals": {}, "choice": {}}
    data = {"title": title, "notes": [], "inputs": [], "controllers": [shown]}
    return Page(title, StoryOf(diagram), data, [])


def StoryOf(source: System | Callable[[], System]) -> str:
    """Returns the first paragraph of the docstring of a class or a function."""
    documented = type(source) if isinstance(source, System) else source
    if documented.__module__.startswith("pydrake."):
        return ""
    return " ".join((inspect.getdoc(documented) or "").partition("\n\n")[0].split())
