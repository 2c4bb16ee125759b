"""A TransportDelay on each connection of a diagram, of 0 s at first."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydrake.systems.framework import Context, Diagram, PortDataType, System

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.engine.flatten import Block, Flatten, InputsOf, Source
from teleop_drake.loops.engine.parameters import Scalar, SetNumbers
from teleop_drake.loops.framework.signals import PathsIn, Visible
from teleop_drake.loops.framework.validation import Range
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.linear.delay_map import DelayMap


@dataclass(frozen=True)
class _Wire:
    """A connection: the input of a block to which it leads, and its delay."""

    block: System
    port: str
    delay: TransportDelay
    context: Context


class LateWires:
    """The delays on the connections of a diagram, which Evaluator inserts.

    The name of a delay is that of its connection in DelayMargins(), and `.delay`.
    """

    def __init__(self, wires: Mapping[str, _Wire]):
        self._wires = wires

    @staticmethod
    def Of(diagram: System) -> "LateWires":
        """Returns delays of 0 s on all vector connections between blocks."""
        wires = {}
        for block in Flatten(diagram):
            for name in block.inputs:
                port = block.system.GetInputPort(name)
                if (
                    port.get_data_type() != PortDataType.kVectorValued
                    or not port.size()
                ):
                    continue
                # A block that is made with a delay of 0 has another program.
                delay = TransportDelay(delay=1.0, size=port.size())
                delay.set_name(f"{block.path}.{name}")
                context = delay.CreateDefaultContext()
                SetNumbers(delay, context, {"delay": 0.0})
                key = f"{block.path}.{name}.delay"
                wires[key] = _Wire(block.system, name, delay, context)
        return LateWires(wires)

    @property
    def contexts(self) -> dict[System, Context]:
        """The Context of each delay."""
        return {wire.delay: wire.context for wire in self._wires.values()}

    def With(self, values: Mapping[str, float]) -> "LateWires":
        """Returns the delays with other times in s; other names are ignored."""
        wires = dict(self._wires)
        for name, value in values.items():
            if name in wires:
                context = wires[name].context.Clone()
                SetNumbers(wires[name].delay, context, {"delay": value})
                wires[name] = replace(wires[name], context=context)
        return LateWires(wires)

    def Has(self, name: str) -> bool:
        """Returns whether a name is that of one of the delays."""
        return name in self._wires

    def Insert(self, blocks: list[Block]) -> list[Block]:
        """Returns the blocks of the diagram, and behind them the delays."""
        result = list(blocks)
        places = {block.system: i for i, block in enumerate(blocks)}
        for name, wire in self._wires.items():
            i = places[wire.block]
            source = result[i].inputs[wire.port]
            late = Source(len(result), "delayed_signal")
            result[i] = replace(result[i], inputs=result[i].inputs | {wire.port: late})
            result.append(
                Block(system=wire.delay, path=name, inputs={"signal": source})
            )
        return result

    def Scalars(self) -> dict[str, Scalar]:
        """Returns the delays as numbers of the blocks to which the connections lead."""
        allowed = Range("s", minimum=0)
        result = {}
        for name, wire in self._wires.items():
            path = name.removesuffix(f".{wire.port}.delay")
            result[name] = Scalar(0.0, "s", [path], is_delay=True, range=allowed)
        return result

    def Names(self, diagram: System) -> dict[str, list[str]]:
        """Returns the names of the delays into each input port, as `path:port`."""
        names = {(x.block, x.port): name for name, x in self._wires.items()}
        found: dict[str, list[str]] = {}
        for system, path in PathsIn(diagram):
            for port in InputPorts(system):
                leaves: list[Any] = InputsOf(system, int(port.get_index()))
                own = [names[leaf] for leaf in leaves if leaf in names]
                if own:
                    found[f"{path}:{Visible(port.get_name())}"] = own
        return found


def MarginsInto(
    diagram: System, context: Context, notes: list[str]
) -> dict[str, float | None]:
    """Returns the margins of DelayMargins() by input ports, as `path:port`.

    The diagram is linearised where its run begins. None stands for a margin that is
    infinite. The reason why there are no margins is added to the notes.
    """
    if not isinstance(diagram, Diagram):
        return {}
    try:
        found = DelayMap(diagram, context, is_moving=True)
    except ValueError as error:
        notes.append(f"connections have no margins: {error}")
        return {}
    margins: dict[str, float | None] = {}
    for system, path in PathsIn(diagram):
        for port in InputPorts(system):
            margin = found.Into(system, int(port.get_index()))
            if margin is not None:
                name = f"{path}:{Visible(port.get_name())}"
                margins[name] = margin if math.isfinite(margin) else None
    return margins
