"""Traces functions of numbers, by calling them, to graphs of operations.

A function of arrays is called with arrays of `Number`s. Its operations on them are
recorded as a graph of operations on single numbers, without loops, views, products of
matrices and calls of helpers.

Where a function branches on a comparison, it is called once for each result. Each such
call follows one way through the function, with its answers to the conditions (the
comparisons) that it meets. The ways form a tree, and the graph selects the result of
the one leaf whose conditions hold. All leaves are computed. The ways of a helper that
takes and returns single numbers are merged before its caller goes on, so that the
numbers of the helper's and the caller's leaves add up. The conditions of other helpers
become conditions of the caller, and the numbers of leaves multiply.

A function is refused if it catches errors, changes values outside of it, or passes
Numbers to functions that are unknown here. Where Python would raise an error, for
example for an index that is too large, the result is nan.
"""

import contextlib
import functools
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.loops.jit.symbolic_arrays import (
    AsFloats,
    Objects,
    Where,
)
from teleop_drake.loops.jit.symbols import (
    COMPARISONS,
    IsBoolean,
    Number,
    Ref,
    Untraceable,
)

# Operations whose value is a boolean.
_BOOLEAN = COMPARISONS | {"and", "or", "not"}

# Operations whose value is finite if their arguments are finite.
_FINITE = frozenset(
    {"add", "sub", "mul", "neg", "fabs", "select", "floor", "ceil", "trunc"}
    | {"sin", "cos", "atan", "atan2", "tanh"}
)

# A function with more leaves or operations than this is not worth a graph.
_MAX_LEAVES = 256
_MAX_NODES = 100_000

_NUMBERS = (Number, int, float, np.generic)

# Types of values that contain no other values, and that a helper cannot change.
_SINGLE = (*_NUMBERS, str, type(None))

_TOO_MANY_CASES = "there are too many cases, as in a loop until numbers have converged"


class Node(NamedTuple):
    """An operation.

    Attributes:
        operation: The name of the operation. "load" reads an argument, "select" selects
            one of two numbers by a condition, and "search_left", "search_right" and
            "lookup" read tables in p; see tables.
        arguments: Numbers and nodes. For "load" they are the array's name and the index
            in it.
    """

    operation: str
    arguments: tuple[Any, ...]


_Path = list[tuple[Ref, bool]]
"""The conditions of one way through a function, in their order, with their answers."""


class _Way(NamedTuple):
    """A way through a function, and the result of the function on this way."""

    path: _Path
    result: Any


class _Assumed(NamedTuple):
    """The answers to conditions on the way that is being traced.

    Attributes:
        answers: The answers to the conditions of the function and of its callers.
        path: The function's conditions in the order in which they were met, with their
            answers.
        forced: The prescribed answers to the first conditions of `path`. The answer to
            every later one is True.
    """

    answers: dict[Ref, bool]
    path: _Path
    forced: list[bool]


@dataclass
class Graph:
    """A graph of operations, in which equal operations are one node.

    Attributes:
        is_given_finite: Whether the arguments of the traced function are finite, so
            that 0 times an argument is 0.
        nodes: The operations, each after its arguments.
        followed: The replacements of traced functions, keyed by the functions.
        codes: The code of the traced functions, which may operate on Numbers.
        given: The places in `nodes` of the elements of each array of Given().
        stand_in: A function of a value from outside of the traced functions, and of its
            name. It returns what replaces the value; None: what Follow() chooses.
        folders: Folders of code that may operate on Numbers without being followed,
            besides this one and numpy's.
    """

    is_given_finite: bool = True
    nodes: list[Node] = field(default_factory=list)
    followed: dict[Any, Any] = field(default_factory=dict)
    codes: set[CodeType] = field(default_factory=set)
    given: dict[str, range] = field(default_factory=dict)
    stand_in: Callable[[Any, str], Any] | None = None
    folders: tuple[Path, ...] = ()
    _places: dict[Node, Ref] = field(default_factory=dict)
    _infinite: set[int] = field(default_factory=set)
    # Whether the function that is being traced is one of the package.
    _is_of_package: bool = True
    # None while no function is being traced.
    _assumed: _Assumed | None = None

    def Given(self, name: str, size: int) -> list["Number"]:
        """Returns the elements of an array that is an argument of the traced function.

        Args:
            name: The name of the array, which is given once.
            size: Its length.
        """
        first = len(self.nodes)
        self.given[name] = range(first, first + size)
        for i in range(size):
            node = Node("load", (name, i))
            self._places[node] = Ref(first + i)
            self.nodes.append(node)
        if not self.is_given_finite:
            self._infinite.update(self.given[name])
        return [Number(self, Ref(place)) for place in self.given[name]]

    def Add(self, operation: str, *arguments: Any) -> "Number":
        """Adds an operation to the graph, unless it is there; returns its value.

        Args:
            operation: The name of the operation; see Node.
            arguments: Numbers of the graph, and plain numbers; see Node for "load".
        """
        operands: list[Any] = []
        for value in arguments:
            if isinstance(value, Number):
                if value.graph is not self:
                    raise Untraceable("it keeps a number from another call")
                operands.append(value.ref)
            elif value == 0.0 and str(value) == "-0.0" and operation != "neg":
                # As a constant, -0.0 would be equal to 0.0 and share its node.
                operands.append(self.Add("neg", 0.0).ref)
            else:
                operands.append(value)
        node = Node(operation, tuple(operands))
        place = self._places.get(node)
        if place is None:
            self._CheckCaller()
            place = self._places[node] = self._Append(node)
        kind = bool if operation in _BOOLEAN else float
        return Number(self, place, kind)

    def _Append(self, node: Node) -> Ref:
        num_given = sum(map(len, self.given.values()))
        if len(self.nodes) - num_given >= _MAX_NODES:
            raise Untraceable("there are too many operations")
        place = len(self.nodes)
        self.nodes.append(node)
        if not self._IsFinite(node):
            self._infinite.add(place)
        return Ref(place)

    def IsZeroTimes(self, value: Number) -> bool:
        """Returns whether 0.0 times a number is replaced by 0.0.

        In a user's function the product is computed as in Python, and may be -0.0 or
        nan. The package's own functions multiply matrices that are mostly zero, and
        nothing in them depends on the sign of a zero.
        """
        return self._is_of_package and value.ref.place not in self._infinite

    @contextlib.contextmanager
    def TakenAsFinite(self, values: Iterable[Any]) -> Iterator[None]:
        """Takes Numbers as finite while functions of the package operate on them."""
        places = {x.ref.place for x in values if isinstance(x, Number)}
        places &= self._infinite
        self._infinite -= places
        try:
            yield
        finally:
            self._infinite |= places

    def _IsFinite(self, node: Node) -> bool:
        """Returns whether a new operation has a finite value."""
        if node.operation in _BOOLEAN:
            return True
        if node.operation == "load":
            return self.is_given_finite
        if not self._is_of_package or node.operation not in _FINITE:
            return False
        for x in node.arguments:
            if isinstance(x, Ref):
                if x.place in self._infinite:
                    return False
            elif not abs(x) < math.inf:
                return False
        return True

    def _CheckCaller(self) -> None:
        """Refuses code that operates on Numbers without being followed."""
        frame = sys._getframe(2)
        while self._assumed is not None and frame.f_code not in self.codes:
            if not _IsOwn(frame.f_code.co_filename, self.folders):
                name = frame.f_code.co_qualname
                raise Untraceable(f"{name}() works with numbers and is not followed")
            assert frame.f_back is not None
            frame = frame.f_back

    def Decide(self, condition: Ref) -> bool:
        """Returns the answer to a condition on the way that is being traced."""
        assumed = self._assumed
        if assumed is None:
            raise Untraceable("a condition stands outside of a function")
        if condition in assumed.answers:
            return assumed.answers[condition]
        self._CheckCaller()
        if len(assumed.path) == _MAX_LEAVES:  # Each condition adds a leaf.
            raise Untraceable(_TOO_MANY_CASES)
        is_forced = len(assumed.path) < len(assumed.forced)
        answer = assumed.forced[len(assumed.path)] if is_forced else True
        assumed.path.append((condition, answer))
        assumed.answers[condition] = answer
        return answer

    def Call(
        self,
        function: FunctionType,
        arguments: tuple[Any, ...],
        keywords: dict[str, Any],
    ) -> Any:
        """Calls a function; returns its result, merged over all ways through it.

        The ways of a helper may be left to its caller; see _CallOfNumbers().
        """
        was_of_package = self._is_of_package
        self._is_of_package = _IsOfPackage(function)
        try:
            if self._assumed is None:
                return self.CallLaw(lambda: function(*_Copied(arguments), **keywords))
            call = functools.partial(function, *arguments, **keywords)
            if all(isinstance(x, _SINGLE) for x in (*arguments, *keywords.values())):
                return self._CallOfNumbers(call)
            return call()
        finally:
            self._is_of_package = was_of_package

    def CallLaw(self, call: Callable[[], Any]) -> Any:
        """Calls the outermost function, with new copies of its arrays on each way."""
        with np.errstate(all="ignore"):
            ways = self._EachWay(call)
            if len(ways) == 1:
                return ways[0].result
            ways = [_Way(way.path, AsFloats(Objects(way.result))) for way in ways]
            if len({way.result.shape for way in ways}) > 1:
                raise Untraceable("what it returns depends on its numbers")
            return _Merged(self, ways)

    def _CallOfNumbers(self, call: Callable[[], Any]) -> Any:
        """Calls a helper whose arguments are single values, which it cannot change.

        If it returns single numbers, its ways are merged here. Otherwise its conditions
        become conditions of its caller.
        """
        ways = self._EachWay(call)
        results = [way.result for way in ways]
        if len(ways) == 1:
            return results[0]
        are_numbers = all(isinstance(x, _NUMBERS) for x in results)
        if are_numbers and len(set(map(IsBoolean, results))) == 1:
            return _Merged(self, ways)
        return call()

    def _EachWay(self, call: Callable[[], Any]) -> list["_Way"]:
        """Calls a function once for each way through it."""
        outer = self._assumed
        ways: list[_Way] = []
        forced: list[bool] | None = []
        try:
            while forced is not None:
                answers = {} if outer is None else dict(outer.answers)
                self._assumed = _Assumed(answers, [], forced)
                ways.append(_Way(self._assumed.path, call()))
                if len(ways) > _MAX_LEAVES:
                    raise Untraceable(_TOO_MANY_CASES)
                forced = _NextWay(ways[-1].path)
        finally:
            self._assumed = outer
        return ways


def _NextWay(path: _Path) -> list[bool] | None:
    """Returns the prescribed answers of the next way; None after the last way.

    They are those of the given way until its last True, which becomes False.
    """
    answers = [answer for _, answer in path]
    while answers and not answers[-1]:
        answers.pop()
    if not answers:
        return None
    answers[-1] = False
    return answers


def _IsOfPackage(function: FunctionType) -> bool:
    module = function.__globals__.get("__name__") or ""
    return bool(module.partition(".")[0] == __name__.partition(".")[0])


@functools.cache
def _IsOwn(file: str, others: tuple[Path, ...]) -> bool:
    """Returns whether a file of code is in this folder, numpy's, or one of others."""
    folders = Path(__file__).parent, Path(np.__file__).parent, *others
    return any(folder in Path(file).parents for folder in folders)


def _Copied(value: Any) -> Any:
    """Returns a value in which writable arrays are replaced by copies."""
    if isinstance(value, np.ndarray):
        return value.copy() if value.flags.writeable else value
    if isinstance(value, tuple):
        return getattr(value, "_make", tuple)(map(_Copied, value))
    return value


def _Merged(graph: Graph, ways: Sequence[_Way], depth: int = 0) -> Any:
    """Returns the result of the one way whose conditions hold.

    Args:
        ways: Ways that have the same answers to their first conditions.
        depth: The number of these first conditions.
    """
    path, result = ways[0]
    if len(path) == depth:
        return result
    condition = Number(graph, path[depth][0], bool)
    yes = [way for way in ways if way.path[depth][1]]
    no = [way for way in ways if not way.path[depth][1]]
    return Where(
        condition, _Merged(graph, yes, depth + 1), _Merged(graph, no, depth + 1)
    )
