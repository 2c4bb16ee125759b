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
    "model.blocks.architectures.adaptive_backstepping": ["AdaptiveBackstepping"],
    "model.blocks.architectures.base": [
        "Architecture",
        "ArchitectureConfig",
        "ControlLawConfig",
        "MakeSlaveStation",
    ],
    "model.blocks.architectures.damped_force": ["DampedForce"],
    "model.blocks.architectures.direct_force": ["DirectForce"],
    "model.blocks.architectures.four_channel": [
        "FourChannelConfig",
        "FourChannelMaster",
        "FourChannelSlave",
    ],
    "model.blocks.architectures.own_law": ["FunctionLaw"],
    "model.blocks.architectures.proportional_damping": [
        "ProportionalDampingConfig",
        "ProportionalMaster",
        "ProportionalSlave",
    ],
    "model.blocks.architectures.robust_backstepping": ["RobustBackstepping"],
    "model.blocks.architectures.smith_predictor": [
        "SmithPredictorConfig",
        "SmithPredictorMaster",
    ],
    "model.blocks.architectures.time_domain_passivity": [
        "PassivityMaster",
        "PassivitySlave",
        "TimeDomainPassivityConfig",
    ],
    "model.blocks.architectures.wave_variables": [
        "WaveMaster",
        "WaveSlave",
        "WaveVariablesConfig",
    ],
    "loops.delays.abstract": ["AbstractDelay"],
    "model.channels.base": ["ChannelConfig"],
    "loops.delays.conveyor": ["VariableTransportDelay"],
    "loops.delays.network": ["NetworkDelay"],
    "loops.delays.packet_network": ["PacketNetwork"],
    "loops.delays.packet_options": ["Receiver"],
    "loops.delays.sampled": ["SampledDelay"],
    "loops.delays.transport": ["TransportDelay"],
    "loops.delays.variable": ["DelayProfile", "Sinusoid", "VariableDelay"],
    "model.blocks.environments.base": ["EnvironmentConfig"],
    "model.blocks.environments.layered_force_field": [
        "LayerConfig",
        "LayeredForceField",
    ],
    "model.blocks.environments.needle_path": ["NeedleInTissue", "NeedlePathConfig"],
    "loops.framework.surface": ["PlaneSurface", "Surface"],
    "model.blocks.environments.wall": [
        "ContactWall",
        "FrictionWallConfig",
        "HuntCrossleyConfig",
        "RelaxingTissue",
        "StandardLinearSolidConfig",
    ],
    "model.blocks.operators.base": ["OperatorConfig"],
    "model.blocks.operators.hand": ["HandOperator"],
    "model.blocks.operators.human": ["HumanHand", "HumanStation"],
    "model.blocks.operators.move_and_wait": [
        "MoveAndWaitConfig",
        "MoveAndWaitOperator",
    ],
    "model.blocks.operators.planned": [
        "ConstantVelocityOperator",
        "Plan",
        "PlannedOperator",
        "PlanOfPieces",
    ],
    "model.blocks.robots": ["MakeRobot"],
    "model.blocks.robots.base": ["RobotConfig"],
    "model.blocks.robots.robot_diagram": ["MakeRobotDiagram"],
    "model.blocks.systems.actuator": ["Actuator", "ActuatorConfig", "GearFriction"],
    "model.blocks.systems.disturbance_force": ["DisturbanceForce"],
    "model.blocks.systems.gravity_compensation": ["GravityCompensation"],
    "model.blocks.systems.haptic_device": ["HapticDevice"],
    "model.blocks.systems.joint_friction": ["JointFriction"],
    "loops.blocks.moving_window": ["MovingWindow"],
    "model.blocks.systems.network_tracking_controller": ["NetworkTrackingController"],
    "model.blocks.systems.posture_hold": ["PostureHold"],
    "model.blocks.systems.sampled_sensor": ["SampledSensor"],
    "model.blocks.systems.tool_interface": ["ToolInterface"],
    "loops.blocks.trajectory_source": ["TrajectorySource"],
    "model.laws.backstepping": ["BacksteppingGains"],
    "model.laws.gaussian_network": ["GaussianNetwork"],
    "model.laws.operator": ["HumanOperator"],
    "model.laws.robust_backstepping": ["RobustBounds"],
    "model.laws.task_space": ["PostureGains"],
    "model.laws.tracking": ["TrackingGains"],
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
