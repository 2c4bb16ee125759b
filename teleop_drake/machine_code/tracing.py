"""Functions of numbers as graphs of operations, found by calling them.

A function of arrays is called with arrays of `Number`s. What it does with them is noted
as a graph of operations on single numbers. Loops, views, products of matrices and the
calls of helpers are gone from it.

Where a function asks whether a comparison holds, it is called once for each answer.
The results form a tree, and the graph gets a merge: an operation whose value is that of
the one leaf whose conditions hold. The calls of helpers are merged by themselves, so
that the number of leaves adds up and does not multiply. A helper whose ways differ in
more than numbers, such as in what they append to a list, is not merged: its conditions
become conditions of its caller.

What cannot be followed is refused: errors that are caught, what changes from call to
call, functions that work with numbers in a way that is not known here. A number that
Python would raise an error for, such as an index that is too large, is nan.
"""

import functools
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.machine_code.contents import AreShared, Contents, Reshaped
from teleop_drake.machine_code.symbols import (
    AsNumbers,
    AsReal,
    IsBoolean,
    IsSame,
    Number,
    Ref,
    Untraceable,
    Where,
)

# Operations whose value is yes or no.
BOOLEAN = frozenset({"lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not"})

# Those that take yes or no as it is.
_OF_BOOLEANS = frozenset({"and", "or", "not", "select", "merge", "load"})

# Those whose value is finite if their arguments are.
_FINITE = frozenset(
    {"add", "sub", "mul", "neg", "fabs", "select", "merge", "floor", "ceil", "trunc"}
    | {"rint", "sin", "cos", "atan", "atan2", "tanh", "copysign"}
)

# A function with more leaves or operations than this is not worth a graph.
_MAX_LEAVES = 256
_MAX_NODES = 100_000

_TOO_MANY_CASES = "there are too many cases, as in a loop until numbers have converged"


class MustJoinCaller(BaseException):
    """A helper whose ways have to be ways of its caller; it is raised with its code."""


class Node(NamedTuple):
    """An operation.

    Attributes:
        operation: Its name; "load" for what is given, "merge" for what a condition
            chooses of two sides, of which only one is computed.
        arguments: Numbers and nodes; for "load" the array's name and the place in it;
            for "merge" a number, the same for all that is chosen there, the condition
            and the sides.
    """

    operation: str
    arguments: tuple[Any, ...]


# One way through a function: the conditions with their answers, and what it returns and
# writes into its arguments.
_Leaf = tuple[list[tuple[Ref, bool]], list[Any]]


@dataclass
class Graph:
    """Operations, none of them twice.

    Attributes:
        is_given_finite: Whether what is given is finite: then 0 times it is 0.
        nodes: Each after those that it takes.
        followed: The functions that are traced, by what they stand for.
        codes: What may work with numbers: the code of these functions.
        joined: The code of those that are not merged; see MustJoinCaller.
        surroundings: What they have from outside, by its name, as it was at first.
    """

    is_given_finite: bool = True
    nodes: list[Node] = field(default_factory=list)
    followed: dict[Any, Any] = field(default_factory=dict)
    codes: set[CodeType] = field(default_factory=set)
    joined: set[CodeType] = field(default_factory=set)
    surroundings: dict[int, Any] = field(default_factory=dict)
    _places: dict[Node, Ref] = field(default_factory=dict)
    _booleans: set[int] = field(default_factory=set)
    _infinite: set[int] = field(default_factory=set)
    _num_merges: int = 0
    # What is assumed, and in which order it was asked for.
    _answers: dict[Ref, bool] = field(default_factory=dict)
    _path: "list[tuple[Ref, bool]] | None" = None
    _forced: list[bool] = field(default_factory=list)

    def Add(self, operation: str, *arguments: Any) -> "Number":
        """Returns the value of an operation on numbers, also those of Python."""
        operands = []
        for value in arguments:
            if isinstance(value, Number):
                if value.graph is not self:
                    raise Untraceable("it keeps a number from another call")
                if value.is_boolean and operation not in _OF_BOOLEANS:
                    value = AsReal(value)
                value = value.ref
            elif value == 0.0 and str(value) == "-0.0" and operation != "neg":
                value = self.Add("neg", 0.0).ref  # Else it would be taken for 0.0.
            elif IsBoolean(value) and operation not in _OF_BOOLEANS:
                value = float(value)
            operands.append(value)
        node = Node(operation, tuple(operands))
        place = self._places.get(node)
        if place is None:
            self._CheckCaller()
            if len(self.nodes) >= _MAX_NODES:
                raise Untraceable("there are too many operations")
            place = Ref(len(self.nodes))
            self.nodes.append(node)
            self._places[node] = place
            if operation in BOOLEAN:
                self._booleans.add(place.place)
            elif not self._IsFinite(operation, operands):
                self._infinite.add(place.place)
        return Number(self, place, place.place in self._booleans)

    def IsFinite(self, value: Number) -> bool:
        """Returns whether a number is finite whatever there is to work with."""
        return value.ref.place not in self._infinite

    def _IsFinite(self, operation: str, operands: Sequence[Any]) -> bool:
        if operation == "load":
            return self.is_given_finite
        return operation in _FINITE and all(
            operand.place not in self._infinite
            if isinstance(operand, Ref)
            else abs(operand) < math.inf
            for operand in operands
        )

    def _CheckCaller(self) -> None:
        """Refuses what works with numbers without being followed."""
        frame = sys._getframe(2)
        while self._path is not None and frame.f_code not in self.codes:
            if not _IsOwn(frame.f_code):
                name = frame.f_code.co_qualname
                raise Untraceable(f"{name}() works with numbers and is not followed")
            assert frame.f_back is not None
            frame = frame.f_back

    def Decide(self, condition: Ref) -> bool:
        """Returns the answer to a condition on the way that is being traced."""
        if condition in self._answers:
            return self._answers[condition]
        if self._path is None:
            raise Untraceable("a condition stands outside of a function")
        self._CheckCaller()
        if len(self._path) == _MAX_LEAVES:  # Each answer makes a leaf more.
            raise Untraceable(_TOO_MANY_CASES)
        answer = True
        if len(self._path) < len(self._forced):
            answer = self._forced[len(self._path)]
        self._path.append((condition, answer))
        self._answers[condition] = answer
        return answer

    def Call(
        self,
        function: Callable[..., Any],
        arguments: Sequence[Any],
        keywords: dict[str, Any],
    ) -> Any:
        """Returns what a function returns, merged over all ways through it."""
        code = getattr(function, "__code__", None)
        if code in self.joined and self._path is not None:
            return function(*arguments, **keywords)
        before = Contents((arguments, keywords))
        arrays = [x for x in before.arrays if x.size and x.flags.writeable]
        outer = self._answers, self._path, self._forced
        forced: list[bool] = []
        leaves: list[_Leaf] = []
        first: Any = None
        shape: Any = None
        try:
            while True:
                self._answers, self._path, self._forced = dict(outer[0]), [], forced
                result = function(*arguments, **keywords)
                if not self._path and not leaves:  # There is one way only.
                    return result
                # What is returned to no caller is only read.
                known = before if outer[1] is not None else None
                shape_here, values = _Flat(result, known)
                if not leaves:
                    first, shape = result, shape_here
                is_changed = before.Changed(with_numbers=False)
                if is_changed or shape_here != shape:
                    if outer[1] is not None:
                        raise MustJoinCaller(code)
                    what = "changes" if is_changed else "returns"
                    raise Untraceable(f"what it {what} depends on its numbers")
                values += [x for array in arrays for x in np.asarray(array).flat]
                leaves.append((self._path, values))
                if len(leaves) > _MAX_LEAVES:
                    raise Untraceable(_TOO_MANY_CASES)
                forced = [answer for _, answer in self._path]
                while forced and not forced[-1]:
                    forced.pop()
                before.Restore(arrays)
                if not forced:
                    break
                forced[-1] = False
        finally:
            self._answers, self._path, self._forced = outer
        values = self._Merge(leaves)
        for array in reversed(arrays):
            values, written = values[: -array.size], values[-array.size :]
            np.asarray(array)[...] = Reshaped(written, array.shape)
        return _Unflat(first, shape, iter(values))

    def _Merge(self, leaves: list[_Leaf], depth: int = 0) -> list[Any]:
        """Returns the values of the one leaf whose conditions hold."""
        path, values = leaves[0]
        if len(path) == depth:
            return values
        condition = Number(self, path[depth][0], True)
        yes, no = (
            self._Merge([x for x in leaves if x[0][depth][1] is answer], depth + 1)
            for answer in (True, False)
        )
        self._num_merges += 1
        return [
            Where(condition, a, b)
            if IsSame((a, b)) or (IsBoolean(a) and IsBoolean(b))
            else self.Add("merge", self._num_merges, condition, AsReal(a), AsReal(b))
            for a, b in zip(yes, no, strict=True)
        ]


@functools.cache
def _IsOwn(code: CodeType) -> bool:
    """Returns whether code is of this folder or of numpy."""
    folders = Path(__file__).parent, Path(np.__file__).parent
    return any(folder in Path(code.co_filename).parents for folder in folders)


def _Flat(value: Any, known: Contents | None) -> tuple[Any, list[Any]]:
    """Returns what a value is made of, and the numbers in it that may differ.

    Args:
        known: Its arguments. What is part of them is no new value. None: that does not
            matter, and neither does what kind of numbers there are.
    """
    if isinstance(value, (Number, int, float, np.generic)):
        return ("number", known is not None and IsBoolean(value)), [value]
    if isinstance(value, (tuple, list)) and not (known and value and known.Has(value)):
        shapes, values = [], []
        arrays = [item for item in value if isinstance(item, np.ndarray)]
        for item in value:
            shape, inner = _Flat(item, known)
            is_array = known is not None and isinstance(item, np.ndarray)
            if is_array and any(AreShared(item, x) for x in arrays if x is not item):
                shape = object()  # It is like nothing else.
            shapes.append(shape)
            values += inner
        return (type(value), *shapes), values
    if isinstance(value, np.ndarray):
        plain = np.asarray(value)
        if known is None:
            return ("array", plain.shape), list(plain.flat)
        if known.Shares(value):
            address = plain.__array_interface__["data"]
            return ("view", address, plain.strides, plain.shape), []
        if plain.dtype.kind in "fO":
            is_boolean = any(map(IsBoolean, plain.flat))
            return ("array", plain.shape, is_boolean), list(plain.flat)
        return ("table", plain.shape, plain.dtype, plain.tobytes()), []
    return ("same", id(value)), []


def _Unflat(first: Any, shape: Any, values: Any) -> Any:
    """Returns what is made like the result of the first way, with other numbers."""
    kind, *others = shape
    if kind == "number":
        return next(values)
    if kind == "array":
        size = int(np.prod(others[0]))
        array = AsNumbers(Reshaped([next(values) for _ in range(size)], others[0]))
        array.flags.writeable = first.flags.writeable
        return array
    if isinstance(kind, str):
        return first
    items = [_Unflat(*x, values) for x in zip(first, others, strict=True)]
    return kind(*items) if hasattr(kind, "_fields") else kind(items)
