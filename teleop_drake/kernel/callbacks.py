"""Callbacks that do not keep alive whose they are."""

import weakref
from collections.abc import Callable
from typing import Any


def Weakly(method: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a bound method as a function that does not keep its object alive.

    Drake keeps the functions of a witness or a cache entry where Python's garbage
    collector does not see them, so a system that hands in its own methods is never
    collected, nor the Diagram that it is in. Drake calls them only while the system
    lives.

    Args:
        method: A method of an object.
    """
    reference = weakref.WeakMethod(method)

    def Call(*arguments: Any) -> Any:
        alive = reference()
        assert alive is not None
        return alive(*arguments)

    return Call
