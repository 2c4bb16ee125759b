"""Runs a scenario and records it."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, cast

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Diagram, System

from teleop_drake.environments import Surface, SurfacesOf
from teleop_drake.machine_code.compiled import Interpreted
from teleop_drake.numerics.step_polynomials import finite_part
from teleop_drake.recording import Recording, SolverStatistics
from teleop_drake.scenario import AnyScenario, AsScenario, CheckSteps, ScenarioLike
from teleop_drake.scenario.config import DefaultSimulator
from teleop_drake.signals import SignalsOf
from teleop_drake.simulation.drake_run import RunInDrake
from teleop_drake.simulation.ending import EndAtBound
from teleop_drake.simulation.run import Job, Outcome
from teleop_drake.simulation.stepping import NotesOnSamples, SystemsIn
from teleop_drake.simulation.structure import Loop, Structure
from teleop_drake.tasks import SpeedLimit, Task, TaskOf
from teleop_drake.validation import CheckChoice, CheckNumber, Refuse

ENGINES = ("drake", "compiled", "auto")

_NO_SURFACES = (
    "The environment tells no surfaces: the operator feels no contact, and events and "
    "metrics of puncture and contact are left out."
)


def MakeDiagram(scenario: ScenarioLike) -> Diagram:
    """Makes what a scenario describes: a teleoperator or the tracking of chapter 3.

    Args:
        scenario: What to make, or its name or file.

    Raises:
        ScenarioError: If the scenario is not valid.
    """
    scenario = AsScenario(scenario)
    return TaskOf(scenario).MakeDiagram(scenario)


def simulate(
    scenario: ScenarioLike | Diagram,
    *,
    duration: float | None = None,
    simulator: SimulatorConfig | None = None,
    teleoperator: Diagram | None = None,
    task: Task[Any] | None = None,
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
) -> Recording:
    """Simulates a scenario, or a Diagram, from its start and records its signals.

    Of a Diagram of one's own, with the defaults of its blocks, these are the vector
    outputs that it exports; if it exports none, those of its systems as `system.port`.
    Its recording has no scenario, and therefore no events and no metrics.

        recording = simulate(diagram, duration=10.0)

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

    What is due at the end of a run does not happen, in either engine: a packet, a
    sample, an echo of a jump, or an event whose time is `duration`, except for rounding
    (1e-12 s, or 2e-15 of the duration if that is more).

    A run ends early, as a recording that says why, if the tool's speed exceeds
    divergence_speed_ratio times the commanded speed (divergence_speed, for a
    TrackingScenario), if a joint leaves its range, if the solver finds no step that is
    short enough, if numbers leave the finite (under error control: however short the
    step is), or with the step at Ctrl-C (at once at a second one). Any other error of a
    block comes out as it is, with a note that names the block.

    Args:
        scenario: What to simulate, or its name or file; or a Diagram.
        duration: How long, s; None: as the scenario says.
        simulator: The solver; None: the scenario's, for a Diagram DefaultSimulator().
        teleoperator: The Diagram to simulate, made by MakeTeleoperator for this
            scenario with systems of your own; None makes the scenario's.
        task: What it is run for: makes the diagram, limits the speed, and finds the
            events; None: the task of the scenario.
        progress: Called now and then with the simulated time in s.
        engine: What runs it: `drake`, or `compiled`, machine code, which is compiled
            once for each structure of a diagram and then runs many times as fast;
            `auto`: machine code where possible. What cannot be compiled is run by
            Drake, and a note in the recording says why.

    Returns:
        The recording.

    Raises:
        ScenarioError: If the scenario is not valid, or takes too many steps.
        KernelDisagrees: If the machine code does not compute what the diagram does.
        ValueError: If the teleoperator is not one for this scenario, or what it
            puts out is not finite at the start, or there is no such engine.
    """
    CheckChoice("engine", engine, ENGINES)
    if isinstance(scenario, System):
        _CheckDiagram(scenario, duration, teleoperator or task)
        assert isinstance(scenario, Diagram) and duration is not None
        config = simulator or DefaultSimulator()
        job = Job(scenario, config, duration, _Finite(), progress)
        run, notes = _Run(job, engine)
        return MakeRecording(None, job.diagram, config, run, notes)
    scenario = AsScenario(scenario)
    given = {"duration": duration, "simulator": simulator}
    changes = {key: value for key, value in given.items() if value is not None}
    if changes:
        scenario = dataclasses.replace(scenario, **changes)  # type: ignore[arg-type]
    task = task or TaskOf(scenario)
    scenario.Validate()
    structure = loop = None
    if teleoperator is not None:
        _CheckTeleoperator(scenario, task, teleoperator)
    elif engine != "drake":
        structure = Structure(scenario, task)
        loop = structure.Find()
    diagram = loop.diagram if loop else teleoperator or task.MakeDiagram(scenario)
    CheckSteps(scenario)

    speed_limit = task.MakeSpeedLimit(scenario)
    config, duration = scenario.simulator, scenario.duration
    job = Job(diagram, config, duration, speed_limit, progress)
    run, notes = _Run(job, engine, structure, loop)
    EndAtBound(diagram, speed_limit, run)
    recording = MakeRecording(scenario, diagram, config, run, notes, loop)
    recording.events = task.FindEvents(recording)
    return recording


class _Finite(SpeedLimit):
    """No limit: a run ends only where numbers leave the finite."""

    def __init__(self) -> None:
        SpeedLimit.__init__(self, speed=math.inf, name="")

    def Reason(self, speed: float) -> str:
        return "a signal is not finite"


def _CheckDiagram(system: System, duration: float | None, other: object) -> None:
    """Refuses what cannot be run by itself, or is of a scenario."""
    name = system.get_name() or type(system).__name__
    if not isinstance(system, Diagram):
        Refuse("diagram", name, "a Diagram, which a DiagramBuilder makes of systems")
    if other is not None:
        Refuse("teleoperator, task", other, "left out where a Diagram is simulated")
    CheckNumber("duration", duration, "s", above=0)
    if system.num_input_ports() > 0:
        port = system.get_input_port(0).get_name()
        Refuse(f"input of {name}", port, "connected to a source inside of the Diagram")
    SignalsOf(system)


def _Run(
    job: Job,
    engine: str,
    structure: Structure | None = None,
    loop: Loop | None = None,
) -> tuple[Outcome, list[str]]:
    """Runs a diagram, and says why it was not compiled if it should have been."""
    run, notes = None, []
    if engine != "drake":
        from teleop_drake.simulation.compiled_run import CannotCompile, RunCompiled

        try:
            with Interpreted():  # There are too few calls to pay compiling.
                run = RunCompiled(job, structure, loop)
        except CannotCompile as error:
            assert loop is None, "the diagram of a loop has other blocks"
            notes = [f"Run in Drake's Simulator: {error}."]
    if run is None:
        run = RunInDrake(job)
        notes += NotesOnSamples(job.diagram, job.diagram.CreateDefaultContext())
    if run.termination == "diverged":
        run.series = finite_part(run.series)
        if len(run.series[0]) == 0:
            raise ValueError(f"the run has no start: {run.reason}")
    return run, notes


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


def MakeRecording(
    scenario: AnyScenario | None,
    diagram: Diagram,
    config: SimulatorConfig,
    run: Outcome,
    notes: list[str],
    loop: Loop | None = None,
) -> Recording:
    """Makes the recording of a run, without its events."""
    systems = list(SystemsIn(diagram))
    surfaces: tuple[Surface, ...] | None = ()
    if loop is not None:
        systems = [block.system for block in loop.evaluator.blocks]
        surfaces = SurfacesOf(loop.parts["environment"])
    elif scenario is not None and diagram.HasSubsystemNamed("environment"):
        surfaces = SurfacesOf(diagram.GetSubsystemByName("environment"))
    return Recording(
        scenario=cast(AnyScenario, scenario),
        time=run.series[0],
        signals=run.series[1],
        steps=run.series[2],
        events=[],
        surfaces=surfaces or (),
        solver=SolverStatistics(
            engine=run.engine,
            scheme=config.integration_scheme,
            accuracy=config.accuracy,
            steps=run.steps,
            derivative_evaluations=run.derivative_evaluations,
            wall_time_s=run.wall_time,
            real_time_factor=float(run.series[0][-1]) / run.wall_time,
        ),
        channels=run.channels,
        termination=run.termination,
        reason=run.reason,
        notes=[
            *([_NO_SURFACES] if surfaces is None else []),
            *(
                note
                for system in systems
                if hasattr(system, "RunNotes")
                for note in system.RunNotes(*run.series[:2])
            ),
            *notes,
        ],
        has_constant_command=scenario is None or HasConstantCommand(diagram),
    )


def HasConstantCommand(diagram: Diagram) -> bool:
    """Returns whether the operator in a diagram, if there is one, tells so."""
    operators = [x for x in SystemsIn(diagram) if x.get_name() == "surgeon"]
    return all(getattr(x, "has_constant_command", False) for x in operators)
