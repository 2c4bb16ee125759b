"""Scenarios: one task, its robot, channels, tissue and controller, as plain data."""

from teleop_drake.architectures import ARCHITECTURES, CONTROLLERS
from teleop_drake.channels import ChannelConfig
from teleop_drake.environments import (
    EnvironmentConfig,
    LayerConfig,
    LayersEnvironmentConfig,
)
from teleop_drake.operators import ConstantVelocityConfig, OperatorConfig
from teleop_drake.robots import RobotConfig
from teleop_drake.scenario.config import (
    TRACKING_CONTROLLERS,
    ControllerConfig,
    DisturbanceConfig,
    TrackingControllerConfig,
    TrajectoryConfig,
)
from teleop_drake.scenario.scaling import ScaleForces
from teleop_drake.scenario.scenario import (
    DELAYS,
    AnyScenario,
    AsScenario,
    AsTeleoperation,
    CheckStart,
    CheckSteps,
    LoadScenario,
    OverriddenPaths,
    Scenario,
    ScenarioFromYaml,
    ScenarioLike,
    ScenarioNames,
    ScenarioToYaml,
    TrackingScenario,
)
from teleop_drake.systems.haptic_device import HapticDeviceConfig
from teleop_drake.validation import GainMatrix, ScenarioError

__all__ = [
    "ARCHITECTURES",
    "CONTROLLERS",
    "DELAYS",
    "TRACKING_CONTROLLERS",
    "AnyScenario",
    "AsScenario",
    "AsTeleoperation",
    "ChannelConfig",
    "CheckStart",
    "CheckSteps",
    "ConstantVelocityConfig",
    "ControllerConfig",
    "DisturbanceConfig",
    "EnvironmentConfig",
    "GainMatrix",
    "HapticDeviceConfig",
    "LayerConfig",
    "LayersEnvironmentConfig",
    "LoadScenario",
    "OperatorConfig",
    "OverriddenPaths",
    "RobotConfig",
    "ScaleForces",
    "Scenario",
    "ScenarioError",
    "ScenarioFromYaml",
    "ScenarioLike",
    "ScenarioNames",
    "ScenarioToYaml",
    "TrackingControllerConfig",
    "TrackingScenario",
    "TrajectoryConfig",
]
