"""Numbers, arrays and named tuples of them as one row of floats, p.

Each value has a layout, by which it is found in a row of floats or of Numbers. Code
is made for layouts: whole numbers are in the code, floats may be exchanged.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_drake.jit.symbolic_arrays import Table


@dataclass(frozen=True)
class Place:
    """A number or an array of floats.

    Attributes:
        first: The index of its first element.
        shape: Its shape; empty: it is a number.
    """

    first: int
    shape: tuple[int, ...]

    def In(self, p: Any) -> Any:
        """Returns the number or the array."""
        end = self.first + math.prod(self.shape)
        return p[self.first : end].reshape(self.shape)[()]


@dataclass(frozen=True)
class Whole:
    """A whole number or an array of them, which belongs to the structure of code."""

    numbers: tuple[int, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def In(self, p: Any) -> Any:
        """Returns the number or the array."""
        return np.array(self.numbers, self.dtype).view(Table).reshape(self.shape)[()]


@dataclass(frozen=True)
class Group:
    """A (named) tuple of numbers, arrays and such tuples."""

    kind: type
    fields: tuple[Any, ...]

    def In(self, p: Any) -> Any:
        """Returns the tuple."""
        values = [field.In(p) for field in self.fields]
        return tuple(values) if self.kind is tuple else self.kind(*values)


Layout = Place | Whole | Group
"""Where a value is."""


class Parameters:
    """Packs the floats of parameters one after another.

    Equal arrays in one field of a kind of named tuple are one array: what several
    blocks compute from the same plant is computed once.

    Attributes:
        numbers: The floats.
    """

    def __init__(self) -> None:
        self.numbers: list[float] = []
        self._shared: dict[Any, Any] = {}

    def Add(self, value: Any) -> Layout:
        """Adds a number, an array, or a (named) tuple of them; returns where it is."""
        if isinstance(value, tuple):
            kind = type(value)
            fields = [self._AddField(kind, i, x) for i, x in enumerate(value)]
            return Group(kind, tuple(fields))
        array = np.asarray(value)
        if array.dtype.kind in "iub":
            return Whole(tuple(array.ravel().tolist()), array.shape, array.dtype)
        first = len(self.numbers)
        self.numbers.extend(array.ravel().tolist())
        return Place(first, array.shape)

    def _AddField(self, kind: type, place: int, value: Any) -> Any:
        if kind is tuple or not isinstance(value, np.ndarray):
            return self.Add(value)
        key = kind, place, value.shape, value.dtype, value.tobytes()
        if key not in self._shared:
            self._shared[key] = self.Add(value)
        return self._shared[key]
