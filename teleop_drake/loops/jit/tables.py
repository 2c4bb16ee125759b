"""Tables in memory: long arrays of parameters, searched and indexed by Numbers.

A short array is searched and indexed by comparing with each element. A long one that
lies in the parameters p at equal distances is searched by bisection where it lies, so
that the code does not grow with its length.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from teleop_drake.loops.jit.symbols import Number

SHORTEST = 32
"""The least number of elements of a table; shorter arrays are compared one by one."""


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
