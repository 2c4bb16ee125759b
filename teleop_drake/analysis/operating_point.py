"""Where on the tool's path the loop is linearised."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from teleop_drake.laws.layered_force import layer_index
from teleop_drake.recording import Recording
from teleop_drake.robots import FactsOfRobot
from teleop_drake.scenario import Scenario
from teleop_drake.validation import Refuse, ScenarioError

Array = NDArray[np.float64]

EMPTY = "empty"
"""What the space in front of the first layer is called."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingPoint:
    """Where the diagram is linearised.

    Attributes:
        name: What it is called.
        layer: Name of the layer that it is in, or EMPTY.
        position: p_WT in m (n).
        velocity: v_WT in m/s (n).
        forward_packet: What the forward channel delivers; None: what keeps the velocity
            constant.
        estimates: State of an adaptive law, [F_c, W1, Psi, W3] as in
            AdaptiveBackstepping; None: its initial estimates.
    """

    name: str
    layer: str
    position: Array
    velocity: Array
    forward_packet: Array | None = None
    estimates: Array | None = None


def OperatingPoints(scenario: Scenario) -> list[OperatingPoint]:
    """Returns an operating point in each layer that the tool comes to.

    The path is the line on which the tool moves from its start with the commanded
    velocity, for the duration of the scenario, as far as the robot reaches and no
    farther than the contact surface. In each layer the point is halfway along. On the
    surface it is where the first impact is deepest: at rest, v_x sqrt(m/k) below, with
    the inertia m of the tool along x.

    Args:
        scenario: A valid one.
    """
    start = np.asarray(scenario.robot.start, dtype=float)
    velocity = np.asarray(scenario.surgeon.velocity, dtype=float)
    surface = scenario.contact_surface
    if velocity[0] <= 0:
        surface = None
    end_time = scenario.duration
    if surface is not None:
        end_time = min(end_time, (surface - start[0]) / velocity[0])
    end_time = _ReachableTime(scenario, start, velocity, end_time)
    borders = [0.0, end_time]
    if velocity[0] != 0:
        borders += [
            time
            for layer in scenario.environment.layers
            if 0 < (time := (layer.start - start[0]) / velocity[0]) < end_time
        ]
    times = sorted(borders)
    points = [
        _MakePoint(scenario, start + velocity * (begin + end) / 2, velocity)
        for begin, end in pairwise(times)
    ]
    if surface is not None and end_time == (surface - start[0]) / velocity[0]:
        position = start + velocity * end_time
        stiffness = max(layer.stiffness for layer in scenario.environment.layers)
        robot = replace(scenario.robot, start=position).MakeRobot()
        inertia = FactsOfRobot(robot).inertia
        if inertia is None:
            Refuse("robot", scenario.robot.kind, "a robot that tells its inertia")
        inverse_inertia = np.linalg.inv(inertia)[0, 0]
        position[0] += velocity[0] / math.sqrt(stiffness * inverse_inertia)
        points.append(_MakePoint(scenario, position, 0 * velocity))
    return points


def OperatingPointAt(scenario: Scenario, x: float) -> OperatingPoint:
    """Returns the operating point on the tool's path at a position along x.

    The tool moves there with the commanded velocity; behind the contact surface it is
    at rest.

    Args:
        scenario: A valid one.
        x: In m.

    Raises:
        ValueError: If the path does not lead there or the robot does not reach it.
    """
    start = np.asarray(scenario.robot.start, dtype=float)
    velocity = np.asarray(scenario.surgeon.velocity, dtype=float)
    if not math.isfinite(x) or (x != start[0] and not (x - start[0]) * velocity[0] > 0):
        raise ValueError(
            f"position = {x:g}: must be on the tool's path, which starts at x = "
            f"{start[0]:g} m with {velocity[0]:g} m/s"
        )
    position = start.copy()
    if x != start[0]:
        position = start + velocity * (x - start[0]) / velocity[0]
    try:
        scenario.robot.JointPositions(position)
    except ScenarioError as e:
        raise ValueError(f"position = {x:g}: {str(e).removeprefix('start: ')}") from e
    surface = scenario.contact_surface
    is_inside = surface is not None and x > surface
    return _MakePoint(scenario, position, 0 * velocity if is_inside else velocity)


def OperatingPointOfRun(recording: Recording, time: float) -> OperatingPoint:
    """Returns the operating point at an instant of a run, in whatever motion it is.

    With what the forward channel delivers then, and what an adaptive law has learned.

    Args:
        recording: A run of a teleoperation.
        time: In s; not the instant of a jump.

    Raises:
        ValueError: If the time is not within the run.
    """
    if not recording.time[0] <= time <= recording.time[-1]:
        raise ValueError(
            f"time = {time:g}: must be {recording.time[0]:g} to "
            f"{recording.time[-1]:g} s, the run's"
        )

    def At(*names: str) -> Array:
        return np.concatenate(
            [recording.Interpolate(name, np.array([time]))[0] for name in names]
        )

    estimates = ("control_force", "weights_1", "psi", "weights_3")
    is_adaptive = all(name in recording.signals for name in estimates)
    scenario = recording.teleoperation
    point = _MakePoint(scenario, At("tool_position"), At("tool_velocity"))
    return replace(
        point,
        forward_packet=At("forward_packet_received"),
        estimates=At(*estimates) if is_adaptive else None,
    )


def _MakePoint(scenario: Scenario, position: Array, velocity: Array) -> OperatingPoint:
    layers = scenario.environment.layers
    index = layer_index([layer.start for layer in layers], position[0])
    name = layers[index].name if index >= 0 else EMPTY
    return OperatingPoint(name=name, layer=name, position=position, velocity=velocity)


def _ReachableTime(
    scenario: Scenario, start: Array, velocity: Array, end_time: float
) -> float:
    """Returns until when, in s, the robot can follow the path."""

    def IsReachable(time: float) -> bool:
        try:
            scenario.robot.JointPositions(start + velocity * time)
        except ScenarioError:
            return False
        return True

    if IsReachable(end_time):
        return end_time
    low, high = 0.0, end_time
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if IsReachable(middle) else (low, middle)
    return low
