"""The blocks of a teleoperation loop, and the classes that configure them.

    from teleop_drake.blocks import DirectForce, TransportDelay

Each name is imported on its first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teleop_drake.blocks.names import *  # noqa: F403

# The names that each module of teleop_drake defines.
_PLACES = {
    "blocks.architectures.adaptive_backstepping": ["AdaptiveBackstepping"],
    "blocks.architectures.base": [
        "Architecture",
        "ArchitectureConfig",
        "ControlLawConfig",
        "MakeSlaveStation",
    ],
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
    "blocks.channels.abstract": ["AbstractDelay"],
    "blocks.channels.base": ["ChannelConfig"],
    "blocks.channels.conveyor": ["VariableTransportDelay"],
    "blocks.channels.network": ["NetworkDelay"],
    "blocks.channels.packet_network": ["PacketNetwork"],
    "blocks.channels.packet_options": ["Receiver"],
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
    "blocks.operators.base": ["OperatorConfig"],
    "blocks.operators.hand": ["HandOperator"],
    "blocks.operators.human": ["HumanHand", "HumanStation"],
    "blocks.operators.move_and_wait": ["MoveAndWaitConfig", "MoveAndWaitOperator"],
    "blocks.operators.planned": [
        "ConstantVelocityOperator",
        "Plan",
        "PlannedOperator",
        "PlanOfPieces",
    ],
    "blocks.robots": ["MakeRobot"],
    "blocks.robots.base": ["RobotConfig"],
    "blocks.robots.robot_diagram": ["MakeRobotDiagram"],
    "blocks.systems.actuator": ["Actuator", "ActuatorConfig", "GearFriction"],
    "blocks.systems.disturbance_force": ["DisturbanceForce"],
    "blocks.systems.gravity_compensation": ["GravityCompensation"],
    "blocks.systems.haptic_device": ["HapticDevice"],
    "blocks.systems.joint_friction": ["JointFriction"],
    "blocks.systems.moving_window": ["MovingWindow"],
    "blocks.systems.network_tracking_controller": ["NetworkTrackingController"],
    "blocks.systems.posture_hold": ["PostureHold"],
    "blocks.systems.sampled_sensor": ["SampledSensor"],
    "blocks.systems.tool_interface": ["ToolInterface"],
    "blocks.systems.trajectory_source": ["TrajectorySource"],
    "laws.backstepping": ["BacksteppingGains"],
    "laws.gaussian_network": ["GaussianNetwork"],
    "laws.operator": ["HumanOperator"],
    "laws.robust_backstepping": ["RobustBounds"],
    "laws.task_space": ["PostureGains"],
    "laws.tracking": ["TrackingGains"],
}

__all__ = sorted(name for names in _PLACES.values() for name in names)


def __getattr__(name: str) -> Any:
    """Imports a name on its first use."""
    for place, names in _PLACES.items():
        if name in names:
            value = getattr(import_module(f"teleop_drake.{place}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Returns all names, including those that are not imported yet."""
    return list(__all__)
