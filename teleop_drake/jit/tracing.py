"""Functions of numbers as graphs of operations, found by calling them.

A function of arrays is called with arrays of `Number`s. Its operations on them are
recorded as a graph of operations on single numbers, without loops, views, products of
matrices and calls of helpers.

Where a function branches on a comparison, it is called once for each result. The
results form a tree, and the graph selects the value of the one leaf whose conditions
hold. All leaves are computed. The calls of each helper are merged separately, so that
the numbers of leaves add up and do not multiply. A helper is not merged if its branches
differ in more than numbers, for example in what they append to a list. Its conditions
then become conditions of its caller.

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
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.jit.contents import AreShared, Contents, Reshaped
from teleop_drake.jit.symbolic_arrays import (
    AsNumbers,
    Objects,
    Where,
)
from teleop_drake.jit.symbols import (
    COMPARISONS,
    AsReal,
    IsBoolean,
    Number,
    Ref,
    Untraceable,
)

# Operations whose value is a boolean.
_BOOLEAN = COMPARISONS | {"and", "or", "not"}

# Operations that take booleans without conversion.
_OF_BOOLEANS = frozenset({"and", "or", "not", "select", "load"})

# Operations whose value is finite if their arguments are finite.
_FINITE = frozenset(
    {"add", "sub", "mul", "neg", "fabs", "select", "floor", "ceil", "trunc", "rint"}
    | {"sin", "cos", "atan", "atan2", "tanh", "copysign"}
)

# A function with more leaves or operations than this is not worth a graph.
_MAX_LEAVES = 256
_MAX_NODES = 100_000

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


class _Leaf(NamedTuple):
    """One way through a function.

    Attributes:
        path: The conditions, with their answers.
        values: The numbers that it returns, and those that it leaves in its arguments.
    """

    path: list[tuple[Ref, bool]]
    values: list[Any]


class _Way(NamedTuple):
    """The way that is being traced.

    Attributes:
        answers: What is assumed, also by callers.
        path: The conditions in the order in which they were met, with their answers.
        forced: The answers to the first of them; to all others it is yes.
    """

    answers: dict[Ref, bool]
    path: list[tuple[Ref, bool]]
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
    _booleans: set[int] = field(default_factory=set)
    _infinite: set[int] = field(default_factory=set)
    # Whether the function that is being traced is one of the package.
    _is_of_package: bool = True
    # None outside of functions.
    _way: _Way | None = None

    def Add(self, operation: str, *arguments: Any) -> "Number":
        """Returns the value of an operation on numbers, also those of Python."""
        takes_booleans = operation in _OF_BOOLEANS
        operands: list[Any] = []
        for value in arguments:
            if isinstance(value, Number):
                operands.append(self._RefOf(value, takes_booleans))
            elif value == 0.0 and str(value) == "-0.0" and operation != "neg":
                # Else it would be taken for 0.0.
                operands.append(self.Add("neg", 0.0).ref)
            elif IsBoolean(value) and not takes_booleans:
                operands.append(float(value))
            else:
                operands.append(value)
        node = Node(operation, tuple(operands))
        if node not in self._places:
            self._CheckCaller()
            self._places[node] = self._Append(node)
        place = self._places[node]
        return Number(self, place, place.place in self._booleans)

    def _RefOf(self, value: Number, takes_booleans: bool) -> Ref:
        if value.graph is not self:
            raise Untraceable("it keeps a number from another call")
        if value.is_boolean and not takes_booleans:
            value = AsReal(value)
        return value.ref

    def _Append(self, node: Node) -> Ref:
        if len(self.nodes) >= _MAX_NODES:
            raise Untraceable("there are too many operations")
        place = len(self.nodes)
        self.nodes.append(node)
        if node.operation in _BOOLEAN:
            self._booleans.add(place)
        elif not self._IsFinite(node):
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
        if node.operation == "load":
            return self.is_given_finite
        if not self._is_of_package or node.operation not in _FINITE:
            return False
        for operand in node.arguments:
            if isinstance(operand, Ref):
                if operand.place in self._infinite:
                    return False
            elif not abs(operand) < math.inf:
                return False
        return True

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
        if way is not None and condition in way.answers:
            return way.answers[condition]
        if way is None:
            raise Untraceable("a condition stands outside of a function")
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
        # A result that has no caller is only read.
        known = before if is_helper else None
        leaves: list[_Leaf] = []
        first: Any = None
        shape: Any = None
        forced: list[bool] | None = []
        while forced is not None:
            result, path = self._CallOneWay(function, arguments, keywords, forced)
            if not path and not leaves:  # There is only one branch.
                return result
            # All ways have to do the same, but for numbers.
            if is_helper and _HasAliases(result, before):
                raise MustJoinCaller(function.__code__)
            shape_here, values = _Flat(result, known)
            if not leaves:
                first = result
                shape = shape_here
            is_changed = before.Changed(with_numbers=False)
            if is_changed or shape_here != shape:
                if is_helper:
                    raise MustJoinCaller(function.__code__)
                what = "changes" if is_changed else "returns"
                raise Untraceable(f"what it {what} depends on its numbers")
            # Its arguments are results, too, and the next way gets them as they were.
            values += [x for array in arrays for x in np.asarray(array).flat]
            leaves.append(_Leaf(path, values))
            if len(leaves) > _MAX_LEAVES:
                raise Untraceable(_TOO_MANY_CASES)
            before.Restore(arrays)
            forced = _NextWay(path)
        merged = iter(self._Merge(leaves))
        result = _Unflat(first, shape, merged)
        for array in arrays:
            written = [next(merged) for _ in range(array.size)]
            np.asarray(array)[...] = Reshaped(written, array.shape)
        return result

    def _CallOneWay(
        self,
        function: FunctionType,
        arguments: Sequence[Any],
        keywords: dict[str, Any],
        forced: list[bool],
    ) -> tuple[Any, list[tuple[Ref, bool]]]:
        """Returns what a function returns on one way, and the conditions of that."""
        outer = self._way
        answers = {} if outer is None else dict(outer.answers)
        way = _Way(answers, [], forced)
        self._way = way
        try:
            return function(*arguments, **keywords), way.path
        finally:
            self._way = outer

    def _Merge(self, leaves: list[_Leaf], depth: int = 0) -> list[Any]:
        """Returns the values of the one leaf whose conditions hold."""
        path, values = leaves[0]
        if len(path) == depth:
            return values
        condition = Number(self, path[depth][0], True)
        yes = self._Merge([x for x in leaves if x.path[depth][1]], depth + 1)
        no = self._Merge([x for x in leaves if not x.path[depth][1]], depth + 1)
        return [Where(condition, *pair) for pair in zip(yes, no, strict=True)]


def _NextWay(path: list[tuple[Ref, bool]]) -> list[bool] | None:
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


def _HasAliases(value: Any, known: Contents) -> bool:
    """Returns whether a new list or array is in a result twice, or parts of it are."""
    lists: list[Any] = []
    arrays: list[Any] = []
    pending = [value]
    while pending:
        item = pending.pop()
        if isinstance(item, np.ndarray) and not known.Shares(item):
            if any(AreShared(item, other) for other in arrays):
                return True
            arrays.append(item)
        elif isinstance(item, (tuple, list)) and not known.Has(item):
            if isinstance(item, list):
                if any(item is other for other in lists):
                    return True
                lists.append(item)
            pending += item
    return False


def _Flat(value: Any, known: Contents | None) -> tuple[Any, list[Any]]:
    """Returns what a value is made of, and the numbers in it that may differ.

    Args:
        known: Its arguments. What is part of them is no new value. None: that does not
            matter, and neither does what kind of numbers there are.
    """
    if isinstance(value, (Number, int, float, np.generic)):
        return ("number", known is not None and IsBoolean(value)), [value]
    if isinstance(value, (tuple, list)) and not (known and value and known.Has(value)):
        shapes = []
        values = []
        for item in value:
            shape, inner = _Flat(item, known)
            shapes.append(shape)
            values += inner
        return (type(value), *shapes), values
    if isinstance(value, np.ndarray):
        return _FlatArray(value, known)
    return ("same", id(value)), []


def _FlatArray(value: Any, known: Contents | None) -> tuple[Any, list[Any]]:
    plain = np.asarray(value)
    if known is None:
        return ("array", plain.shape), list(Objects(plain).flat)
    if known.Shares(value):
        address = plain.__array_interface__["data"]
        return ("view", address, plain.strides, plain.shape), []
    if plain.dtype.kind in "fO":
        items = list(Objects(plain).flat)
        return ("array", plain.shape, any(map(IsBoolean, items))), items
    return ("table", plain.shape, plain.dtype, plain.tobytes()), []


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
