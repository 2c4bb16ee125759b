"""The blocks of a loop and what they take, as one imports pydrake.systems.primitives.

    from teleop_drake.blocks import DirectForce, TransportDelay

Each name is imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teleop_drake.blocks.architectures.adaptive_backstepping import (
        AdaptiveBackstepping,
    )
    from teleop_drake.blocks.architectures.base import (
        Architecture,
        ArchitectureConfig,
        ControlLawConfig,
        MakeSlaveStation,
    )
    from teleop_drake.blocks.architectures.damped_force import DampedForce
    from teleop_drake.blocks.architectures.direct_force import DirectForce
    from teleop_drake.blocks.architectures.four_channel import (
        FourChannelConfig,
        FourChannelMaster,
        FourChannelSlave,
    )
    from teleop_drake.blocks.architectures.own_law import FunctionLaw
    from teleop_drake.blocks.architectures.proportional_damping import (
        ProportionalDampingConfig,
        ProportionalMaster,
        ProportionalSlave,
    )
    from teleop_drake.blocks.architectures.robust_backstepping import RobustBackstepping
    from teleop_drake.blocks.architectures.smith_predictor import (
        SmithPredictorConfig,
        SmithPredictorMaster,
    )
    from teleop_drake.blocks.architectures.time_domain_passivity import (
        PassivityMaster,
        PassivitySlave,
        TimeDomainPassivityConfig,
    )
    from teleop_drake.blocks.architectures.wave_variables import (
        WaveMaster,
        WaveSlave,
        WaveVariablesConfig,
    )
    from teleop_drake.blocks.channels.base import ChannelConfig
    from teleop_drake.blocks.channels.network import NetworkDelay
    from teleop_drake.blocks.channels.packet_network import PacketNetwork, Receiver
    from teleop_drake.blocks.channels.sampled import SampledDelay
    from teleop_drake.blocks.channels.transport import TransportDelay
    from teleop_drake.blocks.channels.variable import (
        DelayProfile,
        Sinusoid,
        VariableDelay,
    )
    from teleop_drake.blocks.environments.base import EnvironmentConfig
    from teleop_drake.blocks.environments.layered_force_field import (
        LayerConfig,
        LayeredForceField,
    )
    from teleop_drake.blocks.environments.needle_path import (
        NeedleInTissue,
        NeedlePathConfig,
    )
    from teleop_drake.blocks.environments.surface import PlaneSurface, Surface
    from teleop_drake.blocks.environments.wall import (
        ContactWall,
        FrictionWallConfig,
        HuntCrossleyConfig,
        RelaxingTissue,
        StandardLinearSolidConfig,
    )
    from teleop_drake.blocks.operators.base import OperatorConfig
    from teleop_drake.blocks.operators.hand import HandOperator
    from teleop_drake.blocks.operators.human import HumanHand, HumanStation
    from teleop_drake.blocks.operators.move_and_wait import (
        MoveAndWaitConfig,
        MoveAndWaitOperator,
    )
    from teleop_drake.blocks.operators.planned import (
        ConstantVelocityOperator,
        Plan,
        PlannedOperator,
        PlanOfPieces,
    )
    from teleop_drake.blocks.robots import MakeRobot
    from teleop_drake.blocks.robots.base import RobotConfig
    from teleop_drake.blocks.robots.robot_diagram import MakeRobotDiagram
    from teleop_drake.blocks.systems.actuator import (
        Actuator,
        ActuatorConfig,
        GearFriction,
    )
    from teleop_drake.blocks.systems.disturbance_force import DisturbanceForce
    from teleop_drake.blocks.systems.gravity_compensation import GravityCompensation
    from teleop_drake.blocks.systems.haptic_device import HapticDevice
    from teleop_drake.blocks.systems.joint_friction import JointFriction
    from teleop_drake.blocks.systems.network_tracking_controller import (
        NetworkTrackingController,
    )
    from teleop_drake.blocks.systems.posture_hold import PostureHold
    from teleop_drake.blocks.systems.sampled_sensor import SampledSensor
    from teleop_drake.blocks.systems.tool_interface import ToolInterface
    from teleop_drake.laws.backstepping import BacksteppingGains
    from teleop_drake.laws.gaussian_network import GaussianNetwork
    from teleop_drake.laws.operator import HumanOperator
    from teleop_drake.laws.robust_backstepping import RobustBounds
    from teleop_drake.laws.task_space import PostureGains
    from teleop_drake.laws.tracking import TrackingGains

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
    "MoveAndWaitConfig",
    "MoveAndWaitOperator",
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
    "blocks.architectures.base": [
        "Architecture",
        "ArchitectureConfig",
        "ControlLawConfig",
        "MakeSlaveStation",
    ],
    "blocks.architectures.adaptive_backstepping": ["AdaptiveBackstepping"],
    "blocks.architectures.damped_force": ["DampedForce"],
    "blocks.architectures.direct_force": ["DirectForce"],
    "blocks.architectures.four_channel": [
        "FourChannelConfig",
        "FourChannelMaster",
        "FourChannelSlave",
    ],
    "blocks.architectures.own_law": ["FunctionLaw"],
    "blocks.architectures.proportional_damping": [
        "ProportionalDampingConfig",
        "ProportionalMaster",
        "ProportionalSlave",
    ],
    "blocks.architectures.robust_backstepping": ["RobustBackstepping"],
    "blocks.architectures.smith_predictor": [
        "SmithPredictorConfig",
        "SmithPredictorMaster",
    ],
    "blocks.architectures.time_domain_passivity": [
        "PassivityMaster",
        "PassivitySlave",
        "TimeDomainPassivityConfig",
    ],
    "blocks.architectures.wave_variables": [
        "WaveMaster",
        "WaveSlave",
        "WaveVariablesConfig",
    ],
    "blocks.channels.base": ["ChannelConfig"],
    "blocks.channels.network": ["NetworkDelay"],
    "blocks.channels.packet_network": ["PacketNetwork", "Receiver"],
    "blocks.channels.sampled": ["SampledDelay"],
    "blocks.channels.transport": ["TransportDelay"],
    "blocks.channels.variable": ["DelayProfile", "Sinusoid", "VariableDelay"],
    "blocks.environments.base": ["EnvironmentConfig"],
    "blocks.environments.layered_force_field": ["LayerConfig", "LayeredForceField"],
    "blocks.environments.needle_path": ["NeedleInTissue", "NeedlePathConfig"],
    "blocks.environments.surface": ["PlaneSurface", "Surface"],
    "blocks.environments.wall": [
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
    "blocks.operators.base": ["OperatorConfig"],
    "blocks.operators.hand": ["HandOperator"],
    "blocks.operators.human": ["HumanHand", "HumanStation"],
    "blocks.operators.move_and_wait": ["MoveAndWaitConfig", "MoveAndWaitOperator"],
    "blocks.operators.planned": [
        "ConstantVelocityOperator",
        "Plan",
        "PlanOfPieces",
        "PlannedOperator",
    ],
    "blocks.robots": ["MakeRobot"],
    "blocks.robots.base": ["RobotConfig"],
    "blocks.robots.robot_diagram": ["MakeRobotDiagram"],
    "blocks.systems.actuator": ["Actuator", "ActuatorConfig", "GearFriction"],
    "blocks.systems.disturbance_force": ["DisturbanceForce"],
    "blocks.systems.gravity_compensation": ["GravityCompensation"],
    "blocks.systems.haptic_device": ["HapticDevice"],
    "blocks.systems.joint_friction": ["JointFriction"],
    "blocks.systems.network_tracking_controller": ["NetworkTrackingController"],
    "blocks.systems.posture_hold": ["PostureHold"],
    "blocks.systems.sampled_sensor": ["SampledSensor"],
    "blocks.systems.tool_interface": ["ToolInterface"],
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
