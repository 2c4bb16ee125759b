"""The blocks of a teleoperation loop, and the classes that configure them.

    from teleop_drake.blocks import DirectForce, TransportDelay

The first use of a name imports all of them, because a run needs most of them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teleop_drake.blocks.names import *  # noqa: F403

__all__ = [
    "AbstractDelay",
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
    "MovingWindow",
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
    "VariableTransportDelay",
    "WaveMaster",
    "WaveSlave",
    "WaveVariablesConfig",
]


def __getattr__(name: str) -> Any:
    """Returns a name of the package; imports all names on the first call."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    names = import_module("teleop_drake.blocks.names")
    globals().update({each: getattr(names, each) for each in __all__})
    return globals()[name]


def __dir__() -> list[str]:
    """Returns all names, including those that are not imported yet."""
    return list(__all__)
