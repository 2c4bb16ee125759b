"""Checks of the systems of a user's own: their class and their ports."""

from collections.abc import Mapping
from typing import Any

from pydrake.systems.framework import Diagram, System

from teleop_drake.validation import Refuse, ScenarioError
from teleop_drake.wiring import Wire


def CheckPorts(
    name: str,
    system: Any,
    *,
    inputs: Mapping[str, int] | None = None,
    outputs: Mapping[str, int] | None = None,
    num_axes: int | None = None,
) -> None:
    """Refuses what is no system, or lacks ports, or has ports of another width.

    Args:
        name: The argument that holds the system, for messages.
        inputs: Width of each input by its name.
        outputs: Width of each output by its name.
        num_axes: Number of task axes, for messages; None: they do not matter.

    Raises:
        ScenarioError: Naming all missing ports, or the first port of another width.
    """
    CheckIsSystem(name, system)
    wanted_inputs = inputs or {}
    wanted_outputs = outputs or {}
    missing = [f"input {x}" for x in wanted_inputs if not system.HasInputPort(x)]
    missing += [f"output {x}" for x in wanted_outputs if not system.HasOutputPort(x)]
    if missing:
        raise ScenarioError(
            f"{name}: {type(system).__name__} lacks the ports {', '.join(missing)}"
        )
    sizes = {x: (system.GetOutputPort(x).size(), n) for x, n in wanted_outputs.items()}
    for port, wanted in wanted_inputs.items():
        sizes[port] = system.GetInputPort(port).size(), wanted
    for port, (size, wanted) in sizes.items():
        if size != wanted:
            entries = "1 entry" if size == 1 else f"{size} entries"
            reason = f"must have {wanted}"
            if num_axes == wanted:
                axes = "1 axis" if wanted == 1 else f"{wanted} axes"
                reason = f"the task has {axes}"
            raise ScenarioError(f"{name}: {port} has {entries}, {reason}")


def CheckIsSystem(name: str, system: Any) -> None:
    """Refuses what is no system of Drake's, such as a class in its place."""
    if isinstance(system, type):
        called = f"{name}={system.__name__}(...)"
        Refuse(name, system, f"an instance: {called}, not {system.__name__}")
    if not isinstance(system, System):
        Refuse(name, system, "a system of Drake's")


def AsChannel(name: str, system: Any, size: int) -> System:
    """Returns a system as a channel: its ports are `signal` and `delayed_signal`.

    Args:
        name: The argument that holds the system, for messages.
        system: Any system with one input and one output, whatever their names.
        size: Width of the packet.

    Raises:
        ScenarioError: If it has other ports, or they have another width.
    """
    CheckIsSystem(name, system)
    if system.num_input_ports() != 1 or system.num_output_ports() != 1:
        counts = f"{system.num_input_ports()} and {system.num_output_ports()}"
        Refuse(f"{name}: inputs and outputs", counts, "one of each")
    source = system.get_output_port()
    target = system.get_input_port()
    CheckPorts(
        name,
        system,
        inputs={target.get_name(): size},
        outputs={source.get_name(): size},
    )
    if (target.get_name(), source.get_name()) == ("signal", "delayed_signal"):
        return system
    return Wire(
        Diagram(),
        name,
        {"delay": system},
        inputs={"signal": ["delay"]},
        connections={},
        outputs={"delayed_signal": "delay"},
    )
