"""Scenarios: one task, its robot, channels, tissue and controller, as plain data."""

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.architectures import ARCHITECTURES, CONTROLLERS
from teleop_drake.model.blocks.environments.layered_force_field import LayerConfig
from teleop_drake.model.scenario.config import (
    TRACKING_CONTROLLERS,
    ControllerConfig,
    TrajectoryConfig,
)
from teleop_drake.model.scenario.loading import (
    AsScenario,
    AsTeleoperation,
    CheckSteps,
    LoadOverridden,
    LoadScenario,
    ScenarioFromYaml,
    ScenarioNames,
)
from teleop_drake.model.scenario.overrides import DELAYS
from teleop_drake.model.scenario.scenario import (
    AnyScenario,
    CheckStart,
    Scenario,
    ScenarioLike,
    ScenarioToYaml,
    TrackingScenario,
)

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
