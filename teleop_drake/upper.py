"""Functions of upper rooms that lower rooms call.

A lower room must not import an upper one. It calls `UpperFunction(name)` instead. The
root of the package, which stands above all rooms, provides each function together with
the import that loads it at the first call.
"""

from collections.abc import Callable
from typing import Any

_loaders: dict[str, Callable[[], Callable[..., Any]]] = {}


def ProvideUpperFunction(name: str, load: Callable[[], Callable[..., Any]]) -> None:
    """Provides a function of an upper room; a second one of its name replaces it.

    Args:
        name: The name by which lower rooms call it.
        load: Imports the function and returns it.
    """
    _loaders[name] = load


def UpperFunction(name: str) -> Callable[..., Any]:
    """Returns a function of an upper room, which is imported now.

    Raises:
        KeyError: If nothing provides a function of this name.
    """
    return _loaders[name]()
