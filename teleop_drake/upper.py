"""Functions of upper rooms that lower rooms call.

A room is a subpackage of teleop_drake, or a module beside them. A lower room must not
import an upper one. It calls `UpperFunction(name)` instead. The root of the package,
which stands above all rooms, provides each function together with its import.
"""

from collections.abc import Callable
from typing import Any

_loaders: dict[str, Callable[[], Callable[..., Any]]] = {}


def ProvideUpperFunction(name: str, load: Callable[[], Callable[..., Any]]) -> None:
    """Provides a function of an upper room; it replaces a function of the same name.

    Args:
        name: The name by which lower rooms call it.
        load: Imports the function and returns it.
    """
    _loaders[name] = load


def UpperFunction(name: str) -> Callable[..., Any]:
    """Imports and returns a function of an upper room.

    Raises:
        KeyError: If nothing provides a function of this name.
    """
    return _loaders[name]()
