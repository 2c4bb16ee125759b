"""Scenarios: one task, its robot, channels, tissue and controller, as plain data."""

from teleop_drake.blocks.architectures import ARCHITECTURES, CONTROLLERS
from teleop_drake.blocks.environments.layered_force_field import LayerConfig
from teleop_drake.scenario.config import (
    TRACKING_CONTROLLERS,
    ControllerConfig,
    TrajectoryConfig,
)
from teleop_drake.scenario.loading import (
    AsScenario,
    AsTeleoperation,
    CheckSteps,
    LoadOverridden,
    LoadScenario,
    ScenarioFromYaml,
    ScenarioNames,
)
from teleop_drake.scenario.overrides import DELAYS
from teleop_drake.scenario.scenario import (
    AnyScenario,
    CheckStart,
    Scenario,
    ScenarioLike,
    ScenarioToYaml,
    TrackingScenario,
)
from teleop_drake.validation import ScenarioError

__all__ = [
    "ARCHITECTURES",
    "CONTROLLERS",
    "DELAYS",
    "TRACKING_CONTROLLERS",
    "AnyScenario",
    "AsScenario",
    "AsTeleoperation",
    "CheckStart",
    "CheckSteps",
    "ControllerConfig",
    "LayerConfig",
    "LoadOverridden",
    "LoadScenario",
    "Scenario",
    "ScenarioError",
    "ScenarioFromYaml",
    "ScenarioLike",
    "ScenarioNames",
    "ScenarioToYaml",
    "TrackingScenario",
    "TrajectoryConfig",
]
