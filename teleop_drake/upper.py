"""Functions of upper rooms that lower rooms call.

A room is a subpackage of teleop_drake, or a module beside them. A lower room must not
import an upper one. It calls `UpperFunction(name)` instead. The root of the package,
which stands above all rooms, imports each function by its name.
"""

from collections.abc import Callable
from typing import Any

_finders: list[Callable[[str], Any]] = []


def ProvideUpperFunctions(find: Callable[[str], Any]) -> None:
    """Provides the functions of upper rooms.

    Args:
        find: Imports and returns the function that has a name.
    """
    _finders.append(find)


def UpperFunction(name: str) -> Any:
    """Imports and returns a function of an upper room.

    Raises:
        AttributeError: If nothing provides a function of this name.
    """
    return _finders[-1](name)
