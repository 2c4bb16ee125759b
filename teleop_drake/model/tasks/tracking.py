"""Tracking: the demonstration of chapter 3, in which an arm learns a disturbance."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import Adder, ConstantVectorSource, Sine

from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.loops.framework.validation import GainMatrix
from teleop_drake.loops.framework.wiring import Wire
from teleop_drake.loops.numerics.pieces import Pieces
from teleop_drake.loops.run.recording import Event
from teleop_drake.model.blocks.robots import PlantRobotConfig
from teleop_drake.model.blocks.systems.disturbance_force import DisturbanceForce
from teleop_drake.model.blocks.systems.network_tracking_controller import (
    NetworkTrackingController,
)
from teleop_drake.model.laws.signal_metrics import extremes, rms
from teleop_drake.model.laws.tracking import TrackingGains
from teleop_drake.model.scenario import TrackingScenario, TrajectoryConfig
from teleop_drake.model.signals import NamedSignals
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks.base import Divergence, SpeedLimit, Task
from teleop_drake.model.tasks.panels import AxisName, SignalRow
from teleop_drake.model.tasks.sentences import Sentence, TrackingInWords


class TrackingRun:
    """The signals of a tracking run in pieces (p, 5, n); see numerics.pieces.

    Attributes:
        pieces: The pieces of time in which the signals are polynomials.
        error: The tracking error r - r_d, m.
        disturbance_error: The error W Phi - F_e of the estimated disturbance, N.
    """

    def __init__(self, recording: TaskRecording):
        self.pieces = Pieces(recording.time, recording.steps)
        signal = self.pieces.signal
        desired = signal(recording["desired_position"])
        self.error = signal(recording["tool_position"]) - desired
        force = signal(recording["environment_force"])
        self.disturbance_error = signal(recording["disturbance_estimate"]) - force


def MaxError(run: TrackingRun) -> Array:
    """Returns the max of |r - r_d| per axis, m."""
    return np.abs(extremes(run.error)).max(axis=(0, 1))


def RmsError(run: TrackingRun) -> Array:
    """Returns the rms over the run of r - r_d per axis, m."""
    return rms(run.error, run.pieces.length)


def DisturbanceRmsError(run: TrackingRun) -> Array:
    """Returns the rms over the run of W Phi - F_e per axis, N.

    W Phi - F_e is the part of the disturbance that the network has not learned.
    """
    return rms(run.disturbance_error, run.pieces.length)


METRICS = {
    "max_error": (MaxError, "m"),
    "rms_error": (RmsError, "m"),
    "disturbance_rms_error": (DisturbanceRmsError, "N"),
}
"""Metrics of a tracking, each with a value for each task axis: function and unit."""

UNITS = {f"{name}.*": unit for name, (_, unit) in METRICS.items()}
"""Scalar metrics of a tracking and their units; * stands for each task axis."""


class Tracking(Task[TrackingScenario]):
    """The task in which an arm follows a trajectory and learns a disturbance."""

    is_compared = False
    systems = ("robot", "reference")
    units = UNITS
    page_metrics: ClassVar[str] = "tracking"

    def MakeDiagram(self, scenario: TrackingScenario) -> Diagram:
        """Makes the tracking of chapter 3.

        Raises:
            ScenarioError: If the scenario is not valid.
        """
        return MakeNetworkTracking(scenario)

    def MakeSpeedLimit(self, scenario: TrackingScenario) -> SpeedLimit:
        """Returns the scenario's `divergence_speed`, which ends a run as diverged."""
        speed = scenario.divergence_speed
        return SpeedLimit(speed=speed, name=f"{speed:g} m/s")

    def FindEvents(self, recording: TaskRecording) -> list[Event]:
        """Returns no events: there is neither a surface nor an operator."""
        return []

    def Metrics(self, recording: TaskRecording) -> Record:
        """Returns the metrics of a tracking: METRICS, each per task axis.

        Args:
            recording: A run, all of its numbers finite.
        """
        run = TrackingRun(recording)
        return {name: f(run).tolist() for name, (f, _) in METRICS.items()}

    def Outcome(self, recording: TaskRecording, metrics: Record) -> str:
        """Returns what a run did: how far the arm was from its path."""
        return Sentence(recording, TrackingInWords(recording, metrics))

    def Particulars(self, recording: TaskRecording) -> Record:
        """Returns diverged, and diverged_at in s or None."""
        return Divergence(recording)

    def Panels(self, recordings: Sequence[TaskRecording]) -> list[SignalRow]:
        """Returns the position, the tracking error and the disturbance along each axis.

        The desired position is drawn beside the position, and the estimated disturbance
        beside the disturbance.
        """
        axes = range(recordings[0]["tool_position"].shape[1])
        rows = (
            ("position", "m", "tool_position", "desired_position", ""),
            ("error", "m", "tool_position", "", "desired_position"),
            ("disturbance", "N", "environment_force", "disturbance_estimate", ""),
        )
        return [
            SignalRow(
                label=f"{label} ${AxisName(k)}$",
                unit=unit,
                signal=signal,
                components=[k],
                beside=beside,
                reference=reference,
            )
            for label, unit, signal, beside, reference in rows
            for k in axes
        ]


def MakeReference(config: TrajectoryConfig) -> Diagram:
    """Makes the source of r_d(t), a Diagram named `reference`.

        r_d(t) = centre + amplitude sin(frequency t + phase)                    (3.28)

    | port | name                 | size | unit  |
    |------|----------------------|------|-------|
    | out  | desired_position     | n    | m     |
    | out  | desired_velocity     | n    | m/s   |
    | out  | desired_acceleration | n    | m/s^2 |

    Args:
        config: The trajectory.
    """
    n = len(config.centre)
    sine = Sine(config.amplitude, [config.frequency] * n, [config.phase] * n, True)
    return Wire(
        Diagram(),
        "reference",
        {
            "centre": ConstantVectorSource(config.centre),
            "sine": sine,
            "position": Adder(2, n),
        },
        inputs={},
        connections={"position.u0": "centre", "position.u1": "sine.y0"},
        outputs={
            "desired_position": "position",
            "desired_velocity": "sine.y1",
            "desired_acceleration": "sine.y2",
        },
    )


def MakeNetworkTracking(scenario: TrackingScenario) -> Diagram:
    """Makes the Diagram of the tracking of chapter 3, which has four systems.

        reference -> controller -> robot <-> disturbance
                         ^           |
                         +-----------+

    The controller does not measure the disturbance, but learns it from the motion.

    Returns:
        The Diagram, named `network_tracking`. A run starts from its default Context.

    Raises:
        ScenarioError: If the scenario is not valid.
    """
    scenario.Validate()
    n = scenario.num_axes
    config = scenario.robot
    law = scenario.controller
    assert isinstance(config, PlantRobotConfig)  # Validated.
    disturbance = scenario.disturbance
    systems: dict[str, System] = {
        "reference": MakeReference(scenario.trajectory),
        "controller": NetworkTrackingController(
            gains=TrackingGains(
                Lambda=GainMatrix(law.Lambda, n),
                G1=GainMatrix(law.G1, n),
                beta=law.adaptation_rate,
                nu=law.leakage,
            ),
            network=law.network.MakeNetwork(),
            plant=config.LoadPlant(scenario.gravity),
        ),
        "robot": config.MakeRobot(gravity=scenario.gravity),
        "disturbance": DisturbanceForce(
            kind=disturbance.kind, gain=GainMatrix(disturbance.gain, n)
        ),
    }
    for name, system in systems.items():
        system.set_name(name)
    # This call raises an error if a port has the name of another signal of the loop.
    NamedSignals(systems.values())
    return Wire(
        Diagram(),
        "network_tracking",
        systems,
        inputs={},
        connections={
            "controller.desired_position": "reference.desired_position",
            "controller.desired_velocity": "reference.desired_velocity",
            "controller.desired_acceleration": "reference.desired_acceleration",
            "controller.tool_position": "robot.tool_position",
            "controller.tool_velocity": "robot.tool_velocity",
            "controller.joint_position": "robot.joint_position",
            "controller.joint_velocity": "robot.joint_velocity",
            "robot.control_force": "controller.control_force",
            "disturbance.tool_position": "robot.tool_position",
            "disturbance.tool_velocity": "robot.tool_velocity",
            "robot.environment_force": "disturbance.environment_force",
        },
        outputs={},
    )
