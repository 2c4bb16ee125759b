"""The delay map: how much later the signal of each connection of a Diagram may come."""

import numpy as np
from pydrake.systems.framework import (
    Context,
    Diagram,
    PortDataType,
    System,
)

from teleop_drake.loops.engine.flatten import Block, InputsOf
from teleop_drake.loops.framework.arrays import Indices
from teleop_drake.loops.framework.signals import PathsIn
from teleop_drake.loops.linear.cut_diagram import CutDiagram, TimesOf
from teleop_drake.loops.linear.ports import (
    CheckPoint,
    CopyContext,
    DelayMargin,
    OpenDiagram,
    OpenedDiagram,
    RefuseBend,
)
from teleop_drake.loops.numerics.delay_map import delay_margins
from teleop_drake.loops.numerics.state_space import StateSpace, strong_parts

_Place = tuple[System, int]
"""A system and the index of one of its inputs."""

_Leaf = tuple[System, str]
"""A block and the name of one of its inputs."""


def DelayMargins(
    diagram: Diagram, context: Context, *, is_moving: bool = False
) -> dict[str, float]:
    """Returns the additional delay in s that each connection of a Diagram tolerates.

    The Diagram is stable if the signal of this connection alone is delayed by less than
    this. All delays in the Diagram are exact. The Diagram is linearised once or, if a
    block samples, once for each connection.

    Args:
        diagram: A Diagram that LinearizePorts() accepts.
        context: The equilibrium, a Context of this Diagram. The output of each delay is
            set to its input there. The Context is not changed.
        is_moving: Whether the Context may be an instant of a motion; see
            LinearizePorts().

    Returns:
        The margins, keyed by the input ports to which the connections lead, as
        `plant.force` or, in a nested Diagram, `robot/plant.force`. Several connections
        may leave one output; DelayMargin() of the output is the margin of all of them
        together. A margin is infinity if the signal is in no loop or no delay makes the
        Diagram unstable. All are 0 if the Diagram is unstable already.

    Raises:
        ValueError: As in LinearizePorts().
    """
    return DelayMap(diagram, context, is_moving=is_moving).margins


class DelayMap:
    """The delay margins of all connections of a Diagram.

    Attributes:
        margins: See DelayMargins().
        is_stable: Whether the Diagram is stable without additional delay.

    Args:
        diagram: See DelayMargins().
        context: See DelayMargins().
        is_moving: See DelayMargins().
    """

    def __init__(self, diagram: Diagram, context: Context, *, is_moving: bool = False):
        CheckPoint(diagram, context)
        function = CutDiagram(diagram, CopyContext(diagram, context))
        opened = OpenDiagram(function, [])
        leaves = _LeavesIn(diagram, function.blocks)
        found: list[float] | None
        if opened.samples:
            ports = [system.get_input_port(i) for system, i in leaves]
            found = [
                DelayMargin(diagram, context, port, is_moving=is_moving)
                for port in ports
            ]
        else:
            opened.Settle()
            wires, network = _CutAllWires(opened, context, is_moving=is_moving)
            bundles = [
                np.array([wires[leaf] for leaf in own if leaf in wires], dtype=int)
                for own in leaves.values()
            ]
            found = delay_margins(network, bundles)
        self.is_stable = found is not None and (any(found) or not found)
        self._margins = dict(zip(leaves, found or [0.0] * len(leaves), strict=True))
        self.margins = {
            f"{path}.{system.get_input_port(i).get_name()}": self._margins[system, i]
            for system, path in PathsIn(diagram)
            for i in range(system.num_input_ports())
            if (system, i) in self._margins
        }

    def Into(self, system: System, index: int) -> float | None:
        """Returns the margin of the connection to an input of a system, in s.

        The result is None if the input is not connected or is no vector.
        """
        return self._margins.get((system, index))


def _LeavesIn(diagram: Diagram, blocks: list[Block]) -> dict[_Place, list[_Leaf]]:
    """Returns the connected vector inputs of blocks under each input of a system."""
    connected = {
        (block.system, name)
        for block in blocks
        for name in block.inputs
        if block.system.GetInputPort(name).get_data_type() == PortDataType.kVectorValued
    }
    found = {}
    for system, _ in PathsIn(diagram):
        for i in range(system.num_input_ports()):
            leaves = [leaf for leaf in InputsOf(system, i) if leaf in connected]
            if leaves:
                found[system, i] = leaves
    return found


def _CutAllWires(
    opened: OpenedDiagram, context: Context, *, is_moving: bool
) -> tuple[dict[_Leaf, Indices], StateSpace]:
    """Returns the signals of each wire, and the network with all wires cut.

    A wire is the connection to an input of a block on which a state or a delay depends.
    """
    function = opened.function
    wires: dict[_Leaf, Indices] = {}
    cuts = []
    first = 0
    for block in function.BlocksFor([]):
        for name in block.inputs:
            port = block.system.GetInputPort(name)
            if port.get_data_type() != PortDataType.kVectorValued:
                continue
            cuts.append(function.CutAt(port))
            wires[block.system, name] = first + np.arange(port.size())
            first += port.size()
    sent = [cut.entering for cut in cuts if cut.entering is not None]
    slopes = opened.Slopes(cuts, sent, is_moving=is_moving)
    # A law that bends outside of all loops has no influence.
    in_loops = np.any([np.zeros(len(slopes)), *strong_parts(slopes)], axis=0)
    for i, path in function.Bends(slopes).items():
        if in_loops[i]:
            RefuseBend(context, path)
    slopes = opened.CloseZeroDelays(slopes)
    n = sum(x.size for x in opened.states)
    delays = TimesOf(opened.delays)
    return wires, StateSpace(matrix=slopes, num_states=n, delays=delays)
