"""Packs numbers, arrays and named tuples of them into one vector of floats, p.

The layout of a value describes its place in p. It reads the value from a vector of
floats or of Numbers. Code is compiled for layouts: whole numbers become constants of
the code, and floats in p may change without a new compilation.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_drake.loops.jit.symbolic_arrays import Table


@dataclass(frozen=True)
class Place:
    """The layout of a float or an array of floats.

    Attributes:
        first: The index of its first element in p.
        shape: Its shape; empty for a number.
    """

    first: int
    shape: tuple[int, ...]

    def In(self, p: Any) -> Any:
        """Returns the number or the array."""
        end = self.first + math.prod(self.shape)
        return p[self.first : end].reshape(self.shape)[()]


@dataclass(frozen=True)
class Whole:
    """The layout of a whole number or an array of them: the numbers themselves."""

    numbers: tuple[int, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def In(self, p: Any) -> Any:
        """Returns the number or the array."""
        return np.array(self.numbers, self.dtype).view(Table).reshape(self.shape)[()]


@dataclass(frozen=True)
class Group:
    """The layout of a (named) tuple of numbers, arrays and such tuples."""

    kind: type
    fields: tuple[Any, ...]

    def In(self, p: Any) -> Any:
        """Returns the tuple."""
        make = getattr(self.kind, "_make", tuple)
        return make(field.In(p) for field in self.fields)


Layout = Place | Whole | Group
"""The place of a value in p."""


def repack(layouts: Sequence[Layout], values: Sequence[Any], size: int) -> Any:
    """Returns the vector p of other values in the same layouts.

    Args:
        layouts: The layouts from Parameters.Add().
        values: The other values, in the order of the layouts.
        size: The length of p.

    Returns:
        p (size,); None if a value does not fit its layout, or if two values that share
        a place differ.
    """
    p = np.zeros(size)
    is_set = np.zeros(size, bool)
    for layout, value in zip(layouts, values, strict=True):
        if not _put(layout, value, p, is_set):
            return None
    return p


def _put(layout: Layout, value: Any, p: Any, is_set: Any) -> bool:
    """Writes a value to its place in p; returns whether it fits.

    Args:
        is_set: Whether each element of p has been written, which is noted.
    """
    if isinstance(layout, Group):
        kind: type = value.__class__
        if kind is not layout.kind or len(value) != len(layout.fields):
            return False
        return all(
            _put(field, x, p, is_set)
            for field, x in zip(layout.fields, value, strict=True)
        )
    if isinstance(value, tuple):
        return False
    array = np.asarray(value)
    if isinstance(layout, Whole) or array.dtype.kind in "iub":
        return layout == Parameters().Add(array)
    if array.shape != layout.shape:
        return False
    part = slice(layout.first, layout.first + array.size)
    numbers = array.ravel().astype(float)
    if is_set[part].any():
        return bool(p[part].tobytes() == numbers.tobytes())
    p[part] = numbers
    is_set[part] = True
    return True


class Parameters:
    """Packs the floats of parameters one after another.

    Equal arrays in the same field of the same type of named tuple share one place.
    Results that several blocks compute from the same plant are then computed once.

    Attributes:
        numbers: The floats, which become p.
    """

    def __init__(self) -> None:
        self.numbers: list[float] = []
        self._shared: dict[Any, Any] = {}

    def Add(self, value: Any) -> Layout:
        """Adds a number, an array, or a (named) tuple of them; returns its layout."""
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
