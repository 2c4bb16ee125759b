"""The names of a loop's signals: what its systems put out is recorded by them."""

import itertools
import re
import weakref
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from pydrake.systems.framework import Diagram, OutputPort, PortDataType, System

from teleop_drake.validation import Refuse

# A port's own name, but for these.
_NAMES = {
    ("master", "forward_packet"): "forward_packet_sent",
    ("forward_channel", "delayed_signal"): "forward_packet_received",
    ("controller", "return_packet"): "return_packet_sent",
    ("return_channel", "delayed_signal"): "return_packet_received",
    ("environment", "layer"): "environment_layer",
    ("hold", "sum"): "applied_force",
}

# Signals that a loop may lack, and the systems to which they belong. No other system
# may have an output of such a name.
_OWNERS = {
    **dict.fromkeys(
        (
            "velocity_command",
            "force_command",
            "felt_position",
            "felt_velocity",
            "surgeon_mode",
        ),
        "master",
    ),
    **dict.fromkeys(
        ("tool_acceleration", "joint_position", "joint_velocity", "joint_torque"),
        "robot",
    ),
    "environment_layer": "environment",
}

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_TURNING = {"m": "rad", "m/s": "rad/s", "m/s^2": "rad/s^2", "N": "N m"}

# Units of the signals that have a value for each task axis.
_UNITS = {
    **dict.fromkeys(("tool_position", "felt_position", "desired_position"), "m"),
    **dict.fromkeys(
        ("tool_velocity", "felt_velocity", "velocity_command", "desired_velocity"),
        "m/s",
    ),
    **dict.fromkeys(("tool_acceleration", "desired_acceleration"), "m/s^2"),
    **dict.fromkeys(("environment_force", "control_force", "force_command"), "N"),
    "disturbance_estimate": "N",
}

# Units of the parts of packets, by their first letters; u and w are waves.
_PART_UNITS = {"p": "m", "x": "m", "v": "m/s", "a": "m/s^2", "F": "N", "E": "J"}
_PART_UNITS |= dict.fromkeys("uw", "√W")


def UnitOf(name: str, size: int = 1) -> str | None:
    """Returns the unit of a signal that has a value for each task axis.

    Of six values, the unit of the last three comes after it: "m, rad".

    Returns:
        The SI unit; None for a signal that is no vector of the task space, or of which
        only its block knows what it is.
    """
    unit = _UNITS.get(name)
    return f"{unit}, {_TURNING[unit]}" if unit and size == 6 else unit


def PartUnit(part: str) -> str:
    """Returns the unit of a part of a packet along an axis, such as F_h x."""
    return AxisUnit(_PART_UNITS.get(part[0], ""), part.rpartition(" ")[2])


def AxesOf(num_axes: int) -> tuple[str, ...]:
    """Returns the names of the task axes: x, y, z, and rx, ry, rz about them."""
    return (*_AXES, *map(str, range(7, num_axes + 1)))[:num_axes]


def AxisUnit(unit: str, axis: str) -> str:
    """Returns the unit of a signal along an axis, or of one about it."""
    return _TURNING.get(unit, unit) if axis in _AXES[3:] else unit


_LOOP = (
    *("master", "forward_channel", "controller"),
    *("robot", "environment", "return_channel"),
    *("reference", "disturbance"),
)


# The systems from which the package, or a scenario's run, has made a loop.
_in_loops: weakref.WeakSet[System] = weakref.WeakSet()

# The name that Drake gives to a system without one, as drake/systems/Adder@0000a1b2.
_ADDRESS = re.compile(r"@[0-9a-f]{8,}$")


def MarkLoop(systems: Iterable[System]) -> None:
    """Marks systems as those of a loop, whose signals have the names of NamedSignals().

    What a Diagram is follows from this mark, never from the names of its systems.
    """
    _in_loops.update(systems)


def SignalsOf(system: System) -> dict[str, OutputPort]:
    """Returns the signals that are recorded of a system, by name.

    A loop that was made by this package, or a side of it, has those of NamedSignals().
    For any other system they are its vector outputs or, for a Diagram that exports
    none, all vector outputs of its systems, named `system.port`. A system without a
    name is called by its class, with a number if there are several.

    Raises:
        ValueError: If there are none.
    """
    parts: list[System] = system.GetSystems() if isinstance(system, Diagram) else []
    if not _in_loops.isdisjoint(parts):
        return NamedSignals(parts)
    signals = {port.get_name(): port for port in VectorOutputs(system)} or {
        f"{name}.{port.get_name()}": port
        for part, name in zip(parts, NamesOf(parts), strict=True)
        for port in VectorOutputs(part)
    }
    if not signals:
        Refuse(f"outputs of {NameOf(system)}", None, "one vector or more")
    return signals


def NameOf(system: System) -> str:
    """Returns the name of a system, or that of its class if it has none."""
    return str(system.get_name()) if _HasName(system) else type(system).__name__


def PathsIn(system: System, path: str = "") -> Iterator[tuple[System, str]]:
    """Yields a system and all systems in it, each with its path as `robot/plant`.

    A system without a name is called by its class, as in SignalsOf().
    """
    yield system, path
    if isinstance(system, Diagram):
        parts = system.GetSystems()
        for part, name in zip(parts, NamesOf(parts), strict=True):
            own = name.replace("/", "_")
            yield from PathsIn(part, f"{path}/{own}" if path else own)


def SystemsByPath(system: System, path: str = "") -> dict[str, System]:
    """Returns a system and all systems in it by their paths; see PathsIn()."""
    return {own: part for part, own in PathsIn(system, path)}


def _HasName(system: System) -> bool:
    name = system.get_name()
    return bool(name) and not _ADDRESS.search(name)


def NamesOf(systems: Sequence[System]) -> list[str]:
    """Returns a name of each system; of those without one, several are numbered."""
    taken = {system.get_name() for system in systems}
    classes = Counter(NameOf(system) for system in systems if not _HasName(system))
    names = []
    for system in systems:
        name = NameOf(system)
        if not _HasName(system) and (classes[name] > 1 or name in taken):
            numbered = (f"{name}{k}" for k in itertools.count(1))
            name = next(x for x in numbered if x not in taken)
        taken.add(name)
        names.append(name)
    return names


def VectorOutputs(system: System) -> list[OutputPort]:
    """Returns the output ports of a system that are vectors."""
    ports = map(system.get_output_port, range(system.num_output_ports()))
    return [x for x in ports if x.get_data_type() == PortDataType.kVectorValued]


def NamedSignals(systems: Iterable[System]) -> dict[str, OutputPort]:
    """Returns every vector output of a loop's systems by the name of its signal.

    Args:
        systems: Those at the top level of the loop. Of those that are no part of
            Fig. 2.1 or of the tracking, a meter say, the last one has a name that
            several put out.

    Raises:
        ValueError: If a port has the name of a signal of the loop that is not its own;
            it says which port of which system.
    """
    signals: dict[str, OutputPort] = {}
    for system in systems:
        for port in VectorOutputs(system):
            block = system.get_name()
            own = port.get_name()
            name = _NAMES.get((block, own), own)
            owner = _OWNERS.get(name, block)
            if name in signals:
                owner = signals[name].get_system().get_name()
            if owner != block and not {owner, block}.isdisjoint(_LOOP):
                Refuse(
                    f"output port of {block}",
                    own,
                    f"another name, because the signal {name!r} is that of {owner}",
                )
            signals[name] = port
    return signals
