"""The Contexts of the systems in a diagram."""

import numpy as np
from pydrake.systems.framework import Context, Diagram, System


def ContextsIn(system: System, context: Context) -> dict[System, Context]:
    """Returns the Context of a system and of every system in it, at any depth.

    System.GetMyContextFromRoot() finds the same ones, but only as long as the diagram
    is no part of another. A Simulator of MakeSimulator() makes it one, and so may a
    user, between two runs of it.

    Args:
        context: Its Context, of which those returned are parts.
    """
    contexts = {system: context}
    if isinstance(system, Diagram):
        for part in system.GetSystems():
            inner = system.GetMutableSubsystemContext(part, context)
            contexts |= ContextsIn(part, inner)
    return contexts


def DiscreteState(context: Context) -> np.ndarray:
    """Returns all discrete states of a Context, one after another."""
    groups = map(context.get_discrete_state, range(context.num_discrete_state_groups()))
    return np.concatenate([np.empty(0), *(x.CopyToVector() for x in groups)])
