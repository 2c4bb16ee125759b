"""The Contexts of the systems in a diagram."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from teleop_drake.arrays import Array


def ContextsIn(system: Any, context: Any) -> dict[Any, Any]:
    """Returns the Context of a system and of every system in it, at any depth.

    System.GetMyContextFromRoot() finds the same ones, but only as long as the diagram
    is no part of another. A user may make it one between two runs of it.

    Args:
        system: A System of any scalar type.
        context: Its Context, of which those returned are parts.

    Returns:
        The Context (Context) of each system (System), in the order of the systems.
    """
    contexts = {system: context}
    if hasattr(system, "GetSystems"):  # A Diagram.
        for part in system.GetSystems():
            inner = system.GetMutableSubsystemContext(part, context)
            contexts |= ContextsIn(part, inner)
    return contexts


def DiscreteState(context: Context) -> Array:
    """Returns all discrete states of a Context, one after another."""
    groups = map(context.get_discrete_state, range(context.num_discrete_state_groups()))
    return np.concatenate([np.empty(0), *(x.CopyToVector() for x in groups)])


def SetDiscreteState(context: Context, values: Array) -> None:
    """Sets all discrete states of a Context, which stand one after another.

    Does nothing if there are no values.
    """
    if len(values) == 0:
        return
    first = 0
    for i in range(context.num_discrete_state_groups()):
        end = first + context.get_discrete_state(i).size()
        context.SetDiscreteState(i, values[first:end])
        first = end
