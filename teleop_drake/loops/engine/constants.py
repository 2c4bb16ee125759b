"""The numbers that systems of Drake keep as constants, not in their Contexts.

Drake cannot change these numbers of a system that has been made. A compiled run can: it
takes the kernel of a new system that has other constants.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import System
from pydrake.systems.primitives import (
    AffineSystem,
    Gain,
    LinearSystem,
    MatrixGain,
    Saturation,
)

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.signals import IsOfDrake, IsPlainLeaf, NameOf
from teleop_drake.loops.framework.validation import ScenarioError

ConstantValues = Mapping[System, Mapping[str, Array]]
"""Other values of constants, by system and name."""


class _Constants(NamedTuple):
    """The constants of a class of systems.

    Attributes:
        read: Returns the values of a system's constants, by their names.
        make: Makes a system of the class from a system and the values of constants.
    """

    read: Callable[[Any], dict[str, Array]]
    make: Callable[..., System]


def ConstantsOf(system: System) -> dict[str, Array]:
    """Returns the constants of a system by their names; empty if none can change."""
    if IsPlainLeaf(system):
        return _SlidersOf(system)
    kind = _KINDS.get(type(system).__name__) if IsOfDrake(system) else None
    return {} if kind is None else kind.read(system)


def _SlidersOf(system: System) -> dict[str, Array]:
    """Returns the values of the sliders of each Meshcat that a user's block keeps."""
    return {
        name: np.array(meshcat.GetSliderValue(name))
        for meshcat in vars(system).values()
        if isinstance(meshcat, Meshcat)
        for name in meshcat.GetSliderNames()
    }


def WithConstants(system: System, values: Mapping[str, Array]) -> System:
    """Returns a new system with other constants, or the system if there are none.

    Args:
        system: The system.
        values: New values of some of its constants, by their names.

    Raises:
        ScenarioError: If Drake does not allow the values.
    """
    if not values:
        return system
    kind = _KINDS[type(system).__name__]
    try:
        return kind.make(system, **{**kind.read(system), **values})
    except (RuntimeError, SystemExit) as error:
        names = ", ".join(f"{NameOf(system)}.{name}" for name in values)
        given = [value.tolist() for value in values.values()]
        reason = str(error).splitlines()[0]
        raise ScenarioError(f"{names} = {given}: refused by Drake: {reason}") from error


def _OutputAt(system: Any, value: float) -> Array:
    """Returns the output of a system at an input, each element of which is `value`."""
    context = system.CreateDefaultContext()
    port = system.get_input_port()
    port.FixValue(context, np.full(port.size(), value))
    output: Array = system.get_output_port().Eval(context)
    return output


def _GainsOf(system: Gain) -> dict[str, Array]:
    return {"k": _OutputAt(system, 1.0)}


def _LimitsOf(system: Saturation) -> dict[str, Array]:
    return {
        "min_value": _OutputAt(system, -np.inf),
        "max_value": _OutputAt(system, np.inf),
    }


def _GainsOfPid(system: Any) -> dict[str, Array]:
    gains = {
        "kp": system.get_Kp_vector(),
        "ki": system.get_Ki_vector(),
        "kd": system.get_Kd_vector(),
    }
    # pydrake does not bind the matrices that select the controlled states and inputs.
    num_states = system.get_input_port_estimated_state().size()
    num_outputs = system.get_output_port_control().size()
    n = len(gains["kp"])
    return gains if (num_states, num_outputs) == (2 * n, n) else {}


def _MatricesOf(names: Iterable[str]) -> Callable[[Any], dict[str, Array]]:
    """Returns the function that reads matrices of a system; empty ones are left out."""

    def Read(system: Any) -> dict[str, Array]:
        matrices = {name: np.array(getattr(system, name)()) for name in names}
        return {name: matrix for name, matrix in matrices.items() if matrix.size}

    return Read


# Keyed by the name of Drake's class.
_KINDS: dict[str, _Constants] = {
    "Gain": _Constants(_GainsOf, lambda _, k: Gain(k)),
    "Saturation": _Constants(
        _LimitsOf, lambda _, min_value, max_value: Saturation(min_value, max_value)
    ),
    "PidController": _Constants(_GainsOfPid, lambda system, **x: type(system)(**x)),
    "MatrixGain": _Constants(_MatricesOf(["D"]), lambda _, D: MatrixGain(D)),
    "LinearSystem": _Constants(
        _MatricesOf(["A", "B", "C", "D"]),
        lambda system, **x: LinearSystem(**x, time_period=system.time_period()),
    ),
    "AffineSystem": _Constants(
        _MatricesOf(["A", "B", "f0", "C", "D", "y0"]),
        lambda system, **x: AffineSystem(**x, time_period=system.time_period()),
    ),
}
