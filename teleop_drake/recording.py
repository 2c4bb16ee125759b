"""What a simulation leaves behind: plain arrays, events and solver statistics."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from teleop_drake.channels.packet_statistics import PacketStatistics
from teleop_drake.environments import FindSurface, Surface
from teleop_drake.files import Replacing
from teleop_drake.numerics.interpolation import interpolate
from teleop_drake.scenario import (
    AnyScenario,
    AsTeleoperation,
    Scenario,
    ScenarioFromYaml,
    ScenarioToYaml,
)


@dataclass(kw_only=True)
class Event:
    """Something that happened at an instant.

    Attributes:
        name: `puncture` (the tool leaves the first layer that yields), `heal` (it is
            back in it), `contact` and `release` (it reaches and leaves the hard
            surface), `surgeon_force` and `surgeon_stop` (the surgeon's switches).
        time: When, in s.
    """

    name: str
    time: float


@dataclass(kw_only=True)
class SolverStatistics:
    """What the integrator did.

    Attributes:
        scheme: Integration scheme, by Drake's name.
        accuracy: Target accuracy of the error control.
        steps: Number of steps taken, those of the event location included.
        derivative_evaluations: Number of evaluations of the time derivatives.
        wall_time_s: Real time spent in s.
        real_time_factor: Simulated time over real time.
    """

    scheme: str
    accuracy: float
    steps: int
    derivative_evaluations: int
    wall_time_s: float
    real_time_factor: float


@dataclass(kw_only=True)
class Recording:
    """All signals of one run.

    Attributes:
        scenario: What was simulated, a Scenario or a TrackingScenario.
        time: (N,) the ends of the integrator's steps in s. A time that stands twice
            marks a jump: the first row is before it, the second one after.
        signals: (N, k) samples by name; see simulation.simulate().
        events: In the order of their times.
        surfaces: Of the environment, as its block told them.
        solver: Solver statistics.
        channels: What became of the packets, by the name of the channel; for channels
            of kind network.
        termination: `completed`, `diverged` or `interrupted`.
        reason: Why it did not complete; empty if it did.
        notes: What is left out, and why: a sentence each.
    """

    scenario: AnyScenario
    time: np.ndarray
    signals: dict[str, np.ndarray]
    events: list[Event]
    solver: SolverStatistics
    surfaces: tuple[Surface, ...] = ()
    channels: dict[str, PacketStatistics] = field(default_factory=dict)
    termination: str = "completed"
    reason: str = ""
    notes: list[str] = field(default_factory=list)

    def __getitem__(self, name: str) -> np.ndarray:
        """Returns the samples (N, k) of a signal."""
        return self.signals[name]

    @property
    def teleoperation(self) -> Scenario:
        """The scenario of a run that was a teleoperation.

        Raises:
            ScenarioError: If it was another task.
        """
        return AsTeleoperation(self.scenario)

    @property
    def commands(self) -> np.ndarray:
        """What the surgeon applies and commands, [F_h; v_d] in N and m/s (N, 2n)."""
        if "velocity_command" in self.signals:
            return np.hstack([self["force_command"], self["velocity_command"]])
        return self["forward_packet_sent"]

    def FindSurface(self, name: str) -> Surface | None:
        """Returns a surface of the environment, None if there is none of this name.

        Args:
            name: `contact` or `puncture`, or what else the environment told.
        """
        return FindSurface(self.surfaces, name)

    def Interpolate(self, name: str, times: np.ndarray) -> np.ndarray:
        """Returns a signal between its samples.

        Args:
            name: Name of the signal.
            times: (M,) ascending times in s, clamped to the span of the recording.

        Returns:
            (M, k) values, as accurate as the solver's steps; before a jump at the
            very instant of the jump.
        """
        return interpolate(self.time, self.signals[name], np.asarray(times))

    def EventTimes(self, name: str) -> list[float]:
        """Returns the times in s of all events with that name."""
        return [event.time for event in self.events if event.name == name]

    def Save(self, path: str | Path) -> None:
        """Writes the recording to an .npz file which LoadRecording() reads.

        The file appears complete or not at all.

        Args:
            path: Where to; `.npz` is not added.

        Raises:
            OSError: If the file cannot be written.
        """
        description = {
            "scenario": ScenarioToYaml(self.scenario),
            "events": [asdict(event) for event in self.events],
            "surfaces": [surface.ToRecord() for surface in self.surfaces],
            "solver": asdict(self.solver),
            "channels": {name: asdict(x) for name, x in self.channels.items()},
            "termination": self.termination,
            "reason": self.reason,
            "notes": self.notes,
        }
        arrays = {f"signal.{name}": x for name, x in self.signals.items()}
        arrays["description"] = np.array(json.dumps(description))
        with Replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, time=self.time, **arrays)  # type: ignore[arg-type]


def LoadRecording(path: str | Path) -> Recording:
    """Reads a recording that Recording.Save() wrote.

    Args:
        path: The .npz file.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is not a recording.
    """
    with np.load(path, allow_pickle=False) as data:
        if "description" not in data:
            raise ValueError(f"{path}: not a recording of teleop-drake")
        description = json.loads(str(data["description"]))
        return Recording(
            scenario=ScenarioFromYaml(description["scenario"]),
            time=data["time"],
            signals={
                name.removeprefix("signal."): data[name]
                for name in data.files
                if name.startswith("signal.")
            },
            events=[Event(**event) for event in description["events"]],
            solver=SolverStatistics(**description["solver"]),
            surfaces=tuple(map(Surface.FromRecord, description["surfaces"])),
            channels={
                name: PacketStatistics(**statistics)
                for name, statistics in description["channels"].items()
            },
            termination=description["termination"],
            reason=description["reason"],
            notes=description["notes"],
        )
