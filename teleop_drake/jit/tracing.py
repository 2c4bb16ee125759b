"""Functions of numbers as graphs of operations, found by calling them.

A function of arrays is called with arrays of `Number`s. Its operations on them are
recorded as a graph of operations on single numbers, without loops, views, products of
matrices and calls of helpers.

Where a function branches on a comparison, it is called once for each result. The
results form a tree, and the graph selects the value of the one leaf whose conditions
hold. All leaves are computed. The calls of each helper are merged separately, so that
the numbers of leaves add up and do not multiply. A helper is not merged if its branches
differ in more than numbers, for example in what they append to a list, or if it returns
views of its arguments. Its conditions then become conditions of its caller.

A function is refused if it catches errors, depends on values that change from call to
call, or passes Numbers to functions that are unknown here. Where Python would raise an
error, for example for an index that is too large, the number is nan.
"""

import functools
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple, NoReturn

import numpy as np

from teleop_drake.jit.contents import AreShared, Contents, Reshaped
from teleop_drake.jit.symbolic_arrays import (
    AsFloats,
    AsNumbers,
    Objects,
    Where,
)
from teleop_drake.jit.symbols import (
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
    {"add", "sub", "mul", "neg", "fabs", "select", "floor", "ceil", "trunc", "rint"}
    | {"sin", "cos", "atan", "atan2", "tanh", "copysign"}
)

# A function with more leaves or operations than this is not worth a graph.
_MAX_LEAVES = 256
_MAX_NODES = 100_000

_NUMBERS = (Number, int, float, np.generic)

_TOO_MANY_CASES = "there are too many cases, as in a loop until numbers have converged"


class MustJoinCaller(BaseException):
    """Raised with a helper's code if its branches must be branches of its caller."""


class Node(NamedTuple):
    """An operation.

    Attributes:
        operation: The name of the operation. "load" reads an argument, and "select"
            selects one of two numbers by a condition.
        arguments: Numbers and nodes. For "load" they are the array's name and the index
            in it.
    """

    operation: str
    arguments: tuple[Any, ...]


_Path = list[tuple[Ref, bool]]
"""The conditions of a way through a function, with their answers."""


class _Way(NamedTuple):
    """The way that is being traced.

    Attributes:
        answers: What is assumed, also by callers.
        path: The conditions in the order in which they were met, with their answers.
        forced: The answers to the first of them; to all others it is yes.
    """

    answers: dict[Ref, bool]
    path: _Path
    forced: list[bool]


@dataclass
class Graph:
    """Operations, none of them twice.

    Attributes:
        is_given_finite: Whether the arguments are finite, so that 0 times one is 0.
        nodes: The operations, each after its arguments.
        followed: The traced functions, by the functions that they replace.
        codes: The code of the traced functions, which may operate on Numbers.
        joined: The code of helpers that are not merged; see MustJoinCaller.
        surroundings: The values that functions have from outside, with their original
            contents, by the identity of each value.
    """

    is_given_finite: bool = True
    nodes: list[Node] = field(default_factory=list)
    followed: dict[Any, Any] = field(default_factory=dict)
    codes: set[CodeType] = field(default_factory=set)
    joined: set[CodeType] = field(default_factory=set)
    surroundings: dict[int, Any] = field(default_factory=dict)
    _places: dict[Node, Ref] = field(default_factory=dict)
    _infinite: set[int] = field(default_factory=set)
    # Whether the function that is being traced is one of the package.
    _is_of_package: bool = True
    # None outside of functions.
    _way: _Way | None = None

    def Add(self, operation: str, *arguments: Any) -> "Number":
        """Returns the value of an operation on numbers, also those of Python."""
        operands: list[Any] = []
        for value in arguments:
            if isinstance(value, Number):
                if value.graph is not self:
                    raise Untraceable("it keeps a number from another call")
                operands.append(value.ref)
            elif value == 0.0 and str(value) == "-0.0" and operation != "neg":
                # Else it would be taken for 0.0.
                operands.append(self.Add("neg", 0.0).ref)
            else:
                operands.append(value)
        node = Node(operation, tuple(operands))
        if node not in self._places:
            self._CheckCaller()
            self._places[node] = self._Append(node)
        return Number(self, self._places[node], operation in _BOOLEAN)

    def _Append(self, node: Node) -> Ref:
        if len(self.nodes) >= _MAX_NODES:
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

    def _IsFinite(self, node: Node) -> bool:
        """Returns whether a new operation has a finite value."""
        if node.operation in _BOOLEAN:
            return True
        if node.operation == "load":
            return self.is_given_finite
        if not self._is_of_package or node.operation not in _FINITE:
            return False
        return all(
            x.place not in self._infinite if isinstance(x, Ref) else abs(x) < math.inf
            for x in node.arguments
        )

    def _CheckCaller(self) -> None:
        """Refuses code that operates on Numbers without being followed."""
        frame = sys._getframe(2)
        while self._way is not None and frame.f_code not in self.codes:
            if not _IsOwn(frame.f_code):
                name = frame.f_code.co_qualname
                raise Untraceable(f"{name}() works with numbers and is not followed")
            assert frame.f_back is not None
            frame = frame.f_back

    def Decide(self, condition: Ref) -> bool:
        """Returns the truth of a condition on the branch that is being traced."""
        way = self._way
        if way is None:
            raise Untraceable("a condition stands outside of a function")
        if condition in way.answers:
            return way.answers[condition]
        self._CheckCaller()
        if len(way.path) == _MAX_LEAVES:  # Each condition adds a leaf.
            raise Untraceable(_TOO_MANY_CASES)
        is_forced = len(way.path) < len(way.forced)
        answer = way.forced[len(way.path)] if is_forced else True
        way.path.append((condition, answer))
        way.answers[condition] = answer
        return answer

    def Call(
        self,
        function: FunctionType,
        arguments: Sequence[Any],
        keywords: dict[str, Any],
    ) -> Any:
        """Returns what a function returns, merged over all ways through it."""
        was_of_package = self._is_of_package
        self._is_of_package = _IsOfPackage(function)
        try:
            if self._way is not None and function.__code__ in self.joined:
                return function(*arguments, **keywords)
            return self._CallEachWay(function, arguments, keywords)
        finally:
            self._is_of_package = was_of_package

    def _CallEachWay(
        self,
        function: FunctionType,
        arguments: Sequence[Any],
        keywords: dict[str, Any],
    ) -> Any:
        """Calls a function once for each way through it, and merges what it does."""
        is_helper = self._way is not None
        before = Contents((arguments, keywords))
        arrays = [x for x in before.arrays if x.size and x.flags.writeable]
        paths: list[_Path] = []
        results: list[Any] = []
        # What each way leaves in the arguments.
        written: list[list[Any]] = []
        forced: list[bool] | None = []
        while forced is not None:
            result, path = self._CallOneWay(function, arguments, keywords, forced)
            if not path and not paths:  # There is only one branch.
                return result
            if before.Changed(with_numbers=False):
                _RefuseToMerge(function, "changes", is_helper)
            paths.append(path)
            if len(paths) > _MAX_LEAVES:
                raise Untraceable(_TOO_MANY_CASES)
            # A result that has no caller is only read.
            results.append(result if is_helper else AsFloats(Objects(result)))
            written.append([np.array(Objects(array)) for array in arrays])
            # The next way gets the arguments as they were.
            before.Restore()
            forced = _NextWay(path)
        joint = _Joint(_Tree(self, list(enumerate(paths))), before)
        try:
            merged = joint.Join(results)
        except _DifferentError:
            _RefuseToMerge(function, "returns", is_helper)
        for array, *column in zip(arrays, *written, strict=True):
            np.asarray(array)[...] = joint.Merged(column)
        return merged

    def _CallOneWay(
        self,
        function: FunctionType,
        arguments: Sequence[Any],
        keywords: dict[str, Any],
        forced: list[bool],
    ) -> tuple[Any, _Path]:
        """Returns what a function returns on one way, and the conditions of that."""
        outer = self._way
        answers = {} if outer is None else dict(outer.answers)
        way = _Way(answers, [], forced)
        self._way = way
        try:
            return function(*arguments, **keywords), way.path
        finally:
            self._way = outer


def _NextWay(path: _Path) -> list[bool] | None:
    """Returns the first answers of the way after one; None after the last."""
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
def _IsOwn(code: CodeType) -> bool:
    """Returns whether code is of this folder or of numpy."""
    folders = Path(__file__).parent, Path(np.__file__).parent
    return any(folder in Path(code.co_filename).parents for folder in folders)


def _RefuseToMerge(function: FunctionType, what: str, is_helper: bool) -> NoReturn:
    if is_helper:
        raise MustJoinCaller(function.__code__)
    raise Untraceable(f"what it {what} depends on its numbers")


def _Tree(graph: Graph, ways: Sequence[tuple[int, _Path]], depth: int = 0) -> Any:
    """Returns a tree of conditions, whose leaves are the numbers of ways.

    A branch is a condition, and the trees where it holds and where it does not.
    """
    number, path = ways[0]
    if len(path) == depth:
        return number
    condition = Number(graph, path[depth][0], True)
    yes = [way for way in ways if way[1][depth][1]]
    no = [way for way in ways if not way[1][depth][1]]
    return condition, _Tree(graph, yes, depth + 1), _Tree(graph, no, depth + 1)


class _DifferentError(Exception):
    """Raised for results that differ in more than numbers."""


class _Joint:
    """Joins what a function returns on each way through it.

    Args:
        tree: The conditions; see _Tree().
        known: The arguments of the function. What is part of them is no new value.
    """

    def __init__(self, tree: Any, known: Contents):
        self._tree = tree
        self._known = known
        self._new: list[Any] = []

    def Join(self, column: Sequence[Any]) -> Any:
        """Returns the value of the one way whose conditions hold."""
        first = column[0]
        if all(x is first for x in column):
            return first
        if all(isinstance(x, _NUMBERS) or self._IsNewArray(x) for x in column):
            arrays = [Objects(x) for x in column]
            kinds = {(x.shape, any(map(IsBoolean, x.flat))) for x in arrays}
            if len(kinds) == 1:
                return self.Merged(arrays)[()]
        kind = type(first)
        is_tuple = isinstance(first, tuple)
        if any(type(x) is not kind for x in column):
            raise _DifferentError
        is_new = is_tuple or (kind is list and all(map(self._IsNew, column)))
        if not is_new or any(len(x) != len(first) for x in column):
            raise _DifferentError
        items = [self.Join(items) for items in zip(*column, strict=True)]
        return kind(*items) if hasattr(kind, "_fields") else kind(items)

    def Merged(self, arrays: Sequence[Any]) -> Any:
        """Returns an array of numbers, those of the way whose conditions hold."""
        columns = zip(*(array.flat for array in arrays), strict=True)
        items = [self._Select(self._tree, column) for column in columns]
        return AsNumbers(Reshaped(items, arrays[0].shape))

    def _Select(self, tree: Any, column: Sequence[Any]) -> Any:
        if isinstance(tree, int):
            return column[tree]
        condition, yes, no = tree
        return Where(condition, self._Select(yes, column), self._Select(no, column))

    def _IsNewArray(self, value: Any) -> bool:
        is_array = isinstance(value, np.ndarray) and value.flags.writeable
        return is_array and np.asarray(value).dtype.kind in "fO" and self._IsNew(value)

    def _IsNew(self, value: Any) -> bool:
        """Returns whether a list or an array shares nothing with any other one."""
        is_part = self._known.Shares(value) or any(
            AreShared(value, x) for x in self._new
        )
        self._new.append(value)
        return not is_part
