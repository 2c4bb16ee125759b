"""The blocks of a loop and what they take, as one imports pydrake.systems.primitives.

    from teleop_drake.blocks import DirectForce, TransportDelay

Each name is imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teleop_drake.architectures.adaptive_backstepping import AdaptiveBackstepping
    from teleop_drake.architectures.base import (
        Architecture,
        ArchitectureConfig,
        ControlLawConfig,
        MakeSlaveStation,
    )
    from teleop_drake.architectures.damped_force import DampedForce
    from teleop_drake.architectures.direct_force import DirectForce
    from teleop_drake.architectures.four_channel import (
        FourChannelConfig,
        FourChannelMaster,
        FourChannelSlave,
    )
    from teleop_drake.architectures.own_law import FunctionLaw
    from teleop_drake.architectures.proportional_damping import (
        ProportionalDampingConfig,
        ProportionalMaster,
        ProportionalSlave,
    )
    from teleop_drake.architectures.robust_backstepping import RobustBackstepping
    from teleop_drake.architectures.smith_predictor import (
        SmithPredictorConfig,
        SmithPredictorMaster,
    )
    from teleop_drake.architectures.time_domain_passivity import (
        PassivityMaster,
        PassivitySlave,
        TimeDomainPassivityConfig,
    )
    from teleop_drake.architectures.wave_variables import (
        WaveMaster,
        WaveSlave,
        WaveVariablesConfig,
    )
    from teleop_drake.channels.base import ChannelConfig
    from teleop_drake.channels.network import NetworkDelay
    from teleop_drake.channels.packet_network import PacketNetwork, Receiver
    from teleop_drake.channels.sampled import SampledDelay
    from teleop_drake.channels.transport import TransportDelay
    from teleop_drake.channels.variable import DelayProfile, Sinusoid, VariableDelay
    from teleop_drake.environments.base import EnvironmentConfig
    from teleop_drake.environments.layered_force_field import (
        LayerConfig,
        LayeredForceField,
    )
    from teleop_drake.environments.needle_path import NeedleInTissue, NeedlePathConfig
    from teleop_drake.environments.surface import PlaneSurface, Surface
    from teleop_drake.environments.wall import (
        ContactWall,
        FrictionWallConfig,
        HuntCrossleyConfig,
        RelaxingTissue,
        StandardLinearSolidConfig,
    )
    from teleop_drake.laws.backstepping import BacksteppingGains
    from teleop_drake.laws.gaussian_network import GaussianNetwork
    from teleop_drake.laws.operator import HumanOperator
    from teleop_drake.laws.robust_backstepping import RobustBounds
    from teleop_drake.laws.task_space import PostureGains
    from teleop_drake.laws.tracking import TrackingGains
    from teleop_drake.operators.base import OperatorConfig
    from teleop_drake.operators.hand import HandOperator
    from teleop_drake.operators.human import HumanHand, HumanStation
    from teleop_drake.operators.planned import (
        ConstantVelocityOperator,
        Plan,
        PlannedOperator,
        PlanOfPieces,
    )
    from teleop_drake.robots import MakeRobot
    from teleop_drake.robots.base import RobotConfig
    from teleop_drake.robots.robot_diagram import MakeRobotDiagram
    from teleop_drake.systems.actuator import Actuator, ActuatorConfig, GearFriction
    from teleop_drake.systems.disturbance_force import DisturbanceForce
    from teleop_drake.systems.gravity_compensation import GravityCompensation
    from teleop_drake.systems.haptic_device import HapticDevice
    from teleop_drake.systems.joint_friction import JointFriction
    from teleop_drake.systems.network_tracking_controller import (
        NetworkTrackingController,
    )
    from teleop_drake.systems.posture_hold import PostureHold
    from teleop_drake.systems.sampled_sensor import SampledSensor
    from teleop_drake.systems.tool_interface import ToolInterface

__all__ = [
    "Actuator",
    "ActuatorConfig",
    "AdaptiveBackstepping",
    "Architecture",
    "ArchitectureConfig",
    "BacksteppingGains",
    "ChannelConfig",
    "ConstantVelocityOperator",
    "ContactWall",
    "ControlLawConfig",
    "DampedForce",
    "DelayProfile",
    "DirectForce",
    "DisturbanceForce",
    "EnvironmentConfig",
    "FourChannelConfig",
    "FourChannelMaster",
    "FourChannelSlave",
    "FrictionWallConfig",
    "FunctionLaw",
    "GaussianNetwork",
    "GearFriction",
    "GravityCompensation",
    "HandOperator",
    "HapticDevice",
    "HumanHand",
    "HumanOperator",
    "HumanStation",
    "HuntCrossleyConfig",
    "JointFriction",
    "LayerConfig",
    "LayeredForceField",
    "MakeRobot",
    "MakeRobotDiagram",
    "MakeSlaveStation",
    "NeedleInTissue",
    "NeedlePathConfig",
    "NetworkDelay",
    "NetworkTrackingController",
    "OperatorConfig",
    "PacketNetwork",
    "PassivityMaster",
    "PassivitySlave",
    "Plan",
    "PlanOfPieces",
    "PlaneSurface",
    "PlannedOperator",
    "PostureGains",
    "PostureHold",
    "ProportionalDampingConfig",
    "ProportionalMaster",
    "ProportionalSlave",
    "Receiver",
    "RelaxingTissue",
    "RobotConfig",
    "RobustBackstepping",
    "RobustBounds",
    "SampledDelay",
    "SampledSensor",
    "Sinusoid",
    "SmithPredictorConfig",
    "SmithPredictorMaster",
    "StandardLinearSolidConfig",
    "Surface",
    "TimeDomainPassivityConfig",
    "ToolInterface",
    "TrackingGains",
    "TransportDelay",
    "VariableDelay",
    "WaveMaster",
    "WaveSlave",
    "WaveVariablesConfig",
]

# The module that defines each name.
_PLACES = {
    "architectures.base": [
        "Architecture",
        "ArchitectureConfig",
        "ControlLawConfig",
        "MakeSlaveStation",
    ],
    "architectures.adaptive_backstepping": ["AdaptiveBackstepping"],
    "architectures.damped_force": ["DampedForce"],
    "architectures.direct_force": ["DirectForce"],
    "architectures.four_channel": [
        "FourChannelConfig",
        "FourChannelMaster",
        "FourChannelSlave",
    ],
    "architectures.own_law": ["FunctionLaw"],
    "architectures.proportional_damping": [
        "ProportionalDampingConfig",
        "ProportionalMaster",
        "ProportionalSlave",
    ],
    "architectures.robust_backstepping": ["RobustBackstepping"],
    "architectures.smith_predictor": ["SmithPredictorConfig", "SmithPredictorMaster"],
    "architectures.time_domain_passivity": [
        "PassivityMaster",
        "PassivitySlave",
        "TimeDomainPassivityConfig",
    ],
    "architectures.wave_variables": ["WaveMaster", "WaveSlave", "WaveVariablesConfig"],
    "channels.base": ["ChannelConfig"],
    "channels.network": ["NetworkDelay"],
    "channels.packet_network": ["PacketNetwork", "Receiver"],
    "channels.sampled": ["SampledDelay"],
    "channels.transport": ["TransportDelay"],
    "channels.variable": ["DelayProfile", "Sinusoid", "VariableDelay"],
    "environments.base": ["EnvironmentConfig"],
    "environments.layered_force_field": ["LayerConfig", "LayeredForceField"],
    "environments.needle_path": ["NeedleInTissue", "NeedlePathConfig"],
    "environments.surface": ["PlaneSurface", "Surface"],
    "environments.wall": [
        "ContactWall",
        "FrictionWallConfig",
        "HuntCrossleyConfig",
        "RelaxingTissue",
        "StandardLinearSolidConfig",
    ],
    "laws.backstepping": ["BacksteppingGains"],
    "laws.gaussian_network": ["GaussianNetwork"],
    "laws.operator": ["HumanOperator"],
    "laws.robust_backstepping": ["RobustBounds"],
    "laws.task_space": ["PostureGains"],
    "laws.tracking": ["TrackingGains"],
    "operators.base": ["OperatorConfig"],
    "operators.hand": ["HandOperator"],
    "operators.human": ["HumanHand", "HumanStation"],
    "operators.planned": [
        "ConstantVelocityOperator",
        "Plan",
        "PlanOfPieces",
        "PlannedOperator",
    ],
    "robots": ["MakeRobot"],
    "robots.base": ["RobotConfig"],
    "robots.robot_diagram": ["MakeRobotDiagram"],
    "systems.actuator": ["Actuator", "ActuatorConfig", "GearFriction"],
    "systems.disturbance_force": ["DisturbanceForce"],
    "systems.gravity_compensation": ["GravityCompensation"],
    "systems.haptic_device": ["HapticDevice"],
    "systems.joint_friction": ["JointFriction"],
    "systems.network_tracking_controller": ["NetworkTrackingController"],
    "systems.posture_hold": ["PostureHold"],
    "systems.sampled_sensor": ["SampledSensor"],
    "systems.tool_interface": ["ToolInterface"],
}

_MODULES = {name: module for module, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Imports one of the names when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"teleop_drake.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Returns the names, imported or not."""
    return list(__all__)
