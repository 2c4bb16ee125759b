"""Simulates scenarios and Systems, and makes their recordings."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, overload

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, Diagram, System

from teleop_drake.loops.framework.signals import Signals
from teleop_drake.loops.framework.validation import CheckChoice, RefuseGiven
from teleop_drake.loops.run import system_run
from teleop_drake.loops.run.recording import Recording

if TYPE_CHECKING:
    from teleop_drake.model.scenario import ScenarioLike
    from teleop_drake.model.task_recording import TaskRecording
    from teleop_drake.model.tasks import Task


def MakeDiagram(scenario: "ScenarioLike") -> Diagram:
    """Makes the Diagram of a scenario: a teleoperator or the tracking of chapter 3.

    Args:
        scenario: The scenario, or its name or file.

    Raises:
        ScenarioError: If the scenario is not valid.
    """
    from teleop_drake.model.scenario import AsScenario
    from teleop_drake.model.tasks import TaskOf

    scenario = AsScenario(scenario)
    return TaskOf(scenario).MakeDiagram(scenario)


@overload
def simulate(
    scenario: "ScenarioLike",
    *,
    duration: float | None = None,
    simulator: SimulatorConfig | None = None,
    teleoperator: Diagram | None = None,
    task: "Task[Any] | None" = None,
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
    signals: Signals | None = None,
) -> "TaskRecording": ...


@overload
def simulate(
    scenario: System,
    *,
    duration: float | None = None,
    context: Context | None = None,
    simulator: SimulatorConfig | None = None,
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
    signals: Signals | None = None,
    suppress_initialization_events: bool = False,
    publish_period: float | None = None,
) -> Recording: ...


def simulate(
    scenario: "ScenarioLike | System",
    *,
    duration: float | None = None,
    context: Context | None = None,
    simulator: SimulatorConfig | None = None,
    teleoperator: Diagram | None = None,
    task: "Task[Any] | None" = None,
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
    signals: Signals | None = None,
    suppress_initialization_events: bool = False,
    publish_period: float | None = None,
) -> Recording:
    """Simulates a scenario, or any System of Drake's, and records its signals.

    The run of a System begins with the time, the states, the numeric parameters and the
    fixed inputs of its Context. The recorded signals are its vector outputs or, for a
    Diagram that exports none, all vector outputs of its systems, named `system.port`.
    Its events are those that blocks locate, such as `wall.touches`. A further run can
    begin at the recording's `final_context`.

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
    | telemetry of the control law, for instance psi |      | see the law     |

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
        engine: `drake` for Drake's Simulator; `auto` for machine code, which is many
            times as fast and is compiled once for each structure of a diagram. A
            diagram that cannot be compiled runs in Drake's Simulator, and a note in the
            recording gives the reason; `compiled` refuses it. For machine code, laws
            are traced at the start: values that they read from outside their arguments
            are fixed then. For many runs, see Compile().
        signals: The names of the signals to record, for a System also
            `path/system.port` of a vector output at any depth, or output ports by names
            of your own; None: all, as above. Metrics of a scenario need the signals
            from which they are computed.
        suppress_initialization_events: Whether the run of a System begins without
            initialization events, because it continues an earlier run.
        publish_period: The time between the rows of a System's recording, s, between
            which signals are straight lines; None: several rows for each step. The
            steps and the events of the run are the same.

    Returns:
        The recording.

    Raises:
        ScenarioError: If the scenario is not valid, or takes too many steps, or if
            `compiled` cannot compile it.
        KernelDisagrees: If the machine code does not compute what the diagram does.
        ValueError: If the teleoperator is not made for this scenario, if a signal is
            not finite at the start, or if there is no such engine.
    """
    CheckChoice("engine", engine, system_run.ENGINES)
    if isinstance(scenario, System):
        allowed = "left out where a System is simulated"
        RefuseGiven(allowed, teleoperator=teleoperator, task=task)
        return system_run.simulate(
            scenario,
            duration=duration,
            context=context,
            simulator=simulator,
            progress=progress,
            engine=engine,
            signals=signals,
            suppress_initialization_events=suppress_initialization_events,
            publish_period=publish_period,
        )
    RefuseGiven(
        "left out where a scenario is simulated",
        context=context,
        suppress_initialization_events=suppress_initialization_events,
        publish_period=publish_period,
    )
    # A System needs nothing of scenarios, whose import takes a while.
    from teleop_drake.model.run.scenario_run import SimulateScenario

    return SimulateScenario(
        scenario,
        duration=duration,
        simulator=simulator,
        teleoperator=teleoperator,
        task=task,
        progress=progress,
        engine=engine,
        signals=signals,
    )
