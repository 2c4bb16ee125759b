"""The contents of mutable values: to detect changes, and to restore the values."""

import contextlib
import functools
import itertools
import pickle
import random
import sys
from types import (
    BuiltinFunctionType,
    CellType,
    CodeType,
    FunctionType,
    MethodType,
    ModuleType,
)
from typing import Any

import numpy as np

from teleop_drake.jit.symbols import Number


class Opaque:
    """A base class for values whose contents are not examined."""


class Contents:
    """A copy of the present contents of mutable values.

    Attributes:
        arrays: The arrays that contain Numbers.
    """

    def __init__(self, value: Any):
        self.arrays: list[Any] = []
        self._known: dict[int, tuple[Any, tuple[Any, ...]]] = {}
        pending = [value]
        while pending:
            value = pending.pop()
            parts = () if id(value) in self._known else _Parts(value)
            if parts:
                self._known[id(value)] = value, parts
                if isinstance(value, np.ndarray) and parts[0] is _OBJECTS:
                    self.arrays.append(value)
                else:
                    pending += parts

    def Shares(self, value: Any) -> bool:
        """Returns whether a value is one of these, or shares memory with one."""
        return any(AreShared(value, x) for x, _ in self._known.values())

    def Changed(self, with_numbers: bool = True) -> bool:
        """Returns whether anything has changed, or what has no Numbers in it."""
        arrays = {} if with_numbers else {id(array) for array in self.arrays}
        return any(
            not _AreSame(parts, _Parts(value))
            for i, (value, parts) in self._known.items()
            if i not in arrays
        )

    def Restore(self) -> None:
        """Restores the former contents of all values that can be restored."""
        for value, parts in self._known.values():
            _Restore(value, parts)


_OBJECTS = object()
_PLAIN = str, bytes, int, float, complex, type(None)

# Packages whose classes do not change.
_FOREIGN = "numpy", "pydrake"


def _Parts(value: Any) -> tuple[Any, ...]:
    """Returns the parts of a value; none if the value is immutable."""
    # Arrays and containers.
    if isinstance(value, np.ndarray):
        plain = np.asarray(value)
        if plain.dtype == object:
            return _OBJECTS, *plain.flat
        return plain.tobytes(), plain.dtype
    if isinstance(value, dict):
        return dict, *itertools.chain.from_iterable(value.items())
    if isinstance(value, (tuple, list, set)):
        return type(value), *value
    # A function has the values in its closure, its defaults and its attributes.
    if isinstance(value, FunctionType):
        cells = [x.cell_contents for x in value.__closure__ or () if x != CellType()]
        outside = value.__defaults__, value.__kwdefaults__, vars(value)
        return FunctionType, *cells, *outside
    if isinstance(value, (MethodType, BuiltinFunctionType)):
        return MethodType, value.__self__
    if isinstance(value, (Opaque, Number, ModuleType, CodeType, *_PLAIN)):
        return ()
    # A user's class has its attributes, without methods.
    if isinstance(value, type):
        package = value.__module__.split(".")[0]
        if package in sys.stdlib_module_names or package in _FOREIGN:
            return ()
        own = [
            (name, x)
            for name, x in vars(value).items()
            if not (name.startswith("__") or callable(x))
        ]
        return type, *itertools.chain.from_iterable(own)
    # Other objects have attributes or, if they are written in C, a pickle.
    slots = [getattr(value, x) for x in _Slots(value.__class__) if hasattr(value, x)]
    attributes = getattr(value, "__dict__", None)
    if isinstance(attributes, dict) and not isinstance(value, random.Random):
        return type(value), attributes, *slots
    if slots:
        return type(value), *slots
    with contextlib.suppress(Exception):
        return (pickle.dumps(value),)
    return ()


def _Restore(value: Any, parts: tuple[Any, ...]) -> None:
    """Restores a value from its parts, if its type is mutable."""
    kind, *items = parts
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            old = items if kind is _OBJECTS else np.frombuffer(*parts)
            np.asarray(value)[...] = Reshaped(old, value.shape)
    elif isinstance(value, list):
        value[:] = items
    elif isinstance(value, set):
        value.clear()
        value.update(items)
    elif isinstance(value, dict):
        value.clear()
        value.update(zip(items[::2], items[1::2], strict=True))
    elif isinstance(value, type):
        for name, attribute in zip(items[::2], items[1::2], strict=True):
            setattr(value, name, attribute)


@functools.cache
def _Slots(kind: type) -> tuple[str, ...]:
    names = [vars(base).get("__slots__", ()) for base in kind.__mro__]
    return tuple(x for s in names for x in ((s,) if isinstance(s, str) else s))


def _AreSame(before: tuple[Any, ...], after: tuple[Any, ...]) -> bool:
    return len(before) == len(after) and all(
        a is b or (isinstance(a, bytes) and a == b)
        for a, b in zip(before, after, strict=True)
    )


def AreShared(a: Any, b: Any) -> bool:
    """Returns whether two values are one, or arrays that may share elements."""
    are_arrays = isinstance(a, np.ndarray) and isinstance(b, np.ndarray)
    return a is b or (are_arrays and np.may_share_memory(np.asarray(a), np.asarray(b)))


def Reshaped(values: Any, shape: tuple[int, ...]) -> Any:
    """Returns an array of objects."""
    array = np.empty(len(values), object)
    array[:] = values
    return array.reshape(shape)
