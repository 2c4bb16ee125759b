"""Builds Diagrams from tables of systems and connections.

A place names a port: `system.port`, or only `system` if the system has one such port. A
table of connections has the place of each input, and of the output connected to it:

    {"adder.u0": "plant.state", "filter": "adder"}
"""

from collections.abc import Mapping, Sequence
from typing import Any

from pydrake.autodiffutils import AutoDiffXd
from pydrake.symbolic import Expression
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPort,
    OutputPort,
    System,
    System_,
)

# Of each scalar type, most frequent first.
_BASES = [System_[scalar] for scalar in (float, AutoDiffXd, Expression)]

Connections = dict[str, str]
"""The place of the output that is connected to each input, by the input's place."""


def Wire(
    diagram: Diagram,
    name: str,
    systems: Mapping[str, System],
    *,
    inputs: Mapping[str, Sequence[str]],
    connections: Connections,
    outputs: Mapping[str, str],
) -> Diagram:
    """Builds systems and their connections into an empty diagram, and returns it.

    Args:
        diagram: An empty Diagram.
        name: The new name of the diagram.
        systems: The systems, by their names in places. A system without a name gets
            this name.
        inputs: The places of the inputs that each input port of the diagram feeds, by
            the name of the port.
        connections: The connections between the systems.
        outputs: The place of the output that each output port of the diagram exports,
            by the name of the port.

    Raises:
        RuntimeError: If a system lacks a port.
    """
    builder = DiagramBuilder()
    for key, system in systems.items():
        builder.AddNamedSystem(system.get_name() or key, system)
    for port_name, targets in inputs.items():
        port = builder.ExportInput(_Input(systems, targets[0]), port_name)
        for target in targets[1:]:
            builder.ConnectInput(port, _Input(systems, target))
    for target, source in connections.items():
        builder.Connect(_Output(systems, source), _Input(systems, target))
    for port_name, source in outputs.items():
        builder.ExportOutput(_Output(systems, source), port_name)
    builder.BuildInto(diagram)
    diagram.set_name(name)
    return diagram


def _Input(systems: Mapping[str, System], place: str) -> Any:
    """Returns the input port at a place."""
    name, _, port = place.partition(".")
    system = systems[name]
    return system.GetInputPort(port) if port else system.get_input_port()


def _Output(systems: Mapping[str, System], place: str) -> Any:
    """Returns the output port at a place."""
    name, _, port = place.partition(".")
    system = systems[name]
    return system.GetOutputPort(port) if port else system.get_output_port()


def InputPorts(system: Any) -> list[InputPort]:
    """Returns the input ports of a System of any scalar type, in their order.

    A subclass may define a get_input_port() with other arguments, as Drake's
    ConcatenateImages does.
    """
    get = _BaseOf(system).get_input_port
    return [get(system, i) for i in range(system.num_input_ports())]


def OutputPorts(system: Any) -> list[OutputPort]:
    """Returns the output ports of a System of any scalar type, in their order."""
    get = _BaseOf(system).get_output_port
    return [get(system, i) for i in range(system.num_output_ports())]


def _BaseOf(system: Any) -> Any:
    """Returns Drake's class System of the scalar type of a system."""
    return next(base for base in _BASES if isinstance(system, base))


def OutputNames(system: System) -> list[str]:
    """Returns the names of a system's output ports in their order."""
    return [port.get_name() for port in OutputPorts(system)]
