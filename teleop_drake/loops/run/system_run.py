"""The run of a System: its specification, its engine and its recording."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, System

from teleop_drake.loops.engine.flatten import NearLimit, UnreadableLeaf
from teleop_drake.loops.engine.parameters import CheckNumbers
from teleop_drake.loops.framework.signals import (
    CheckContext,
    CheckSystem,
    SelectSignals,
    Signals,
)
from teleop_drake.loops.framework.solver import CONFIG, DefaultSimulator
from teleop_drake.loops.framework.validation import CheckChoice, CheckKind, CheckNumber
from teleop_drake.loops.numerics.step_polynomials import finite_part, thinned
from teleop_drake.loops.run.inputs import CheckInputs
from teleop_drake.loops.run.recording import Recording, SolverStatistics
from teleop_drake.loops.run.run import FindComponents, Job, Outcome

if TYPE_CHECKING:
    from teleop_drake.loops.delays.packet_statistics import PacketStatistics

ENGINES = ("drake", "compiled", "auto")

_NO_FINAL_CONTEXT = (
    "A block with a kernel of its own has delays, whose signals under way no Context "
    "stores: the run has no final_context."
)


def simulate(
    system: System,
    *,
    duration: float | None,
    context: Context | None = None,
    simulator: SimulatorConfig | None = None,
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
    signals: Signals | None = None,
    suppress_initialization_events: bool = False,
    publish_period: float | None = None,
) -> Recording:
    """Simulates any System of Drake's, with exact delays, and records its signals.

    The arguments, the recording and the errors are those of teleop_drake.simulate(),
    which takes scenarios as well.
    """
    CheckChoice("engine", engine, ENGINES)
    CheckSystem("system", system)
    job = MakeJob(
        system,
        context,
        duration,
        simulator,
        progress,
        signals,
        suppress_initialization_events=suppress_initialization_events,
        publish_period=publish_period,
    )
    compiled = None
    if engine != "drake":
        from teleop_drake.loops.run.kept_diagrams import KeptDiagram

        compiled = KeptDiagram(job)
    if compiled is None:
        CheckInputs(job.diagram, job.context)
        run, notes = RunJob(job, engine)
    else:
        run = compiled.Run(job)
        notes = NotesOnBlocks(compiled.evaluator)
    return RecordingOf(job, run, notes)


def MakeJob(
    system: System,
    context: Context | None,
    duration: float | None,
    simulator: SimulatorConfig | None,
    progress: Callable[[float], None] | None = None,
    signals: Signals | None = None,
    *,
    suppress_initialization_events: bool = False,
    publish_period: float | None = None,
) -> Job:
    """Returns the specification of a System's run; None stands for a default.

    Raises:
        ScenarioError: If there is no duration, if the Context is that of another
            System, or if it has a number that is not allowed.
    """
    CheckNumber("duration", duration, "s", above=0)
    CheckPeriod(publish_period)
    assert duration is not None
    config = simulator or DefaultSimulator()
    CheckKind("simulator", config, SimulatorConfig, CONFIG)
    if context is None:
        CheckNumber("simulator.start_time", config.start_time, "s")
        context = system.CreateDefaultContext()
        context.SetTime(config.start_time)
    CheckContext(system, context)
    CheckNumbers(system, context)
    return Job(
        diagram=system,
        context=context,
        config=config,
        duration=duration,
        signals=SelectSignals(system, signals),
        has_default_signals=signals is None,
        progress=progress,
        suppress_initialization_events=suppress_initialization_events,
        has_events=True,
        publish_period=publish_period,
    )


def CheckPeriod(publish_period: float | None) -> None:
    """Refuses a time between rows that is not positive."""
    if publish_period is not None:
        CheckNumber("publish_period", publish_period, "s", above=0)


def RunJob(job: Job, engine: str) -> tuple[Outcome, list[str]]:
    """Runs a diagram; returns its outcome and notes, such as why Drake ran it."""
    notes: list[str] = []
    if engine != "drake":
        from teleop_drake.loops.engine.check import ReadingDisagrees
        from teleop_drake.loops.run.compiled_run import CannotCompile, CompileDiagram
        from teleop_drake.loops.run.kept_diagrams import Keep

        try:
            compiled = CompileDiagram(
                job.diagram,
                job.config,
                job.signals,
                job.context,
                suppress_initialization_events=job.suppress_initialization_events,
                may_omit=job.has_default_signals,
                ignores_limits=True,
            )
            Keep(job, compiled)
            run = compiled.Run(job)
            return run, [*NotesOnBlocks(compiled.evaluator), *run.notes]
        except (CannotCompile, ReadingDisagrees, NearLimit) as error:
            if engine == "compiled":
                raise
            notes = [NoteOnDrake(error)]
    from teleop_drake.loops.run.drake_run import RunInDrake
    from teleop_drake.loops.run.sample_ties import NotesOnTies
    from teleop_drake.loops.run.stepping import NotesOnSamples

    run = RunInDrake(job)
    notes += NotesOnSamples(job.diagram, job.context)
    notes += NotesOnTies(job.diagram, job.start, job.end)
    return run, [*notes, *run.notes]


def NotesOnBlocks(evaluator: Any) -> list[str]:
    """Returns notes on the blocks that a compiled run has left out or read.

    Args:
        evaluator: The engine.evaluator.Evaluator of the run.
    """
    notes = []
    logs = []
    if evaluator.left_out:
        from teleop_drake.loops.run.logs import LogsIn

        logs = [block.path for block in LogsIn(evaluator)]
    others = [path for path in evaluator.left_out if path not in logs]
    if others:
        notes.append(
            f"{', '.join(others)}: left out of the compiled run: nothing depends on "
            'them. Nothing is drawn; engine="drake" executes them.'
        )
    if logs:
        notes.append(f"{', '.join(logs)}: filled in final_context only.")
    if evaluator.read:
        notes.append(
            f"{', '.join(evaluator.read)}: machine code of the Python code as it "
            "stands, compared with Drake."
        )
    return notes


def NoteOnDrake(error: Exception) -> str:
    """Returns the note on why a run is not a compiled one."""
    cause = error.__cause__
    if isinstance(cause, UnreadableLeaf):
        return f"{cause.name} runs in Drake: {cause.reason}."
    return f"Run in Drake's Simulator: {error}."


def EndWhereFinite(run: Outcome) -> None:
    """Cuts off a diverged run, in place, at the last step with finite signals."""
    if run.ending.termination != "diverged":
        return
    run.series = finite_part(run.series)
    if len(run.series[0]) == 0:
        raise ValueError(f"the run has no start: {run.ending.reason}")


def RecordingOf(
    job: Job,
    run: Outcome,
    notes: list[str],
    no_final_context: str = _NO_FINAL_CONTEXT,
) -> Recording:
    """Makes the recording of a System's run.

    Args:
        notes: Notes on the run; some may be appended.
        no_final_context: The note on a run without a final Context.
    """
    EndWhereFinite(run)
    start = job.config.start_time
    if start not in (0.0, job.start):
        notes.append(
            f"simulator.start_time = {start:g} has no effect: the run begins at the "
            f"time of its Context, {job.start:g} s."
        )
    make_final = run.make_final_context
    if make_final is None:
        notes.append(no_final_context)
    fields = FieldsOf(job.config, run)
    period = job.publish_period
    if period is not None:
        names = ("time", "signals", "steps")
        fields |= dict(zip(names, thinned(run.series, period), strict=True))
        notes.append(
            f"Rows every {period:g} s (publish_period): between them signals are "
            "straight lines."
        )
    recording = Recording(**fields, events=[])
    later: dict[str, Callable[[Recording], Any]] = {
        "events": lambda _: run.find_events(run),
        "notes": lambda _: NotesOn(run, notes),
        "components": lambda _: FindComponents(job),
    }
    if make_final is not None:
        later["final_context"] = lambda _: make_final()
    recording.FindLater(later)
    if period is not None:
        # Until they are found, they keep all rows.
        recording.KeepSignals(recording.signals)
    return recording


def FieldsOf(config: SimulatorConfig, run: Outcome) -> dict[str, Any]:
    """Returns the fields that recordings of all kinds have, without events and notes.

    Args:
        config: The solver.
        run: The outcome of the run.
    """
    time, signals, steps = run.series
    return {
        "time": time,
        "signals": signals,
        "steps": steps,
        "solver": SolverStatistics(
            engine=run.engine,
            scheme=config.integration_scheme,
            accuracy=config.accuracy,
            steps=run.steps,
            derivative_evaluations=run.derivative_evaluations,
            wall_time_s=run.wall_time,
            real_time_factor=float(time[-1] - time[0]) / run.wall_time,
        ),
        "channels": _Channels(run.systems, time[-1]),
        "termination": run.ending.termination,
        "reason": run.ending.reason,
    }


def NotesOn(run: Outcome, known: Sequence[str]) -> list[str]:
    """Returns the notes on a run: of its blocks, known ones, and on its bends."""
    from teleop_drake.loops.run.bends import NotesOnBends

    time, signals, _ = run.series
    notes: list[str] = []
    for system in run.systems.values():
        if hasattr(system, "RunNotes"):
            notes += system.RunNotes(time, signals)
    return [*notes, *known, *NotesOnBends(*run.find_bends(run))]


def _Channels(
    systems: Mapping[str, System], end: float
) -> "dict[str, PacketStatistics]":
    """Returns the statistics of the packets of network channels until a time in s."""
    channels = {}
    for path, system in systems.items():
        if hasattr(system, "Statistics"):
            context = system.CreateDefaultContext()
            context.SetTime(end)
            # A channel with delays of fields is a Diagram around its block.
            channels[path.removesuffix("/channel")] = system.Statistics(context)
    return channels
