"""The names of a loop's signals: what its systems put out is recorded by them."""

from collections.abc import Iterable

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

# Signals that a loop may lack. Whoever looks at them takes them for those of these
# systems, so that no other one may put out such a name instead.
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

# Of the signals that have a value for each task axis.
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

# Of the parts of packets, by their first letters; u and w are waves.
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


def SignalsOf(diagram: Diagram) -> dict[str, OutputPort]:
    """Returns what is recorded of a diagram, by the names of the signals.

    A loop, or a side of it, with a `robot` that has a tool or with a `master` that has
    an operator, has those of NamedSignals(). Of any other diagram they are the vector
    outputs that it exports or, if it exports none, `system.port` for those of its
    systems.

    Raises:
        ValueError: If there are none.
    """
    systems = diagram.GetSystems()
    marks = {"robot": "tool_velocity", "master": "surgeon_mode"}
    if any(x.HasOutputPort(marks.get(x.get_name(), "")) for x in systems):
        return NamedSignals(systems)
    signals = {port.get_name(): port for port in _VectorOutputs(diagram)} or {
        f"{system.get_name()}.{port.get_name()}": port
        for system in systems
        for port in _VectorOutputs(system)
    }
    if not signals:
        Refuse(f"outputs of {diagram.get_name()}", None, "one vector or more")
    return signals


def _VectorOutputs(system: System) -> list[OutputPort]:
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
        for port in _VectorOutputs(system):
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
