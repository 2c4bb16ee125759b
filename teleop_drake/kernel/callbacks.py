"""Callbacks that do not keep their owner alive."""

import inspect
import weakref
from collections.abc import Callable
from typing import Any


def Weakly(function: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function that calls another one and does not keep it alive.

    Drake keeps the functions of a witness or a cache entry where Python's garbage
    collector does not see them, so a system that hands in its own methods is never
    collected, nor the Diagram that it is in. Drake calls them only while the system
    lives.

    Args:
        function: A method of the system, or a function that the system keeps.
    """
    is_method = inspect.ismethod(function)
    reference = (weakref.WeakMethod if is_method else weakref.ref)(function)

    def Call(*arguments: Any) -> Any:
        alive = reference()
        assert alive is not None
        return alive(*arguments)

    return Call
