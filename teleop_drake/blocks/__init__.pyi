"""The names of teleop_drake.blocks, and the modules that define them."""

from teleop_drake.loops.blocks.moving_window import MovingWindow as MovingWindow
from teleop_drake.loops.blocks.trajectory_source import (
    TrajectorySource as TrajectorySource,
)
from teleop_drake.loops.delays.abstract import AbstractDelay as AbstractDelay
from teleop_drake.loops.delays.conveyor import (
    VariableTransportDelay as VariableTransportDelay,
)
from teleop_drake.loops.delays.network import NetworkDelay as NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork as PacketNetwork
from teleop_drake.loops.delays.packet_options import Receiver as Receiver
from teleop_drake.loops.delays.sampled import SampledDelay as SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay as TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile as DelayProfile
from teleop_drake.loops.delays.variable import Sinusoid as Sinusoid
from teleop_drake.loops.delays.variable import VariableDelay as VariableDelay
from teleop_drake.loops.framework.surface import PlaneSurface as PlaneSurface
from teleop_drake.loops.framework.surface import Surface as Surface
from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBackstepping as AdaptiveBackstepping,
)
from teleop_drake.model.blocks.architectures.base import Architecture as Architecture
from teleop_drake.model.blocks.architectures.base import (
    ArchitectureConfig as ArchitectureConfig,
)
from teleop_drake.model.blocks.architectures.base import (
    ControlLawConfig as ControlLawConfig,
)
from teleop_drake.model.blocks.architectures.base import (
    MakeSlaveStation as MakeSlaveStation,
)
from teleop_drake.model.blocks.architectures.damped_force import (
    DampedForce as DampedForce,
)
from teleop_drake.model.blocks.architectures.direct_force import (
    DirectForce as DirectForce,
)
from teleop_drake.model.blocks.architectures.four_channel import (
    FourChannelConfig as FourChannelConfig,
)
from teleop_drake.model.blocks.architectures.four_channel import (
    FourChannelMaster as FourChannelMaster,
)
from teleop_drake.model.blocks.architectures.four_channel import (
    FourChannelSlave as FourChannelSlave,
)
from teleop_drake.model.blocks.architectures.own_law import FunctionLaw as FunctionLaw
from teleop_drake.model.blocks.architectures.proportional_damping import (
    ProportionalDampingConfig as ProportionalDampingConfig,
)
from teleop_drake.model.blocks.architectures.proportional_damping import (
    ProportionalMaster as ProportionalMaster,
)
from teleop_drake.model.blocks.architectures.proportional_damping import (
    ProportionalSlave as ProportionalSlave,
)
from teleop_drake.model.blocks.architectures.robust_backstepping import (
    RobustBackstepping as RobustBackstepping,
)
from teleop_drake.model.blocks.architectures.smith_predictor import (
    SmithPredictorConfig as SmithPredictorConfig,
)
from teleop_drake.model.blocks.architectures.smith_predictor import (
    SmithPredictorMaster as SmithPredictorMaster,
)
from teleop_drake.model.blocks.architectures.time_domain_passivity import (
    PassivityMaster as PassivityMaster,
)
from teleop_drake.model.blocks.architectures.time_domain_passivity import (
    PassivitySlave as PassivitySlave,
)
from teleop_drake.model.blocks.architectures.time_domain_passivity import (
    TimeDomainPassivityConfig as TimeDomainPassivityConfig,
)
from teleop_drake.model.blocks.architectures.wave_variables import (
    WaveMaster as WaveMaster,
)
from teleop_drake.model.blocks.architectures.wave_variables import (
    WaveSlave as WaveSlave,
)
from teleop_drake.model.blocks.architectures.wave_variables import (
    WaveVariablesConfig as WaveVariablesConfig,
)
from teleop_drake.model.blocks.environments.base import (
    EnvironmentConfig as EnvironmentConfig,
)
from teleop_drake.model.blocks.environments.layered_force_field import (
    LayerConfig as LayerConfig,
)
from teleop_drake.model.blocks.environments.layered_force_field import (
    LayeredForceField as LayeredForceField,
)
from teleop_drake.model.blocks.environments.needle_path import (
    NeedleInTissue as NeedleInTissue,
)
from teleop_drake.model.blocks.environments.needle_path import (
    NeedlePathConfig as NeedlePathConfig,
)
from teleop_drake.model.blocks.environments.wall import ContactWall as ContactWall
from teleop_drake.model.blocks.environments.wall import (
    FrictionWallConfig as FrictionWallConfig,
)
from teleop_drake.model.blocks.environments.wall import (
    HuntCrossleyConfig as HuntCrossleyConfig,
)
from teleop_drake.model.blocks.environments.wall import RelaxingTissue as RelaxingTissue
from teleop_drake.model.blocks.environments.wall import (
    StandardLinearSolidConfig as StandardLinearSolidConfig,
)
from teleop_drake.model.blocks.operators.base import OperatorConfig as OperatorConfig
from teleop_drake.model.blocks.operators.hand import HandOperator as HandOperator
from teleop_drake.model.blocks.operators.human import HumanHand as HumanHand
from teleop_drake.model.blocks.operators.human import HumanStation as HumanStation
from teleop_drake.model.blocks.operators.move_and_wait import (
    MoveAndWaitConfig as MoveAndWaitConfig,
)
from teleop_drake.model.blocks.operators.move_and_wait import (
    MoveAndWaitOperator as MoveAndWaitOperator,
)
from teleop_drake.model.blocks.operators.planned import (
    ConstantVelocityOperator as ConstantVelocityOperator,
)
from teleop_drake.model.blocks.operators.planned import Plan as Plan
from teleop_drake.model.blocks.operators.planned import (
    PlannedOperator as PlannedOperator,
)
from teleop_drake.model.blocks.operators.planned import PlanOfPieces as PlanOfPieces
from teleop_drake.model.blocks.robots import MakeRobot as MakeRobot
from teleop_drake.model.blocks.robots.base import RobotConfig as RobotConfig
from teleop_drake.model.blocks.robots.robot_diagram import (
    MakeRobotDiagram as MakeRobotDiagram,
)
from teleop_drake.model.blocks.systems.actuator import Actuator as Actuator
from teleop_drake.model.blocks.systems.actuator import ActuatorConfig as ActuatorConfig
from teleop_drake.model.blocks.systems.actuator import GearFriction as GearFriction
from teleop_drake.model.blocks.systems.disturbance_force import (
    DisturbanceForce as DisturbanceForce,
)
from teleop_drake.model.blocks.systems.gravity_compensation import (
    GravityCompensation as GravityCompensation,
)
from teleop_drake.model.blocks.systems.haptic_device import HapticDevice as HapticDevice
from teleop_drake.model.blocks.systems.joint_friction import (
    JointFriction as JointFriction,
)
from teleop_drake.model.blocks.systems.network_tracking_controller import (
    NetworkTrackingController as NetworkTrackingController,
)
from teleop_drake.model.blocks.systems.posture_hold import PostureHold as PostureHold
from teleop_drake.model.blocks.systems.sampled_sensor import (
    SampledSensor as SampledSensor,
)
from teleop_drake.model.blocks.systems.tool_interface import (
    ToolInterface as ToolInterface,
)
from teleop_drake.model.channels.base import ChannelConfig as ChannelConfig
from teleop_drake.model.laws.backstepping import BacksteppingGains as BacksteppingGains
from teleop_drake.model.laws.gaussian_network import GaussianNetwork as GaussianNetwork
from teleop_drake.model.laws.operator import HumanOperator as HumanOperator
from teleop_drake.model.laws.robust_backstepping import RobustBounds as RobustBounds
from teleop_drake.model.laws.task_space import PostureGains as PostureGains
from teleop_drake.model.laws.tracking import TrackingGains as TrackingGains
