"""The names of teleop_drake.loops, and the modules that define them."""

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
from teleop_drake.loops.delays.sampled import SampledDelay as SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay as TransportDelay
from teleop_drake.loops.delays.variable import VariableDelay as VariableDelay
from teleop_drake.loops.draw.block_diagram import WriteDiagram as WriteDiagram
from teleop_drake.loops.engine.parameters import NamedParameters as NamedParameters
from teleop_drake.loops.framework.validation import ScenarioError as ScenarioError
from teleop_drake.loops.linear.delay_map import DelayMargins as DelayMargins
from teleop_drake.loops.linear.ports import DelayMargin as DelayMargin
from teleop_drake.loops.linear.ports import LinearizePorts as LinearizePorts
from teleop_drake.loops.page.diagram_page import MakePage as MakePage
from teleop_drake.loops.page.diagram_page import WritePage as WritePage
from teleop_drake.loops.run.compiled_system import Compile as Compile
from teleop_drake.loops.run.recording import Recording as Recording
from teleop_drake.loops.run.simulator import MakeSimulator as MakeSimulator
from teleop_drake.loops.run.system_run import simulate as simulate
