"""Diagrams as tables: their systems, and which output leads to which input.

A place names a port: `system.port`, or `system` alone if that has one such port. A
table has a row for each input, with the place of the output that leads to it:

    {"adder.u0": "plant.state", "filter": "adder"}
"""

from collections.abc import Mapping, Sequence
from typing import Any

from pydrake.systems.framework import Diagram, DiagramBuilder, System

Connections = dict[str, str]
"""The place of an output by the place of the input to which it leads."""


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
        diagram: The diagram.
        name: The name that the diagram gets.
        systems: The systems by the names by which places call them. Those without a
            name of their own get this one.
        inputs: The inputs to which each input port of the diagram leads.
        connections: The connections between the systems.
        outputs: The output that each output port of the diagram exports.

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


def OutputNames(system: System) -> list[str]:
    """Returns the names of a system's output ports in their order."""
    ports = map(system.get_output_port, range(system.num_output_ports()))
    return [port.get_name() for port in ports]
