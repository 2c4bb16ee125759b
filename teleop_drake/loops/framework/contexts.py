"""The Contexts of the systems in a diagram."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from teleop_drake.loops.framework.arrays import Array


def ContextsIn(system: Any, context: Any) -> dict[Any, Any]:
    """Returns the Context of a system and of every system in it, at any depth.

    System.GetMyContextFromRoot() finds the same Contexts, but only while the diagram is
    not part of another Diagram. A user may add it to one between two runs.

    Args:
        system: A System of any scalar type.
        context: The Context of the system, which contains all others.

    Returns:
        The Context of each System, keyed by the System; a Diagram precedes its parts.
    """
    contexts = {system: context}
    if hasattr(system, "GetSystems"):  # A Diagram.
        for part in system.GetSystems():
            inner = system.GetMutableSubsystemContext(part, context)
            contexts |= ContextsIn(part, inner)
    return contexts


def DiscreteState(context: Context) -> Array:
    """Returns the discrete states of a Context, concatenated over its groups."""
    groups = map(context.get_discrete_state, range(context.num_discrete_state_groups()))
    return np.concatenate([np.empty(0), *(x.CopyToVector() for x in groups)])


def SetDiscreteState(context: Context, values: Array) -> None:
    """Sets the discrete states of a Context from values concatenated over its groups.

    Does nothing if `values` is empty.
    """
    if len(values) == 0:
        return
    first = 0
    for i in range(context.num_discrete_state_groups()):
        end = first + context.get_discrete_state(i).size()
        context.SetDiscreteState(i, values[first:end])
        first = end
