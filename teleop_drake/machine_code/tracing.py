"""Functions of numbers as graphs of operations, found by calling them.

A function of arrays is called with arrays of `Number`s. What it does with them is noted
as a graph of operations on single numbers. Loops, views, products of matrices and the
calls of helpers are gone from it.

Where a function asks whether a comparison holds, it is called once for each answer.
The results form a tree, and the graph gets a merge: an operation whose value is that of
the one leaf whose conditions hold. The calls of helpers are merged by themselves, so
that the number of leaves adds up and does not multiply.
"""

import builtins
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.machine_code.symbols import (
    AsReal,
    IsSame,
    Number,
    Numbers,
    Ref,
    Untraceable,
)

# Operations whose value is yes or no.
BOOLEAN = frozenset({"lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not"})

# A function with more leaves or operations than this is not worth a graph.
_MAX_LEAVES = 256
_MAX_NODES = 100_000

_TOO_MANY_CASES = "there are too many cases, as in a loop until numbers have converged"


class Node(NamedTuple):
    """An operation.

    Attributes:
        operation: Its name; "load" for what is given, "merge" for a result of a Merge.
        arguments: Numbers and nodes; for "load" the array's name and the place in it;
            for "merge" the tree and the place in its leaves.
    """

    operation: str
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Leaf:
    """One way through a function: what it returns, and writes into its arguments."""

    values: tuple[Any, ...]


@dataclass(frozen=True)
class Branch:
    """A condition of a function, and what is done either way."""

    condition: Ref
    if_true: "Branch | Leaf"
    if_false: "Branch | Leaf"


@dataclass
class Graph:
    """Operations, none of them twice.

    Attributes:
        nodes: Each after those that it takes.
        merges: The trees that nodes named "merge" take their values from.
    """

    nodes: list[Node] = field(default_factory=list)
    merges: list[Branch] = field(default_factory=list)
    _places: dict[Node, Ref] = field(default_factory=dict)
    _booleans: set[int] = field(default_factory=set)
    # What is assumed, and in which order it was asked for.
    _answers: dict[Ref, bool] = field(default_factory=dict)
    _path: "list[tuple[Ref, bool]] | None" = None
    _forced: list[bool] = field(default_factory=list)

    def Add(self, operation: str, *arguments: Any) -> "Number":
        """Returns the value of an operation.

        Args:
            operation: Its name.
            arguments: Numbers, also those of Python.
        """
        node = Node(
            operation,
            tuple(a.ref if isinstance(a, Number) else a for a in arguments),
        )
        place = self._places.get(node)
        if place is None:
            if len(self.nodes) >= _MAX_NODES:
                raise Untraceable("there are too many operations")
            place = Ref(len(self.nodes))
            self.nodes.append(node)
            self._places[node] = place
            if operation in BOOLEAN:
                self._booleans.add(place.place)
        return Number(self, place)

    def IsBoolean(self, value: Any) -> bool:
        """Returns whether a number is a yes or no.

        Args:
            value: A number, of the graph or of Python.
        """
        if isinstance(value, Number):
            return value.ref.place in self._booleans
        return isinstance(value, (bool, np.bool_))

    def Decide(self, condition: Ref) -> bool:
        """Returns the answer to a condition on the way that is being traced.

        Args:
            condition: The node.
        """
        if condition in self._answers:
            return self._answers[condition]
        if self._path is None:
            raise Untraceable("a condition stands outside of a function")
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
        """Returns what a function returns, merged over all ways through it.

        Args:
            function: The function.
            arguments: What it takes; arrays it may write into.
            keywords: The same, by name.
        """
        arrays = [a for a in _Arrays((*arguments, *keywords.values())) if a.size]
        before = [array.copy() for array in arrays]
        outer = self._answers, self._path, self._forced
        forced: list[bool] = []
        leaves: list[tuple[list[tuple[Ref, bool]], tuple[Any, ...]]] = []
        shape: Any = None
        try:
            while True:
                self._answers, self._path, self._forced = dict(outer[0]), [], forced
                result = function(*arguments, **keywords)
                if not self._path and not leaves:  # There is one way only.
                    return result
                shape_here, values = _Flat(result)
                if leaves and shape_here != shape:
                    raise Untraceable("it returns what depends on its numbers")
                shape = shape_here
                values += [x for array in arrays for x in array.flat]
                leaves.append((self._path, tuple(values)))
                if len(leaves) > _MAX_LEAVES:
                    raise Untraceable(_TOO_MANY_CASES)
                forced = [answer for _, answer in self._path]
                while forced and not forced[-1]:
                    forced.pop()
                for array, values_before in zip(arrays, before, strict=True):
                    array[...] = values_before
                if not forced:
                    break
                forced[-1] = False
        finally:
            self._answers, self._path, self._forced = outer
        values = self._Merge(leaves)
        for array in reversed(arrays):
            values, written = values[: -array.size], values[-array.size :]
            changed = np.empty(array.size, object)
            changed[:] = written
            array[...] = changed.reshape(array.shape)
        return _Unflat(shape, iter(values))

    def _Merge(
        self, leaves: list[tuple[list[tuple[Ref, bool]], tuple[Any, ...]]]
    ) -> list[Any]:
        """Returns the values of the one leaf whose conditions hold."""
        columns = list(zip(*(values for _, values in leaves), strict=True))
        different = [k for k, column in enumerate(columns) if not IsSame(column)]
        rows = iter([(path, [v[k] for k in different]) for path, v in leaves])
        booleans = [all(self.IsBoolean(v) for v in columns[k]) for k in different]
        tree = self._Tree(list(rows), 0, booleans)
        assert isinstance(tree, Branch)
        self.merges.append(tree)
        merged = [column[0] for column in columns]
        for place, k in enumerate(different):
            number = self.Add("merge", len(self.merges) - 1, place)
            if booleans[place]:
                self._booleans.add(number.ref.place)
            merged[k] = number
        return merged

    def _Tree(
        self,
        rows: list[tuple[list[tuple[Ref, bool]], list[Any]]],
        depth: int,
        booleans: list[bool],
    ) -> Branch | Leaf:
        path, values = rows[0]
        if len(path) == depth:
            return Leaf(
                tuple(
                    _Argument(v if is_boolean else AsReal(v))
                    for v, is_boolean in zip(values, booleans, strict=True)
                )
            )
        sides = [
            [row for row in rows if row[0][depth][1] is answer]
            for answer in (True, False)
        ]
        trees = [self._Tree(side, depth + 1, booleans) for side in sides]
        return Branch(path[depth][0], *trees)


def _Argument(value: Any) -> Any:
    return value.ref if isinstance(value, Number) else value


def _Arrays(value: Any) -> list[Any]:
    """Returns the arrays of numbers in a value."""
    if isinstance(value, tuple):
        return [array for item in value for array in _Arrays(item)]
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [value]
    return []


def _Flat(value: Any) -> tuple[Any, list[Any]]:
    """Returns what a value is made of, and the numbers in it."""
    if value is None:
        return None, []
    if isinstance(value, tuple):
        shapes, values = [], []
        for item in value:
            shape, inner = _Flat(item)
            shapes.append(shape)
            values += inner
        return (type(value), tuple(shapes)), values
    if isinstance(value, np.ndarray):
        return value.shape, list(value.flat)
    if isinstance(value, (Number, int, float, np.generic)):
        return "number", [value]
    raise Untraceable(f"it returns a {type(value).__name__}")


def _Unflat(shape: Any, values: Any) -> Any:
    if shape is None:
        return None
    if shape == "number":
        return next(values)
    if isinstance(shape[0] if shape else 0, type):
        kind, inner = shape
        items = [_Unflat(part, values) for part in inner]
        return kind(*items) if hasattr(kind, "_fields") else tuple(items)
    array = np.empty(shape, object)
    for place in np.ndindex(shape):
        array[place] = next(values)
    return array.view(Numbers)


def Trace(
    graph: Graph,
    function: FunctionType,
    modules: dict[Any, Any],
    functions: dict[str, Callable[..., Any]],
) -> Callable[..., Any]:
    """Returns a function that notes what it and its helpers do.

    Args:
        graph: Where to note it.
        function: The function.
        modules: What to call instead of modules.
        functions: What to call instead of Python's own functions, by name.
    """
    traced: dict[FunctionType, Callable[..., Any]] = {}

    def Of(function: FunctionType) -> Callable[..., Any]:
        if function in traced:
            return traced[function]
        names = dict(function.__globals__)

        @functools.wraps(function)
        def Call(*arguments: Any, **keywords: Any) -> Any:
            try:
                return graph.Call(copy, arguments, keywords)
            except Exception as error:  # Whatever it does to what is no number.
                if not isinstance(error, Untraceable):
                    error = Untraceable(f"{type(error).__name__}: {error}")
                error.function = function
                raise error from None

        traced[function] = Call
        for name in _Names(function.__code__):
            if name not in names:
                if name in functions and hasattr(builtins, name):
                    names[name] = functions[name]
                continue
            value = names[name]
            if isinstance(value, FunctionType):
                names[name] = Of(value)
            elif isinstance(value, ModuleType) and value in modules:
                names[name] = modules[value]
        copy = FunctionType(
            function.__code__,
            names,
            function.__name__,
            function.__defaults__,
            function.__closure__,
        )
        copy.__kwdefaults__ = function.__kwdefaults__
        return Call

    return Of(function)


def _Names(code: CodeType) -> set[str]:
    """Returns the global names in a function, those in its comprehensions included."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _Names(constant)
    return names
