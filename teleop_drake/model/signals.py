"""The names and units of the signals of a loop of the thesis."""

import math
from collections.abc import Iterable

from pydrake.systems.framework import OutputPort, System

from teleop_drake.loops.framework.signals import VectorOutputs
from teleop_drake.loops.framework.validation import Refuse

# Signals whose name differs from the name of their port, by system and port.
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

_LOOP = (
    *("master", "forward_channel", "controller"),
    *("robot", "environment", "return_channel"),
    *("reference", "disturbance"),
)

# The prefixes of units, by the exponent of ten.
_PREFIXES = {-9: "n", -6: "\N{MICRO SIGN}", -3: "m", 0: "", 3: "k", 6: "M"}

# Units of the parts of packets, by their first letters; u and w are waves.
_PART_UNITS = {"p": "m", "x": "m", "v": "m/s", "a": "m/s^2", "F": "N", "E": "J"}
_PART_UNITS |= dict.fromkeys("uw", "√W")


def UnitOf(name: str, size: int = 1) -> str | None:
    """Returns the unit of a signal that has a value for each task axis.

    With six values, the unit of the last three follows: "m, rad".

    Returns:
        The SI unit; None if the signal is no vector of the task space, or if only its
        block defines its meaning.
    """
    unit = _UNITS.get(name)
    return f"{unit}, {_TURNING[unit]}" if unit and size == 6 else unit


def PartUnit(part: str) -> str:
    """Returns the unit of a component of a packet: part and axis, such as `F_h x`."""
    return AxisUnit(_PART_UNITS.get(part[0], ""), part.rpartition(" ")[2])


def AxesOf(num_axes: int) -> tuple[str, ...]:
    """Returns the names of the task axes: x, y, z, and rotations rx, ry, rz."""
    return (*_AXES, *map(str, range(7, num_axes + 1)))[:num_axes]


def AxisUnit(unit: str, axis: str) -> str:
    """Returns the unit along an axis or, for rx, ry and rz, its form for rotations."""
    return _TURNING.get(unit, unit) if axis in _AXES[3:] else unit


def ScaleAndUnit(limits: Iterable[float], unit: str) -> tuple[float, str]:
    """Returns the scale of a range in m, m/s or N, and its unit with an SI prefix."""
    largest = max(map(abs, limits))
    if unit not in ("m", "m/s", "N") or largest == 0:
        return 1.0, unit
    # The largest value is 0.1 to 100 in the unit shown.
    exponent = 3 * min(max(math.floor(math.log10(10 * largest) / 3), -3), 2)
    return 10.0**-exponent, _PREFIXES[exponent] + unit


def NamedSignals(systems: Iterable[System]) -> dict[str, OutputPort]:
    """Returns every vector output of a loop's systems by the name of its signal.

    Args:
        systems: The systems at the top level of the loop. Systems that are neither in
            Fig. 2.1 nor in the tracking, such as meters, may share the name of an
            output; the last of them is returned.

    Raises:
        ValueError: If a port has the name of another system's signal in the loop; the
            message names the port and its system.
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
