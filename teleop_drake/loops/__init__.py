"""Any Diagram of Drake's, with exact delays: run it, compile it, draw it, ask margins.

    from teleop_drake.loops import TransportDelay as TransportDelay
    from teleop_drake.loops import simulate as simulate

README.md in this folder shows how. Each name is imported on its first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_PLACES = {
    "AbstractDelay": "delays.abstract",
    "Compile": "run.compiled_system",
    "DelayMargin": "linear.ports",
    "DelayMargins": "linear.delay_map",
    "LinearizePorts": "linear.ports",
    "MakePage": "page.diagram_page",
    "MakeSimulator": "run.simulator",
    "MovingWindow": "blocks.moving_window",
    "NamedParameters": "engine.parameters",
    "NetworkDelay": "delays.network",
    "PacketNetwork": "delays.packet_network",
    "Recording": "run.recording",
    "SampledDelay": "delays.sampled",
    "ScenarioError": "framework.validation",
    "TrajectorySource": "blocks.trajectory_source",
    "TransportDelay": "delays.transport",
    "VariableDelay": "delays.variable",
    "VariableTransportDelay": "delays.conveyor",
    "WriteDiagram": "draw.block_diagram",
    "WritePage": "page.diagram_page",
    "simulate": "run.system_run",
}

__all__ = sorted(_PLACES)


def __getattr__(name: str) -> Any:
    """Imports a name on its first use."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Returns the names of the package, including those not imported yet."""
    return sorted({*globals(), *__all__})
