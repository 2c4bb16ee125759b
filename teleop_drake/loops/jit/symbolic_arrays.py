"""Arrays of symbolic numbers, tables in memory, and functions of numpy on both.

A table is a long array of parameters. A short array is searched and indexed by
comparing with each element. A table that lies in the parameters p at equal distances is
searched by bisection where it lies, so that the code does not grow with its length.
"""

import math
from collections.abc import Sequence
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

SHORTEST = 32
"""The least number of elements of a table; shorter arrays are compared one by one."""


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


def Search(table: Any, x: Any, side: str) -> Any:
    """Returns np.searchsorted() of a table in memory; None if it is none."""
    place = _PlaceOf(np.asarray(table, dtype=object).tolist())
    if place is None or place[1] != 1 or not isinstance(x, Number):
        return None
    operation = "search_right" if side == "right" else "search_left"
    return x.graph.Add(operation, place[0], len(table), x)


def Lookup(rows: Any, index: Number) -> Any:
    """Returns rows[index], nan out of bounds; None if it is no table in memory.

    Args:
        rows: The rows, an array of objects (N, ...).
        index: The index as a float.
    """
    columns = rows.reshape(len(rows), -1).T.tolist()
    places = [_PlaceOf(column) for column in columns]
    if not places or any(place is None for place in places):
        return None
    found = [
        index.graph.Add("lookup", first, distance, len(rows), index)
        for first, distance in filter(None, places)
    ]
    if rows.ndim == 1:
        return found[0]
    result = np.empty(len(found), dtype=object)
    result[:] = found
    return result.reshape(rows.shape[1:])


def _PlaceOf(items: Sequence[Any]) -> tuple[int, int] | None:
    """Returns where elements lie in p: the first index and their distance.

    None: they do not lie there at equal distances.
    """
    if len(items) < SHORTEST or set(map(type, items)) != {Number}:
        return None
    parameters = items[0].graph.given.get("p", range(0))
    places = [item.ref.place for item in items]
    distance = places[1] - places[0]
    end = places[0] + distance * len(places)
    if distance < 1 or places != list(range(places[0], end, distance)):
        return None
    if places[0] not in parameters or places[-1] not in parameters:
        return None
    return places[0] - parameters.start, distance


def Solve(A: Any, B: Any) -> Any:
    """Returns A^-1 B by Gaussian elimination with partial pivoting."""
    A = Objects(A)
    B = Objects(B)
    n = len(A)
    if A.ndim != 2 or n != A.shape[1]:
        raise Untraceable("np.linalg of a matrix that is not square")
    # The augmented matrix [A B]. A plant without joints has n = 0.
    rows = AsNumbers(np.hstack((A, B.reshape(n, math.prod(B.shape[1:])))))
    for i in range(n):
        # Exchanges move the largest element of column i at or below row i to row i.
        for j in range(i + 1, n):
            is_larger = abs(rows[j, i]) > abs(rows[i, i])
            upper = Where(is_larger, rows[j], rows[i])
            rows[j] = Where(is_larger, rows[i], rows[j])
            rows[i] = upper
        for j in range(i + 1, n):
            pivot = Where(rows[i, i] == 0.0, 1.0, rows[i, i])
            rows[j] = rows[j] - rows[j, i] / pivot * rows[i]
    # Back substitution.
    solution = rows[:, n:]
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            solution[i] = solution[i] - rows[i, j] * solution[j]
        solution[i] = solution[i] * (1.0 / rows[i, i])
    return solution.reshape(B.shape)


def Inverse(A: Any) -> Any:
    """Returns A^-1."""
    return Solve(A, np.eye(len(A)))


def Sign(a: Any) -> Any:
    """Returns 1, -1, 0 or nan."""
    return Where(a > 0.0, 1.0, Where(a < 0.0, -1.0, a * 0.0))


def Remainder(a: Any, b: Any) -> Any:
    """Returns Python's a % b, exactly; its sign is that of b."""
    rest = np.fmod(a, b)
    zero = Where(b < 0.0, -0.0, 0.0)
    other = Where((rest < 0.0) == (b < 0.0), rest, rest + b)
    result = Where(rest == 0.0, zero, other)
    if float in (KindOf(a), KindOf(b)) or not isinstance(result, Number):
        return result
    return AsWhole(result)


def IsClose(a: Any, b: Any, rtol: float = 1e-5, atol: float = 1e-8) -> Any:
    """Returns numpy's isclose() of two numbers or arrays."""
    return (abs(a - b) <= atol + rtol * abs(b)) | (a == b)


def Interp(x: Any, xp: Any, fp: Any) -> Any:
    """Returns the linear interpolation of a table; its ends outside of it."""
    result = fp[0]
    for k in range(len(xp) - 1):
        slope = (fp[k + 1] - fp[k]) / (xp[k + 1] - xp[k])
        result = Where(x >= xp[k], fp[k] + slope * (x - xp[k]), result)
    return Where(x != x, x, Where(x >= xp[-1], fp[-1], result))


SEARCH = """
define internal double @search(ptr %table, i64 %count, double %x, i1 %is_right) {
entry:
  br label %head
head:
  %low = phi i64 [0, %entry], [%next_low, %body]
  %high = phi i64 [%count, %entry], [%next_high, %body]
  %is_open = icmp slt i64 %low, %high
  br i1 %is_open, label %body, label %end
body:
  %sum = add i64 %low, %high
  %middle = lshr i64 %sum, 1
  %place = getelementptr double, ptr %table, i64 %middle
  %item = load double, ptr %place
  %is_less = fcmp olt double %item, %x
  %is_equal = fcmp oeq double %item, %x
  %item_is_nan = fcmp uno double %item, %item
  %x_is_nan = fcmp uno double %x, %x
  %are_nan = and i1 %item_is_nan, %x_is_nan
  %is_less_than_nan = icmp ult i1 %item_is_nan, %x_is_nan
  %are_equal = or i1 %is_equal, %are_nan
  %counts = and i1 %are_equal, %is_right
  %is_less_or_nan = or i1 %is_less, %is_less_than_nan
  %is_before = or i1 %is_less_or_nan, %counts
  %after = add i64 %middle, 1
  %next_low = select i1 %is_before, i64 %after, i64 %low
  %next_high = select i1 %is_before, i64 %high, i64 %middle
  br label %head
end:
  %result = sitofp i64 %low to double
  ret double %result
}"""
"""The search in LLVM's language: the number of elements before x.

For numpy, nan is larger than all numbers and equal to nan.
"""
