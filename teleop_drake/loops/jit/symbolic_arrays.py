"""Arrays of symbolic numbers."""

from typing import Any

import numpy as np

from teleop_drake.loops.jit.symbols import (
    AsBoolean,
    AsReal,
    AsWhole,
    CheckPrecision,
    Dispatched,
    IsBoolean,
    IsSame,
    KindOf,
    Number,
    Rounded,
    Untraceable,
)
from teleop_drake.loops.jit.tables import SHORTEST, Lookup


class Table(np.ndarray):
    """An array that can be indexed by a Number, or masked by symbolic booleans."""

    def __getitem__(self, key: Any) -> Any:
        keys = key if isinstance(key, tuple) else (key,)
        if any(isinstance(item, Number) for item in keys):
            return self._Selected(keys)
        return super().__getitem__(_Masked(key))

    def _Selected(self, keys: tuple[Any, ...]) -> Any:
        """Returns the row at an index that is a Number; nan if it is out of bounds.

        Args:
            keys: The index, and plain indices within the row.
        """
        index, *others = keys
        is_number = isinstance(index, Number) and not IsBoolean(index)
        if not is_number:
            raise Untraceable("an index behind another one depends on numbers")
        plain = np.asarray(self)
        if plain.dtype.kind in "iu" and plain.dtype != np.int64:
            raise Untraceable("an element of whole numbers of a few bits")
        index = AsReal(index)
        index = Where(index < 0.0, index + float(len(self)), index)
        if len(self) >= SHORTEST and plain.dtype == object:
            found = Lookup(plain[(slice(None), *others)], index)
            if found is not None:
                return Result(found)
        rows = [self[(i, *others)] for i in range(len(self))]
        result: Any = np.nan
        for i in reversed(range(len(rows))):
            result = Where(index == float(i), rows[i], result)
        if plain.dtype == np.int64 and isinstance(result, Number):
            return AsWhole(result)
        return result


def _Masked(key: Any) -> Any:
    """Returns an index in which each symbolic boolean is replaced by its truth.

    For each truth value, the function is traced separately; see tracing.
    """
    if isinstance(key, tuple):
        return tuple(_Masked(item) for item in key)
    if not HasNumbers(key):
        return key
    items = Objects(key)
    if not all(map(IsBoolean, items.flat)):
        raise Untraceable("an array of indices depends on numbers")
    return np.array([bool(x) for x in items.flat], bool).reshape(items.shape)


def _NoType(array: Any) -> Any:
    raise Untraceable("it reads the type, the memory or the order of numbers")


class Numbers(Dispatched, Table):
    """An array of `Number`s."""

    dtype = astype = tobytes = data = base = property(_NoType)
    sort = argsort = partition = argpartition = property(_NoType)
    argmax = argmin = searchsorted = property(_NoType)

    def __setitem__(self, key: Any, value: Any) -> None:
        """Writes elements; a symbolic mask selects by Where()."""
        keys = key if isinstance(key, tuple) else (key,)
        if any(isinstance(item, Number) for item in keys):
            raise Untraceable("it writes at an index that depends on numbers")
        if HasNumbers(key) and np.shape(key) == self.shape and np.ndim(value) == 0:
            value = Where(key, value, self)
            key = ...
        key = _Masked(key)
        old = _Kinds(Objects(np.asarray(self)[key]))
        new = _Kinds(Objects(value))
        # An array keeps its kind: booleans, whole numbers or floats.
        if bool in old:
            if new != {bool}:
                raise Untraceable("it writes numbers where booleans were")
        elif int in old:
            if float in new:
                raise Untraceable("it writes numbers where whole numbers were")
        else:
            value = REAL(Objects(value))
        super().__setitem__(key, value)


def _Kinds(array: Any) -> set[type]:
    return set(map(KindOf, array.flat))


REAL = np.frompyfunc(AsReal, 1, 1)
"""Returns an array of objects with AsReal() of each element."""

BOOLEAN = np.frompyfunc(AsBoolean, 1, 1)
"""Returns an array of objects with AsBoolean() of each element."""


def Objects(value: Any) -> Any:
    """Returns a value as a plain array of objects."""
    CheckPrecision(value)
    # The operators of numpy's own numbers would call numpy's functions.
    if isinstance(value, np.generic):
        value = value.item()
    return np.asarray(np.asarray(value, object))


def AsNumbers(value: Any) -> Numbers:
    """Returns an array as one into which Numbers can be written."""
    CheckPrecision(value)
    return np.asarray(value, object).view(Numbers)


def Result(value: Any) -> Any:
    """Returns a result of numpy whose arrays of objects are converted to Numbers."""
    if isinstance(value, (tuple, list)):
        return type(value)(Result(item) for item in value)
    if not isinstance(value, np.ndarray) or value.dtype != object:
        return value
    return AsNumbers(value) if value.ndim else value.item()


def Unified(array: Any) -> Any:
    """Returns an array whose elements are all booleans, whole numbers or floats.

    A mixed array becomes a copy with floats; any other array is returned unchanged.
    """
    if not isinstance(array, Numbers) or len(_Kinds(array)) < 2:
        return array
    return AsFloats(array)


def AsFloats(array: Any) -> Numbers:
    """Returns a copy of an array with all booleans and whole numbers as floats."""
    return AsNumbers(REAL(np.asarray(array)))


def HasNumbers(value: Any) -> bool:
    """Returns whether a value is a Number or may contain one."""
    if isinstance(value, np.ndarray):
        return isinstance(value, Numbers) or bool(value.dtype == object)
    if isinstance(value, dict):
        return any(map(HasNumbers, value.values()))
    if isinstance(value, (list, tuple, set)):
        return any(map(HasNumbers, value))
    return isinstance(value, Number)


def Where(condition: Any, a: Any, b: Any) -> Any:
    """Returns a where a condition holds and b elsewhere, element by element."""
    if any(isinstance(item, (np.ndarray, list, tuple)) for item in (condition, a, b)):
        return Unified(Result(_WHERE(*map(Objects, (condition, a, b)))))
    if not isinstance(condition, Number):
        return a if condition else b
    if IsSame(a, b):
        return a
    condition = AsBoolean(condition)
    result = condition.graph.Add("select", condition, AsReal(a), AsReal(b))
    kinds = {KindOf(a), KindOf(b)}
    if kinds == {bool}:
        return AsBoolean(result)
    if float in kinds:
        return result
    rounded = condition.graph.Add("select", condition, Rounded(a), Rounded(b))
    return AsWhole(result, None if rounded.ref == result.ref else rounded)


_WHERE = np.frompyfunc(Where, 3, 1)
