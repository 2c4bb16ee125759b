"""Simulates scenarios and Systems, and makes their recordings."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any, cast

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, Diagram, OutputPort, System

from teleop_drake.blocks.channels.network import NetworkDelay
from teleop_drake.blocks.channels.packet_statistics import PacketStatistics
from teleop_drake.blocks.environments import Surface, SurfacesOf
from teleop_drake.engine.flatten import UnreadableLeaf
from teleop_drake.numerics.step_polynomials import finite_part
from teleop_drake.parameters import CheckNumbers
from teleop_drake.recording import Event, Recording, SolverStatistics
from teleop_drake.scenario import AnyScenario, AsScenario, CheckSteps, ScenarioLike
from teleop_drake.scenario.config import DefaultSimulator
from teleop_drake.signals import NamedSignals, SelectSignals, Signals
from teleop_drake.simulation.bends import Kinked, NotesOnBends
from teleop_drake.simulation.drake_run import RunInDrake
from teleop_drake.simulation.ending import EndAtBound
from teleop_drake.simulation.inputs import CheckContext, CheckInputs
from teleop_drake.simulation.run import Job, NormBound, Outcome
from teleop_drake.simulation.sample_ties import NotesOnTies
from teleop_drake.simulation.stepping import NotesOnSamples
from teleop_drake.tasks import Task, TaskOf
from teleop_drake.validation import CheckChoice, CheckNumber, Refuse, RefuseGiven

ENGINES = ("drake", "compiled", "auto")

_NO_SURFACES = (
    "The environment reports no surfaces: the operator feels no contact, and events "
    "and metrics of puncture and contact are left out."
)

_NO_FINAL_CONTEXT = (
    "A block with a kernel of its own has delays, whose signals under way no Context "
    "stores: the run has no final_context."
)


def MakeDiagram(scenario: ScenarioLike) -> Diagram:
    """Makes the Diagram of a scenario: a teleoperator or the tracking of chapter 3.

    Args:
        scenario: The scenario, or its name or file.

    Raises:
        ScenarioError: If the scenario is not valid.
    """
    scenario = AsScenario(scenario)
    return TaskOf(scenario).MakeDiagram(scenario)


def simulate(
    scenario: ScenarioLike | System,
    *,
    duration: float | None = None,
    context: Context | None = None,
    simulator: SimulatorConfig | None = None,
    teleoperator: Diagram | None = None,
    task: Task[Any] | None = None,
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
    signals: Signals | None = None,
    suppress_initialization_events: bool = False,
) -> Recording:
    """Simulates a scenario, or any System of Drake's, and records its signals.

    The run of a System begins with the time, the states, the numeric parameters and the
    fixed inputs of its Context. The recorded signals are its vector outputs or, for a
    Diagram that exports none, all vector outputs of its systems, named `system.port`.
    The recording has no scenario, and therefore no events and no metrics. A further run
    can begin at its `final_context`.

        context = diagram.CreateDefaultContext()
        context.SetContinuousState([0.1, 0.0])
        first = simulate(diagram, context=context, duration=10.0)
        second = simulate(
            diagram,
            context=first.final_context,
            duration=10.0,
            suppress_initialization_events=True,
        )

    Initialization events are executed at the start, as in Drake's Simulator. A run that
    continues another one suppresses them.

    The signals of a scenario, with n task axes and four rows for each step of the
    integrator:

    | name                                          | size | unit            |
    |-----------------------------------------------|------|-----------------|
    | tool_position, tool_velocity, tool_acceleration | n    | m, m/s, m/s^2   |
    | joint_position, joint_velocity, joint_torque  | nq, nv, nv | of the joints |
    | environment_force, control_force              | n    | N               |
    | environment_layer                             | 1    | index           |
    | forward_packet_sent, forward_packet_received  | m_f  | of the architecture |
    | return_packet_sent, return_packet_received    | m_r  | of the architecture |
    | surgeon_mode                                  | 1    | see ModalOperator     |
    | and the telemetry of the control law, for instance psi and weights_1 |||

    In the thesis's architectures the packets are [F_h; v_d] and [p_WT; v_WT], 2n each.
    All others have these signals as well, and the telemetry of both sides:

    | name                                          | size | unit            |
    |-----------------------------------------------|------|-----------------|
    | velocity_command, force_command               | n    | m/s, N          |
    | felt_position, felt_velocity                  | n    | m, m/s          |

    A TrackingScenario has neither packets nor layers nor an operator, but
    desired_position, desired_velocity, desired_acceleration and disturbance_estimate
    (n each).

    Events at the end of a run do not happen, in either engine: a packet, a sample, an
    echo of a jump, or an event whose time is `duration` up to rounding (1e-12 s, or
    2e-15 of the duration if that is more).

    A run ends early, and its recording has the reason, if

    * the tool's speed exceeds divergence_speed_ratio times the commanded speed
      (divergence_speed, for a TrackingScenario),
    * a joint leaves its range, or the tool is turned too far,
    * the solver finds no step that is short enough,
    * numbers are no longer finite (under error control: however short the step is), or
    * Ctrl-C is pressed: the run ends with the step, or at once after a second Ctrl-C.

    Any other error of a block is raised unchanged, with a note that names the block.

    Args:
        scenario: The scenario, or its name or file; or a System.
        duration: The duration, s; None: the scenario's. A System needs a duration.
        context: The Context where the run of a System begins, which is not changed;
            None: the default Context at the solver's start_time.
        simulator: The solver; None: the scenario's, for a System DefaultSimulator().
        teleoperator: The Diagram to simulate, made by MakeTeleoperator for this
            scenario with a user's systems; None: the scenario's Diagram.
        task: The task, which makes the diagram, limits the speed and finds the events;
            None: the task of the scenario.
        progress: A function that is called from time to time with the simulated time
            in s.
        engine: `drake` for Drake's Simulator; `compiled` or `auto` for machine code,
            which is many times as fast and is compiled once for each structure of a
            diagram. A diagram that cannot be compiled runs in Drake's Simulator, and a
            note in the recording gives the reason. For machine code, laws are traced at
            the start: values that they read from outside their arguments are fixed
            then. For many runs, see Compile().
        signals: The names of the signals to record, for a System also
            `path/system.port` of a vector output at any depth, or output ports by names
            of your own; None: all, as above. Metrics of a scenario need the signals
            from which they are computed.
        suppress_initialization_events: Whether the run of a System begins without
            initialization events, because it continues an earlier run.

    Returns:
        The recording.

    Raises:
        ScenarioError: If the scenario is not valid, or takes too many steps.
        KernelDisagrees: If the machine code does not compute what the diagram does.
        ValueError: If the teleoperator is not made for this scenario, if a signal is
            not finite at the start, or if there is no such engine.
    """
    CheckChoice("engine", engine, ENGINES)
    if isinstance(scenario, System):
        allowed = "left out where a System is simulated"
        RefuseGiven(allowed, teleoperator=teleoperator, task=task)
        job = MakeJob(
            scenario,
            context,
            duration,
            simulator,
            progress,
            signals,
            suppress_initialization_events=suppress_initialization_events,
        )
        CheckInputs(job.diagram, job.context)
        run, notes = _Run(job, engine)
        return RecordingOf(job, run, notes)
    RefuseGiven(
        "left out where a scenario is simulated",
        context=context,
        suppress_initialization_events=suppress_initialization_events,
    )
    # Arguments that are given override the scenario.
    scenario = AsScenario(scenario)
    given: dict[str, Any] = {"duration": duration, "simulator": simulator}
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
    run, notes = _Run(job, engine)
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
) -> Recording:
    """Cuts off a scenario's run where it leaves a bound, and makes its recording."""
    _EndWhereFinite(run)
    EndAtBound(job.bound, run)
    return MakeRecording(scenario, job.config, run, notes, task.FindEvents)


def MakeJob(
    system: System,
    context: Context | None,
    duration: float | None,
    simulator: SimulatorConfig | None,
    progress: Callable[[float], None] | None = None,
    signals: Signals | None = None,
    *,
    suppress_initialization_events: bool = False,
) -> Job:
    """Returns the specification of a System's run; None stands for a default.

    Raises:
        ScenarioError: If there is no duration, if the Context is that of another
            System, or if it has a number that is not allowed.
    """
    CheckNumber("duration", duration, "s", above=0)
    assert duration is not None
    config = simulator or DefaultSimulator()
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
        progress=progress,
        suppress_initialization_events=suppress_initialization_events,
    )


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
    _EndWhereFinite(run)
    start = job.config.start_time
    if start not in (0.0, job.start):
        notes.append(
            f"simulator.start_time = {start:g} has no effect: the run begins at the "
            f"time of its Context, {job.start:g} s."
        )
    if run.engine == "compiled":
        notes += NotesOnBends(Kinked(run.series))
    make_final = run.make_final_context
    if make_final is None:
        notes.append(no_final_context)
    recording = MakeRecording(None, job.config, run, notes)
    if make_final is not None:
        recording.FindLater({"final_context": lambda _: make_final()})
    return recording


def _Run(job: Job, engine: str) -> tuple[Outcome, list[str]]:
    """Runs a diagram; returns its outcome and notes, such as why Drake ran it."""
    notes: list[str] = []
    if engine != "drake":
        from teleop_drake.engine.check import ReadingDisagrees
        from teleop_drake.simulation.compiled_run import CannotCompile, CompileDiagram

        try:
            compiled = CompileDiagram(
                job.diagram,
                job.config,
                job.signals,
                job.context,
                suppress_initialization_events=job.suppress_initialization_events,
            )
            return compiled.Run(job), NotesOnBlocks(compiled.evaluator)
        except (CannotCompile, ReadingDisagrees) as error:
            notes = [NoteOnDrake(error)]
    run = RunInDrake(job)
    notes += NotesOnSamples(job.diagram, job.context)
    notes += NotesOnTies(job.diagram, job.start, job.end)
    return run, [*notes, *run.notes]


def NotesOnBlocks(evaluator: Any) -> list[str]:
    """Returns notes on the blocks that a compiled run has left out or read.

    Args:
        evaluator: The engine.evaluator.Evaluator of the run.
    """
    from teleop_drake.simulation.logs import LogsIn

    notes = []
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


def _EndWhereFinite(run: Outcome) -> None:
    """Cuts off a diverged run, in place, at the last step with finite signals."""
    if run.ending.termination != "diverged":
        return
    run.series = finite_part(run.series)
    if len(run.series[0]) == 0:
        raise ValueError(f"the run has no start: {run.ending.reason}")


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


def SurfacesIn(systems: Mapping[str, System]) -> tuple[Surface, ...] | None:
    """Returns the surfaces of the environment; None if it does not report any.

    Args:
        systems: The systems of the diagram, by their paths.
    """
    if "environment" not in systems:
        return ()
    return SurfacesOf(systems["environment"])


def _Channels(systems: Iterable[System], end: float) -> dict[str, PacketStatistics]:
    """Returns the statistics of the packets of network channels until a time in s."""
    channels = {}
    for system in systems:
        channel = system
        # A channel with delays of fields is a diagram.
        if isinstance(system, Diagram) and system.HasSubsystemNamed("channel"):
            channel = system.GetSubsystemByName("channel")
        if isinstance(channel, NetworkDelay):
            context = channel.CreateDefaultContext()
            context.SetTime(end)
            channels[system.get_name()] = channel.Statistics(context)
    return channels


def MakeRecording(
    scenario: AnyScenario | None,
    config: SimulatorConfig,
    run: Outcome,
    notes: list[str],
    find_events: Callable[[Recording], list[Event]] = lambda recording: [],
) -> Recording:
    """Makes the recording of a run; events and notes are computed on first use.

    Args:
        notes: Notes that are known already.
        find_events: A function that returns the events of a recording.
    """
    surfaces = () if scenario is None else SurfacesIn(run.systems)
    # Blocks that may add notes on their part of the run.
    reporters = [x for x in run.systems.values() if hasattr(x, "RunNotes")]
    time, signals, steps = run.series

    def FindNotes(recording: Recording) -> list[str]:
        found = [_NO_SURFACES] if surfaces is None else []
        for reporter in reporters:
            found += reporter.RunNotes(time, signals)
        return found + notes

    recording = Recording(
        scenario=cast(AnyScenario, scenario),
        time=time,
        signals=signals,
        steps=steps,
        events=[],
        surfaces=surfaces or (),
        solver=SolverStatistics(
            engine=run.engine,
            scheme=config.integration_scheme,
            accuracy=config.accuracy,
            steps=run.steps,
            derivative_evaluations=run.derivative_evaluations,
            wall_time_s=run.wall_time,
            real_time_factor=float(time[-1] - time[0]) / run.wall_time,
        ),
        channels=_Channels(run.systems.values(), time[-1]),
        termination=run.ending.termination,
        reason=run.ending.reason,
        has_constant_command=scenario is None or HasConstantCommand(run.systems),
    )
    recording.FindLater({"events": find_events, "notes": FindNotes})
    return recording


def HasConstantCommand(systems: Mapping[str, System]) -> bool:
    """Returns whether the operator, if there is one, reports a constant command."""
    operators = [x for x in systems.values() if x.get_name() == "surgeon"]
    return all(getattr(x, "has_constant_command", False) for x in operators)
