"""Settings that may change during a drive."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from teleop_drake.scenario import (
    AnyScenario,
    AsTeleoperation,
    LayersEnvironmentConfig,
    LoadScenario,
    Scenario,
)

PACKET_PERIOD = 0.01
"""Time between packets in s where a loss turns a channel into a network."""

_CHANNELS = ("forward_channel", "return_channel")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What may be changed while one drives.

    Attributes:
        controller: Kind of the architecture.
        delay: Each way, s; None: as in the scenario.
        loss: Share of the packets that are lost each way, 0 to 1. If it is not 0, a
            channel of another kind becomes a network with a packet each PACKET_PERIOD.
        stiffness: Factor by which every layer is as stiff as in the scenario.
    """

    controller: str
    delay: float | None = None
    loss: float = 0.0
    stiffness: float = 1.0

    def __str__(self) -> str:
        """Returns the settings on one line."""
        text = self.controller
        if self.delay is not None:
            text += f", {self.delay:g} s each way"
        if self.loss:
            text += f", {100 * self.loss:g} % lost"
        if self.stiffness != 1:
            text += f", {self.stiffness:g} times as stiff"
        return text

    def Overrides(self, scenario: Scenario) -> list[str]:
        """Returns what turns the scenario into one with these settings."""
        changes: dict[str, Any] = {"controller.kind": self.controller}
        for path in _CHANNELS:
            channel = getattr(scenario, path)
            if self.delay is not None:
                changes[f"{path}.delay"] = self.delay
            if self.loss:
                if channel.kind != "network":
                    changes[f"{path}.kind"] = "network"
                    changes[f"{path}.sample_period"] = PACKET_PERIOD
                changes[f"{path}.loss.kind"] = "independent"
                changes[f"{path}.loss.probability"] = self.loss
        environment = scenario.environment
        if self.stiffness != 1 and isinstance(environment, LayersEnvironmentConfig):
            for layer in environment.layers:
                changes[f"environment.layers.{layer.name}.stiffness"] = (
                    layer.stiffness * self.stiffness
                )
        return [f"{path}={value!r}" for path, value in changes.items()]


def LoadDriven(name_or_path: str, overrides: Sequence[str]) -> Scenario:
    """Loads a scenario that can be driven.

    Raises:
        ScenarioError: If it cannot be read, is not valid, or is no teleoperation.
    """
    scenario: AnyScenario = LoadScenario(name_or_path, overrides)
    return AsTeleoperation(
        scenario, "in the tracking of chapter 3 there is no operator"
    )
