"""Imports the names of teleop_drake.blocks from the modules that define them."""

from teleop_drake.loops.blocks.moving_window import MovingWindow
from teleop_drake.loops.blocks.trajectory_source import TrajectorySource
from teleop_drake.loops.delays.abstract import AbstractDelay
from teleop_drake.loops.delays.conveyor import VariableTransportDelay
from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Receiver
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile, Sinusoid, VariableDelay
from teleop_drake.loops.framework.surface import PlaneSurface, Surface
from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBackstepping,
)
from teleop_drake.model.blocks.architectures.base import (
    Architecture,
    ArchitectureConfig,
    ControlLawConfig,
    MakeSlaveStation,
)
from teleop_drake.model.blocks.architectures.damped_force import DampedForce
from teleop_drake.model.blocks.architectures.direct_force import DirectForce
from teleop_drake.model.blocks.architectures.four_channel import (
    FourChannelConfig,
    FourChannelMaster,
    FourChannelSlave,
)
from teleop_drake.model.blocks.architectures.own_law import FunctionLaw
from teleop_drake.model.blocks.architectures.proportional_damping import (
    ProportionalDampingConfig,
    ProportionalMaster,
    ProportionalSlave,
)
from teleop_drake.model.blocks.architectures.robust_backstepping import (
    RobustBackstepping,
)
from teleop_drake.model.blocks.architectures.smith_predictor import (
    SmithPredictorConfig,
    SmithPredictorMaster,
)
from teleop_drake.model.blocks.architectures.time_domain_passivity import (
    PassivityMaster,
    PassivitySlave,
    TimeDomainPassivityConfig,
)
from teleop_drake.model.blocks.architectures.wave_variables import (
    WaveMaster,
    WaveSlave,
    WaveVariablesConfig,
)
from teleop_drake.model.blocks.environments.base import EnvironmentConfig
from teleop_drake.model.blocks.environments.layered_force_field import (
    LayerConfig,
    LayeredForceField,
)
from teleop_drake.model.blocks.environments.needle_path import (
    NeedleInTissue,
    NeedlePathConfig,
)
from teleop_drake.model.blocks.environments.wall import (
    ContactWall,
    FrictionWallConfig,
    HuntCrossleyConfig,
    RelaxingTissue,
    StandardLinearSolidConfig,
)
from teleop_drake.model.blocks.operators.base import OperatorConfig
from teleop_drake.model.blocks.operators.hand import HandOperator
from teleop_drake.model.blocks.operators.human import HumanHand, HumanStation
from teleop_drake.model.blocks.operators.move_and_wait import (
    MoveAndWaitConfig,
    MoveAndWaitOperator,
)
from teleop_drake.model.blocks.operators.planned import (
    ConstantVelocityOperator,
    Plan,
    PlannedOperator,
    PlanOfPieces,
)
from teleop_drake.model.blocks.robots import MakeRobot
from teleop_drake.model.blocks.robots.base import RobotConfig
from teleop_drake.model.blocks.robots.robot_diagram import MakeRobotDiagram
from teleop_drake.model.blocks.systems.actuator import (
    Actuator,
    ActuatorConfig,
    GearFriction,
)
from teleop_drake.model.blocks.systems.disturbance_force import DisturbanceForce
from teleop_drake.model.blocks.systems.gravity_compensation import GravityCompensation
from teleop_drake.model.blocks.systems.haptic_device import HapticDevice
from teleop_drake.model.blocks.systems.joint_friction import JointFriction
from teleop_drake.model.blocks.systems.network_tracking_controller import (
    NetworkTrackingController,
)
from teleop_drake.model.blocks.systems.posture_hold import PostureHold
from teleop_drake.model.blocks.systems.sampled_sensor import SampledSensor
from teleop_drake.model.blocks.systems.tool_interface import ToolInterface
from teleop_drake.model.channels.base import ChannelConfig
from teleop_drake.model.laws.backstepping import BacksteppingGains
from teleop_drake.model.laws.gaussian_network import GaussianNetwork
from teleop_drake.model.laws.operator import HumanOperator
from teleop_drake.model.laws.robust_backstepping import RobustBounds
from teleop_drake.model.laws.task_space import PostureGains
from teleop_drake.model.laws.tracking import TrackingGains
