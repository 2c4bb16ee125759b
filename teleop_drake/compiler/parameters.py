"""The numbers of all blocks in two arrays, so that every program has one signature."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Parameters:
    """Packs parameters, and says how the generated source unpacks them.

    Equal arrays in one field of a kind of named tuple are one array: what several
    blocks compute from the same plant is computed once.

    Attributes:
        types: The named tuples among them, by their names in the source.
    """

    def __init__(self) -> None:
        self.types: dict[str, Callable[..., Any]] = {}
        self._shared: dict[Any, str] = {}
        self._numbers: list[float] = []
        self._integers: list[int] = []

    def Add(self, value: Any) -> str:
        """Adds a parameter and returns what it is in the source.

        Args:
            value: A number, an array, or a (named) tuple of them.
        """
        if isinstance(value, tuple):
            if not hasattr(value, "_fields"):
                return f"({', '.join(map(self.Add, value))},)"
            fields = enumerate(value)
            parts = ", ".join(self._AddField(type(value), *field) for field in fields)
            return f"{self._NameOf(type(value))}({parts})"
        array = np.asarray(value)
        store: list[Any]
        if array.dtype.kind in "iub":
            name, store = "q", self._integers
        else:
            name, store = "p", self._numbers
        first = len(store)
        store.extend(array.ravel().tolist())
        if array.ndim == 0:
            return f"{name}[{first}]"
        text = f"{name}[{first}:{len(store)}]"
        return text if array.ndim == 1 else f"{text}.reshape({array.shape})"

    def _AddField(self, kind: type, place: int, value: Any) -> str:
        if not isinstance(value, np.ndarray):
            return self.Add(value)
        key = kind, place, value.shape, value.dtype, value.tobytes()
        if key not in self._shared:
            self._shared[key] = self.Add(value)
        return self._shared[key]

    def as_arrays(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Returns the arrays p and q of the source."""
        return np.array(self._numbers, np.float64), np.array(self._integers, np.int64)

    def _NameOf(self, kind: Callable[..., Any]) -> str:
        for name, known in self.types.items():
            if known is kind:
                return name
        name = f"T{len(self.types)}"
        self.types[name] = kind
        return name
