"""Drake's functions of numbers, and some of its types, in followed functions."""

from typing import Any

import numpy as np
from pydrake.systems.framework import (
    AbstractParameterIndex,
    AbstractStateIndex,
    CacheIndex,
    ContinuousStateIndex,
    DiscreteStateIndex,
    InputPortIndex,
    NumericParameterIndex,
    OutputPortIndex,
)

from teleop_drake.loops.jit.traced_numpy import OPERATIONS

Index = (
    AbstractParameterIndex
    | AbstractStateIndex
    | CacheIndex
    | ContinuousStateIndex
    | DiscreteStateIndex
    | InputPortIndex
    | NumericParameterIndex
    | OutputPortIndex
)


def NameOfClass(value: Any) -> str:
    """Returns the name of a class or a template of Drake's; else an empty text."""
    if isinstance(value, type):
        return value.__name__
    return str(value.name) if type(value).__name__ == "TemplateClass" else ""


def wrap_to(value: Any, low: Any, high: Any) -> Any:
    """Returns a number, wrapped to the interval from low to below high."""
    span = high - low
    return value - span * np.floor((value - low) / span)


MATH: dict[str, Any] = {
    **{name: getattr(np, usual) for usual, name in OPERATIONS.items()},
    "abs": abs, "min": min, "max": max, "pow": np.power, "floor": np.floor,
    "ceil": np.ceil, "wrap_to": wrap_to, "inv": np.linalg.inv,
}  # fmt: skip
"""The functions of pydrake.math and their equals, by name."""
