"""Labels of the numbers of a scenario in figures: names, values and units."""

from collections.abc import Sequence
from typing import Any

from teleop_drake.model.signals import AxesOf
from teleop_drake.study.sweep.statistics import CONTROLLERS

# Keys of a sweep that are delays.
DELAYS = ("delay", "forward_delay", "return_delay")

# Units of the numbers of a scenario, with the last parts of the keys that have them.
# Gains whose unit depends on the architecture are left out.
_NAMES_BY_UNIT = {
    "s": "delay forward_delay return_delay sample_period std minimum depth duration "
    "stop_time max_step_size",
    "m": "start reference",
    "kg": "mass",
    "1/s": "G1 G2",
    "1/kg": "initial_psi minimum_psi",
    "N": "contact_force force_limit coulomb_friction",
    "N/m": "stiffness",
    "N s/m": "damping viscous_friction",
    "m/s": "velocity friction_speed",
    "rad": "phase",
    "rad/s": "frequency bandwidth",
    "s/s": "drift",
    "packets": "burst_length",
}
_UNITS = {x: unit for unit, names in _NAMES_BY_UNIT.items() for x in names.split()}


def _NameAndUnit(key: str) -> tuple[str, str]:
    """Returns the name of a key of a scenario in words, and its unit or ""."""
    if key in DELAYS:
        return ("delay each way" if key == "delay" else key.replace("_", " ")), "s"
    parts = key.split(".")
    last = parts[-2] if parts[-1].isdecimal() and len(parts) > 1 else parts[-1]
    # An element of a vector is named after its axis.
    names = [
        AxesOf(6)[int(part)] if part.isdecimal() and int(part) < 6 else part
        for part in parts[-2:]
    ]
    return " ".join(names).replace("_", " "), _UNITS.get(last, "")


def AxisLabel(key: str) -> str:
    """Returns the axis label of a key of a scenario: its name and unit."""
    name, unit = _NameAndUnit(key)
    return f"{name} [{unit}]" if unit else name


def IsNumber(value: Any) -> bool:
    """Returns whether a value is a number; a Boolean is not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def ValueLabel(value: Any) -> str:
    """Returns a value of a scenario as text for a figure."""
    text = f"{value:g}" if IsNumber(value) else str(value).replace("_", " ")
    # Matplotlib reads text between two dollars as a formula.
    return text.replace("$", r"\$")


def LabelOfValue(key: str, value: Any) -> str:
    """Returns the legend entry of a value of a key: name, value and unit.

    A controller has its name only.
    """
    if key in CONTROLLERS:
        return ValueLabel(value)
    name, unit = _NameAndUnit(key)
    return f"{name} = {ValueLabel(value)} {unit}".strip()


def ShortLabels(labels: Sequence[str]) -> list[str]:
    """Returns labels of one key with the name of the key in the first one only.

    "delay = 0.1 s", "delay = 0.2 s" become "delay = 0.1 s", "0.2 s". Other labels are
    returned unchanged.
    """
    parts = [label.split(" = ") for label in labels]
    names = {name for name, *_ in parts}
    if len(names) != 1 or any(len(part) != 2 for part in parts):
        return list(labels)
    return [labels[0], *(value for _, value in parts[1:])]
