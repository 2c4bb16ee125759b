"""The run of a scenario: what its task adds to the run of a System."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, Diagram, OutputPort, System

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.signals import Signals
from teleop_drake.loops.framework.surface import SurfacesIn
from teleop_drake.loops.framework.validation import CheckChoice, Refuse
from teleop_drake.loops.run.compiled_run import WhyNotSolved
from teleop_drake.loops.run.recording import Event
from teleop_drake.loops.run.run import FindComponents, Job, NormBound, Outcome
from teleop_drake.loops.run.system_run import EndWhereFinite, FieldsOf, NotesOn, RunJob
from teleop_drake.model.run.ending import EndAtBound
from teleop_drake.model.scenario import (
    AnyScenario,
    AsScenario,
    CheckSteps,
    ScenarioLike,
)
from teleop_drake.model.signals import NamedSignals
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks import Task, TaskOf

_NO_SURFACES = (
    "The environment reports no surfaces: the operator feels no contact, and events "
    "and metrics of puncture and contact are left out."
)


def SimulateScenario(
    scenario: ScenarioLike,
    *,
    duration: float | None,
    simulator: SimulatorConfig | None,
    teleoperator: Diagram | None,
    task: Task[Any] | None,
    progress: Callable[[float], None] | None,
    engine: str,
    signals: Signals | None,
) -> TaskRecording:
    """Simulates a scenario; see simulate(), which describes the arguments."""
    # Arguments that are given override the scenario.
    scenario = AsScenario(scenario)
    given: Record = {"duration": duration, "simulator": simulator}
    changes = {key: value for key, value in given.items() if value is not None}
    if changes:
        scenario = dataclasses.replace(scenario, **changes)
    task = task or TaskOf(scenario)
    scenario.Validate()
    if teleoperator is not None:
        _CheckTeleoperator(scenario, task, teleoperator)
    CheckSteps(scenario)
    diagram = teleoperator or task.MakeDiagram(scenario)
    job = JobOf(scenario, task, diagram, diagram.CreateDefaultContext(), progress)
    names = list(job.signals if signals is None else signals)
    for name in names:
        CheckChoice("signals", name, job.signals)
    run, notes = RunJob(job, engine)
    recording = Finish(scenario, task, job, run, notes)
    if signals is not None:
        recording.KeepSignals(names)
    return recording


def BoundOf(task: Task[Any], scenario: AnyScenario) -> NormBound:
    """Returns the bound of the tool's velocity in the runs of a scenario."""
    limit = task.MakeSpeedLimit(scenario)
    return NormBound("tool_velocity", limit.speed, limit.Reason)


def JobOf(
    scenario: AnyScenario,
    task: Task[Any],
    diagram: Diagram,
    context: Context,
    progress: Callable[[float], None] | None = None,
    signals: Mapping[str, OutputPort] | None = None,
) -> Job:
    """Returns the specification of a scenario's run.

    Args:
        signals: The signals to record, by name; None: those of the loop.
    """
    if signals is None:
        signals = NamedSignals(diagram.GetSystems())
    return Job(
        diagram=diagram,
        context=context,
        config=scenario.simulator,
        duration=scenario.duration,
        signals=signals,
        bound=BoundOf(task, scenario),
        progress=progress,
    )


def Finish(
    scenario: AnyScenario,
    task: Task[Any],
    job: Job,
    run: Outcome,
    notes: list[str],
) -> TaskRecording:
    """Cuts off a scenario's run where it leaves a bound, and makes its recording."""
    EndWhereFinite(run)
    EndAtBound(job.bound, run)
    recording = MakeRecording(scenario, job.config, run, notes, task.FindEvents)
    names = {"components": lambda _: FindComponents(job)}
    recording.FindLater(names)
    return recording


def _CheckTeleoperator(
    scenario: AnyScenario, task: Task[Any], diagram: Diagram
) -> None:
    """Refuses a diagram that was made for another task, or for another robot."""
    for name in task.systems:
        if not diagram.HasSubsystemNamed(name):
            allowed = f"made for {scenario.name}, with a system named {name}"
            Refuse("teleoperator", diagram.get_name(), allowed)
    size = diagram.GetSubsystemByName("robot").GetOutputPort("tool_position").size()
    if size != scenario.num_axes:
        allowed = f"{scenario.num_axes}, that of {scenario.name}"
        Refuse("teleoperator.robot.num_axes", size, allowed)


def HasConstantCommand(systems: Mapping[str, System]) -> bool:
    """Returns whether the operator, if there is one, reports a constant command."""
    operators = [x for x in systems.values() if x.get_name() == "surgeon"]
    return all(getattr(x, "has_constant_command", False) for x in operators)


def MakeRecording(
    scenario: AnyScenario,
    config: SimulatorConfig,
    run: Outcome,
    notes: list[str],
    find_events: Callable[[TaskRecording], list[Event]] = lambda recording: [],
) -> TaskRecording:
    """Makes the recording of a run; events and notes are computed on first use.

    Args:
        notes: Notes that are known already.
        find_events: A function that returns the events of a recording.
    """
    surfaces = SurfacesIn(run.systems)
    known = [_NO_SURFACES] if surfaces is None else []
    recording = TaskRecording(
        **FieldsOf(config, run),
        scenario=scenario,
        events=[],
        surfaces=surfaces or (),
        has_constant_command=HasConstantCommand(run.systems),
    )
    later: dict[str, Callable[[Any], Any]] = {
        "events": find_events,
        "notes": lambda _: known + NotesOn(run, notes),
    }
    recording.FindLater(later)
    return recording


def WhyNotCompiled(scenario: AnyScenario) -> str:
    """Returns why a scenario cannot be compiled; empty if it can.

    This check does not compile the scenario.
    """
    why = WhyNotSolved(scenario.simulator)
    if why:
        return why
    try:
        diagram = TaskOf(scenario).MakeDiagram(scenario)
        Evaluator(diagram, diagram.CreateDefaultContext())
    except UnsupportedSystem as error:
        return str(error)
    return ""
