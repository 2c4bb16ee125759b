"""The recording of a scenario's run, with what its task has to know."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.loops.framework.surface import FindSurface, Surface
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.run.recording import (
    CheckRecording,
    ReadRecording,
    Recording,
)
from teleop_drake.model.scenario import (
    AnyScenario,
    AsTeleoperation,
    Scenario,
    ScenarioFromYaml,
    ScenarioToYaml,
)
from teleop_drake.model.signals import AxesOf


@dataclass(kw_only=True, repr=False)
class TaskRecording(Recording):
    """The recording of a scenario's run.

    Attributes:
        scenario: The Scenario or TrackingScenario.
        surfaces: The surfaces that the block of the environment reports.
        has_constant_command: Whether the operator's block reports that it commands
            scenario.surgeon.velocity until contact; metrics compare with this velocity.
    """

    scenario: AnyScenario
    surfaces: tuple[Surface, ...] = ()
    has_constant_command: bool = True

    def _Subject(self) -> str:
        """Returns the scenario and the controller."""
        return f"{self.scenario.name}, {self.scenario.controller.kind}"

    def _repr_html_(self) -> str:
        """Returns the HTML for a notebook: the metrics and a small figure."""
        # Figures are a floor above. The root of the package imports them when needed.
        root = sys.modules["teleop_drake"]
        return str(root.RecordingHtml(self))

    def Components(self, name: str, size: int) -> list[Any]:
        """Returns the names of a packet's components; numbers for other signals."""
        direction, _, kind = name.partition("_")
        if kind.startswith("packet_"):
            architecture = self.teleoperation.controller.Chosen()
            axes = AxesOf(self.teleoperation.num_axes)
            # A packet may lack the last of the architecture's parts.
            parts = getattr(architecture, f"{direction}_parts")[: size // len(axes)]
            names = [f"{part} {axis}" for part in parts for axis in axes]
            if len(names) == size:
                return names
        return super().Components(name, size)

    @property
    def teleoperation(self) -> Scenario:
        """The scenario, if its task is a teleoperation.

        Raises:
            ScenarioError: If it is another task.
        """
        return AsTeleoperation(self.scenario)

    @property
    def commands(self) -> Array:
        """The operator's force and velocity command [F_h; v_d], N and m/s (N, 2n)."""
        if "velocity_command" in self.signals:
            return np.hstack([self["force_command"], self["velocity_command"]])
        return self["forward_packet_sent"]

    @property
    def felt_velocity(self) -> Array | None:
        """The velocity that the operator feels in m/s (N, n); None: not recorded."""
        if "felt_velocity" in self.signals:
            return self["felt_velocity"]
        if "return_packet_received" not in self.signals:
            return None
        # The thesis's packet is [p_WT; v_WT].
        n = self["tool_velocity"].shape[1]
        return self["return_packet_received"][:, n : 2 * n]

    def FindSurface(self, name: str) -> Surface | None:
        """Returns the surface of the environment that has a name, or None.

        Args:
            name: `contact`, `puncture`, or another name that the environment reports.
        """
        return FindSurface(self.surfaces, name)

    def _Description(self) -> Record:
        return {**super()._Description(), "scenario": ScenarioToYaml(self.scenario)}

    @classmethod
    def _FieldsOf(cls, description: Record) -> Record:
        scenario = ScenarioFromYaml(description["scenario"])
        surfaces = tuple(map(Surface.FromRecord, description["surfaces"]))
        own = {"scenario": scenario, "surfaces": surfaces}
        return {**super()._FieldsOf(description), **own}


def CheckTaskRecording(path: str, value: Any) -> TaskRecording:
    """Returns an argument that is the recording of a scenario's run.

    Raises:
        WrongKind: If it is no Recording.
        ScenarioError: If it is the recording of a System's run.
    """
    CheckRecording(path, value)
    if not isinstance(value, TaskRecording):
        allowed = "that of a scenario, whose task knows this"
        Refuse(f"{path}.scenario", None, allowed)
    return value


def LoadRecording(path: str | Path) -> Recording:
    """Reads a recording that Save() wrote: a TaskRecording if it is of a scenario.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file is not a recording, or has another format. The message
            is one line.
    """
    return ReadRecording(path, _KindOf)


def _KindOf(description: Mapping[str, Any]) -> type[Recording]:
    return TaskRecording if "scenario" in description else Recording
