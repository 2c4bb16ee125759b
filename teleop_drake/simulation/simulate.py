"""Runs a scenario and records it."""

import time as clock
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from teleop_drake.channels.network_delay import NetworkDelay
from teleop_drake.numerics.interpolation import (
    find_crossing,
    interpolate,
)
from teleop_drake.recording import Event, Recording, SolverStatistics
from teleop_drake.scenario import (
    AnyScenario,
    CheckSteps,
    Scenario,
    TrackingScenario,
)
from teleop_drake.simulation.failures import FirstLine, IsDivergence, NamingBlocks
from teleop_drake.simulation.run_monitor import RunMonitor
from teleop_drake.simulation.simulator import MakeSimulator
from teleop_drake.tasks.tracking import MakeNetworkTracking
from teleop_drake.teleoperator import MakeTeleoperator


def MakeDiagram(scenario: AnyScenario) -> Diagram:
    """Makes what a scenario describes: a teleoperator or the tracking of chapter 3.

    Raises:
        ScenarioError: If the scenario is not valid.
    """
    if isinstance(scenario, TrackingScenario):
        return MakeNetworkTracking(scenario)
    return MakeTeleoperator(scenario)


def simulate(
    scenario: AnyScenario,
    *,
    teleoperator: Diagram | None = None,
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """Simulates a scenario from its start and records all signals of the loop.

    The signals, with n task axes and one row for each step of the integrator:

    | name                                          | size | unit            |
    |-----------------------------------------------|------|-----------------|
    | tool_position, tool_velocity, tool_acceleration | n    | m, m/s, m/s^2   |
    | joint_position, joint_velocity, joint_torque  | nq, nv, nv | of the joints |
    | environment_force, control_force              | n    | N               |
    | environment_layer                             | 1    | index           |
    | forward_packet_sent, forward_packet_received  | m_f  | of the architecture |
    | return_packet_sent, return_packet_received    | m_r  | of the architecture |
    | surgeon_mode                                  | 1    | see Surgeon     |
    | and the telemetry of the control law, for instance psi and weights_1 |||

    In the thesis's architectures the packets are [F_h; v_d] and [p_WT; v_WT], 2n each.
    All others have these signals as well, and the telemetry of both sides:

    | name                                          | size | unit            |
    |-----------------------------------------------|------|-----------------|
    | velocity_command, force_command               | n    | m/s, N          |
    | felt_position, felt_velocity                  | n    | m, m/s          |

    A TrackingScenario has neither packets nor layers nor a surgeon, but
    desired_position, desired_velocity, desired_acceleration and disturbance_estimate
    (n each).

    A run ends early, as a recording that says why, if the tool's speed exceeds
    divergence_speed_ratio times the commanded speed (divergence_speed, for a
    TrackingScenario), if the solver finds no step that is short enough, if numbers
    leave the finite, or with the step at Ctrl-C (at once at a second one). Any other
    error of a block comes out as it is, with a note that names the block.

    Args:
        scenario: What to simulate.
        teleoperator: The Diagram to simulate, made by MakeTeleoperator for this
            scenario with systems of your own; None makes the scenario's.
        progress: Called now and then with the simulated time in s.

    Returns:
        The recording.

    Raises:
        ScenarioError: If the scenario is not valid, or would take too many steps.
        ValueError: If the teleoperator is not one for this scenario, or what it
            puts out is not finite at the start.
    """
    if teleoperator is None:
        diagram = MakeDiagram(scenario)  # Validates the scenario.
    else:
        scenario.Validate()
        diagram = teleoperator
        _CheckTeleoperator(scenario, diagram)
    CheckSteps(scenario)

    if isinstance(scenario, TrackingScenario):
        speed_limit = scenario.divergence_speed
        limit_name = f"{speed_limit:g} m/s"
    else:
        ratio = scenario.divergence_speed_ratio
        speed_limit = ratio * float(np.linalg.norm(scenario.surgeon.velocity))
        limit_name = f"{ratio:g} times the commanded speed"
    simulator = MakeSimulator(diagram, scenario.simulator)
    monitor = RunMonitor(
        diagram,
        simulator.get_mutable_context(),
        speed_limit=speed_limit,
        limit_name=limit_name,
        progress=progress,
    )
    run = _Simulate(diagram, simulator, scenario.duration, monitor)
    times, signals = run.monitor.recorder.Finish()
    if run.termination == "diverged":
        times, signals = _WithFiniteEnd(times, signals, run.reason)
    if run.monitor.failure:
        _EndAtSpeed(run.monitor.speed_limit, times, signals)
    return _MakeRecording(scenario, run, times, signals)


def _CheckTeleoperator(scenario: AnyScenario, diagram: Diagram) -> None:
    """Refuses a diagram that was made for another task, or for another robot."""
    is_tracking = isinstance(scenario, TrackingScenario)
    for name in ("robot", "reference" if is_tracking else "environment"):
        if not diagram.HasSubsystemNamed(name):
            raise ValueError(
                f"teleoperator: must be made for {scenario.name}, it has no {name}"
            )
    size = diagram.GetSubsystemByName("robot").GetOutputPort("tool_position").size()
    if size != scenario.num_axes:
        raise ValueError(
            f"teleoperator: must be made for {scenario.name}, its robot has {size} "
            f"task axes, not {scenario.num_axes}"
        )


@dataclass(kw_only=True)
class _Simulation:
    """What came out of a simulation.

    Attributes:
        diagram: What was simulated.
        monitor: What watched it.
        simulator: What simulated it.
        wall_time: Real time that it took, in s.
        termination: As in Recording, and so is the reason.
        reason: Why it did not complete.
    """

    diagram: Diagram
    monitor: RunMonitor
    simulator: Simulator
    wall_time: float
    termination: str
    reason: str


def _Simulate(
    diagram: Diagram, simulator: Simulator, duration: float, monitor: RunMonitor
) -> _Simulation:
    """Simulates a diagram under the eyes of a monitor."""
    simulator.set_monitor(monitor.Monitor)
    termination, reason = "completed", ""
    start = clock.monotonic()
    with monitor.InterruptAtSteps():
        with NamingBlocks():
            simulator.Initialize()
        try:
            with NamingBlocks():
                if not (monitor.failure or monitor.is_interrupted):
                    simulator.AdvanceTo(duration)
        except KeyboardInterrupt:
            monitor.is_interrupted = True
        except Exception as error:
            if not (
                monitor.is_interrupted or IsDivergence(error, simulator.get_context())
            ):
                raise
            termination, reason = "diverged", FirstLine(error)
    if monitor.is_interrupted:  # However it ended: more runs may be to come.
        termination, reason = "interrupted", "interrupted by the user"
    elif monitor.failure:
        termination, reason = "diverged", monitor.failure
    wall_time = clock.monotonic() - start
    # The samples know the Context, and pydrake keeps the Simulator alive with that.
    simulator.clear_monitor()
    return _Simulation(
        diagram=diagram,
        monitor=monitor,
        simulator=simulator,
        wall_time=wall_time,
        termination=termination,
        reason=reason,
    )


def _MakeRecording(
    scenario: AnyScenario,
    run: _Simulation,
    times: np.ndarray,
    signals: dict[str, np.ndarray],
) -> Recording:
    """Makes the recording of a run."""
    integrator = run.simulator.get_integrator()
    root_context = run.simulator.get_context()
    return Recording(
        scenario=scenario,
        time=times,
        signals=signals,
        events=(
            _FindEvents(scenario, times, signals)
            if isinstance(scenario, Scenario)
            else []
        ),
        solver=SolverStatistics(
            scheme=scenario.simulator.integration_scheme,
            accuracy=scenario.simulator.accuracy,
            steps=integrator.get_num_steps_taken(),
            derivative_evaluations=integrator.get_num_derivative_evaluations(),
            wall_time_s=run.wall_time,
            real_time_factor=float(times[-1]) / run.wall_time,
        ),
        channels={
            system.get_name(): system.Statistics(
                system.GetMyContextFromRoot(root_context)
            )
            for system in run.diagram.GetSystems()
            if isinstance(system, NetworkDelay)
        },
        termination=run.termination,
        reason=run.reason,
    )


def _WithFiniteEnd(
    times: np.ndarray, signals: dict[str, np.ndarray], reason: str
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Returns what was recorded, up to the last sample that is a number in all."""
    end = len(times)
    while end > 0 and not all(np.isfinite(x[end - 1]).all() for x in signals.values()):
        end -= 1
    if end == 0:
        raise ValueError(f"the run has no start: {reason}")
    return times[:end], {name: x[:end] for name, x in signals.items()}


def _EndAtSpeed(
    limit: float, times: np.ndarray, signals: dict[str, np.ndarray]
) -> None:
    """Moves the last sample, in place, to where the speed of the tool has its limit."""
    velocity = signals["tool_velocity"]
    if len(times) < 2 or not np.linalg.norm(velocity[-1]) > limit:
        return
    end = find_crossing(
        times,
        velocity,
        len(times) - 2,
        lambda v: float(np.linalg.norm(v)) >= limit,
    )
    last = {name: interpolate(times, x, np.array([end])) for name, x in signals.items()}
    times[-1] = end
    for name, value in last.items():
        signals[name][-1] = value[0]


def _FindEvents(
    scenario: Scenario, times: np.ndarray, signals: dict[str, np.ndarray]
) -> list[Event]:
    """Finds the instants at which the tool or the surgeon crosses a border."""
    events = []
    x = signals["tool_position"][:, 0]
    for position, names in (
        (scenario.puncture_position, ("puncture", "heal")),
        (scenario.contact_surface, ("contact", "release")),
    ):
        if position is None:
            continue
        for i in np.flatnonzero(np.diff(x >= position)):
            is_forward = bool(x[i + 1] >= position)

            def is_beyond(
                p: np.ndarray, border: float = position, forward: bool = is_forward
            ) -> bool:
                return bool(p[0] >= border) == forward

            time = find_crossing(times, x[:, np.newaxis], int(i), is_beyond)
            events.append(Event(name=names[0 if is_forward else 1], time=time))
    mode = signals["surgeon_mode"][:, 0]
    for i in np.flatnonzero(np.diff(mode)):
        name = "surgeon_force" if mode[i + 1] == 1 else "surgeon_stop"
        events.append(Event(name=name, time=float(times[i + 1])))
    return sorted(events, key=lambda event: event.time)
