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

import contextlib
import dis
import functools
import math
import pickle
import random
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import (
    BuiltinFunctionType,
    CellType,
    CodeType,
    FunctionType,
    MethodType,
    ModuleType,
)
from typing import Any, NamedTuple, TypeVar

import numpy as np

from teleop_drake.machine_code.symbols import (
    AsNumbers,
    AsReal,
    IsBoolean,
    IsSame,
    Number,
    Ref,
    Table,
    Untraceable,
)
from teleop_drake.machine_code.traced_numpy import BUILTINS, REPLACED, OfNumpy, Refusing

T = TypeVar("T")

# Operations whose value is yes or no.
BOOLEAN = frozenset({"lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not"})

# Those that take yes or no as it is.
_OF_BOOLEANS = frozenset({"and", "or", "not", "select", "merge", "load"})

# Those whose value is finite if their arguments are.
_FINITE = frozenset(
    {"add", "sub", "mul", "neg", "fabs", "select", "floor", "ceil", "trunc"}
    | {"rint", "sin", "cos", "atan", "atan2", "tanh", "copysign"}
)

# A function with more leaves or operations than this is not worth a graph.
_MAX_LEAVES = 256
_MAX_NODES = 100_000

_TOO_MANY_CASES = "there are too many cases, as in a loop until numbers have converged"


class _MustJoinCaller(BaseException):
    """A helper whose ways have to be ways of its caller.

    Attributes:
        args: Its code.
    """


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
        is_given_finite: Whether what is given is finite: then 0 times it is 0.
        nodes: Each after those that it takes.
        merges: The trees that nodes named "merge" take their values from.
        followed: The functions that are traced, by what they stand for.
        codes: What may work with numbers: the code of these functions.
        joined: The code of those that are not merged; see _MustJoinCaller.
        surroundings: What they have from outside, by its name, as it was at first.
    """

    is_given_finite: bool = True
    nodes: list[Node] = field(default_factory=list)
    merges: list[Branch] = field(default_factory=list)
    followed: dict[Any, "_Followed"] = field(default_factory=dict)
    codes: set[CodeType] = field(default_factory=set)
    joined: set[CodeType] = field(default_factory=set)
    surroundings: "dict[int, _Surrounding]" = field(default_factory=dict)
    _places: dict[Node, Ref] = field(default_factory=dict)
    _booleans: set[int] = field(default_factory=set)
    _infinite: set[int] = field(default_factory=set)
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

    def IsBoolean(self, place: int) -> bool:
        """Returns whether the value of a node is a yes or no."""
        return place in self._booleans

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
        before = _Contents((arguments, keywords))
        arrays = [x for x in before.arrays if x.size and x.flags.writeable]
        outer = self._answers, self._path, self._forced
        forced: list[bool] = []
        leaves: list[tuple[list[tuple[Ref, bool]], tuple[Any, ...]]] = []
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
                        raise _MustJoinCaller(code)
                    what = "changes" if is_changed else "returns"
                    raise Untraceable(f"what it {what} depends on its numbers")
                values += [x for array in arrays for x in np.asarray(array).flat]
                leaves.append((self._path, tuple(values)))
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
            np.asarray(array)[...] = _Reshaped(written, array.shape)
        return _Unflat(first, shape, iter(values))

    def _Merge(
        self, leaves: list[tuple[list[tuple[Ref, bool]], tuple[Any, ...]]]
    ) -> list[Any]:
        """Returns the values of the one leaf whose conditions hold."""
        columns = list(zip(*(values for _, values in leaves), strict=True))
        different = [k for k, column in enumerate(columns) if not IsSame(column)]
        rows = iter([(path, [v[k] for k in different]) for path, v in leaves])
        booleans = [all(IsBoolean(v) for v in columns[k]) for k in different]
        tree = self._Tree(list(rows), 0, booleans)
        assert isinstance(tree, Branch)
        self.merges.append(tree)
        merged = [column[0] for column in columns]
        for place, k in enumerate(different):
            number = self.Add("merge", len(self.merges) - 1, place)
            if booleans[place]:
                self._booleans.add(number.ref.place)
            merged[k] = Number(self, number.ref, booleans[place])
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


@functools.cache
def _IsOwn(code: CodeType) -> bool:
    """Returns whether code is of this folder or of numpy."""
    folders = Path(__file__).parent, Path(np.__file__).parent
    return any(folder in Path(code.co_filename).parents for folder in folders)


class _Contents:
    """What there is in values that can change, as it is now.

    Args:
        value: Where to begin.

    Attributes:
        arrays: Those with Numbers in them.
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

    def Has(self, value: Any) -> bool:
        """Returns whether a value is among them."""
        return id(value) in self._known

    def Shares(self, array: Any) -> bool:
        """Returns whether an array is part of one of them."""
        return any(
            isinstance(value, np.ndarray) and _AreShared(array, value)
            for value, _ in self._known.values()
        )

    def Changed(self, with_numbers: bool = True) -> bool:
        """Returns whether anything has changed, or what has no Numbers in it."""
        arrays = {} if with_numbers else {id(array) for array in self.arrays}
        return any(
            not _AreSame(parts, _Parts(value))
            for i, (value, parts) in self._known.items()
            if i not in arrays
        )

    def Restore(self, values: Sequence[Any] | None = None) -> None:
        """Makes values what they were; None: all that Python lets us."""
        for value, parts in self._known.values():
            if values is not None and not any(value is x for x in values):
                continue
            if isinstance(value, np.ndarray) and value.flags.writeable:
                is_of_objects = parts[0] is _OBJECTS
                old = parts[1:] if is_of_objects else np.frombuffer(*parts)
                np.asarray(value)[...] = _Reshaped(old, value.shape)
            elif isinstance(value, list):
                value[:] = parts[1:]
            elif isinstance(value, (dict, type)):
                half = 1 + len(parts) // 2
                items = dict(zip(parts[1:half], parts[half:], strict=True))
                if isinstance(value, dict):
                    value.clear()
                    value.update(items)
                else:
                    for name, attribute in items.items():
                        setattr(value, name, attribute)
            elif isinstance(value, set):
                value.clear()
                value.update(parts[1:])


_OBJECTS = object()
_PLAIN = str, bytes, int, float, complex, type(None)

# Packages whose classes do not change.
_FOREIGN = "numpy", "pydrake"


def _Parts(value: Any) -> tuple[Any, ...]:
    """Returns what a value is made of; nothing if it cannot change."""
    if isinstance(value, np.ndarray):
        plain = np.asarray(value)
        if plain.dtype == object:
            return _OBJECTS, *plain.flat
        return plain.tobytes(), plain.dtype
    if isinstance(value, dict):
        return dict, *value.keys(), *value.values()
    if isinstance(value, (tuple, list, set)):
        return type(value), *value
    if isinstance(value, FunctionType):
        cells = [x.cell_contents for x in value.__closure__ or () if x != CellType()]
        return FunctionType, *cells, value.__defaults__, value.__kwdefaults__
    if isinstance(value, (MethodType, BuiltinFunctionType)):
        return MethodType, value.__self__
    if isinstance(value, (_Followed, Number, ModuleType, CodeType, *_PLAIN)):
        return ()
    if isinstance(value, type):
        package = value.__module__.split(".")[0]
        if package in sys.stdlib_module_names or package in _FOREIGN:
            return ()
        own = {
            k: x for k, x in vars(value).items() if k[:2] != "__" and not callable(x)
        }
        return type, *own.keys(), *own.values()
    slots = [getattr(value, x) for x in _Slots(value.__class__) if hasattr(value, x)]
    attributes = getattr(value, "__dict__", None)
    if isinstance(attributes, dict) and not isinstance(value, random.Random):
        return type(value), attributes, *slots
    if slots:
        return type(value), *slots
    with contextlib.suppress(Exception):
        return (pickle.dumps(value),)
    return ()


@functools.cache
def _Slots(kind: type) -> tuple[str, ...]:
    names = [vars(base).get("__slots__", ()) for base in kind.__mro__]
    return tuple(x for s in names for x in ((s,) if isinstance(s, str) else s))


def _AreSame(before: tuple[Any, ...], after: tuple[Any, ...]) -> bool:
    return len(before) == len(after) and all(
        a is b or (isinstance(a, bytes) and a == b)
        for a, b in zip(before, after, strict=True)
    )


def _Reshaped(values: Any, shape: tuple[int, ...]) -> Any:
    array = np.empty(len(values), object)
    array[:] = values
    return array.reshape(shape)


def _Flat(value: Any, known: _Contents | None) -> tuple[Any, list[Any]]:
    """Returns what a value is made of, and the numbers in it that may differ.

    Args:
        value: What a function returned.
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
            if is_array and any(_AreShared(item, x) for x in arrays if x is not item):
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


def _AreShared(a: Any, b: Any) -> bool:
    return np.may_share_memory(np.asarray(a), np.asarray(b))


def _Unflat(first: Any, shape: Any, values: Any) -> Any:
    """Returns what is made like the result of the first way, with other numbers."""
    kind, *others = shape
    if kind == "number":
        return next(values)
    if kind == "array":
        size = int(np.prod(others[0]))
        array = AsNumbers(_Reshaped([next(values) for _ in range(size)], others[0]))
        array.flags.writeable = first.flags.writeable
        return array
    if isinstance(kind, str):
        return first
    items = [_Unflat(*x, values) for x in zip(first, others, strict=True)]
    return kind(*items) if hasattr(kind, "_fields") else kind(items)


def Traced(trace: Callable[[Graph], T]) -> T:
    """Returns what tracing returns.

    Args:
        trace: Notes in an empty graph what functions do.

    Raises:
        Untraceable: If they do what a graph cannot, or change anything.
    """
    joined: set[CodeType] = set()
    surroundings: dict[int, _Surrounding] = {}
    try:
        while True:
            graph = Graph(joined=joined, surroundings=surroundings)
            try:
                result = trace(graph)
            except _MustJoinCaller as helper:
                joined |= set(helper.args)
                continue
            for surrounding in surroundings.values():
                if surrounding.contents.Changed():
                    raise surrounding.Refused("it changes")
            return result
    except Untraceable:
        for surrounding in surroundings.values():
            surrounding.contents.Restore()
        raise


# Modules whose functions return another value each time, and such that do not.
_CHANGING = "numpy.random", "random", "secrets", "time", "uuid"
_HARMLESS = "_operator", "_functools", "builtins"


class _Surrounding(NamedTuple):
    """What a function has from outside of it.

    Attributes:
        function: The function; None if there is none yet.
        name: What it calls that.
        contents: What there is in it at first.
    """

    function: FunctionType | None
    name: str
    contents: _Contents

    def Refused(self, why: str) -> Untraceable:
        """Returns an error that says in which line it is mentioned."""
        error = Untraceable(f"{why} {self.name}")
        if self.function is not None:
            line = self.function.__code__.co_firstlineno
            for x in dis.get_instructions(self.function.__code__):
                if x.argval == self.name.split(".")[-1] and x.positions:
                    line = x.positions.lineno or line
                    break
            error.place = f"{self.function.__name__}(), line {line}"
        return error


def Follow(
    graph: Graph, value: Any, name: str, function: FunctionType | None = None
) -> Any:
    """Returns what to use instead of what a function has from outside of it.

    Args:
        graph: Where to note what it does with numbers.
        value: What it has.
        name: What it calls that.
        function: The function; None if there is none yet.
    """
    try:
        if value in REPLACED:
            return REPLACED[value]
    except TypeError:  # It has no hash.
        pass
    if isinstance(value, ModuleType):
        return _Module(graph, value, name, function)
    owner = type(getattr(value, "__self__", None))
    module = getattr(value, "__module__", None) or owner.__module__
    if callable(value) and module.startswith(_CHANGING):
        return Refusing(value, name, always=True)
    if module.split(".")[0] in ("numpy", "math") and callable(value):
        if hasattr(value, "_implementation") or isinstance(value, np.ufunc):
            return OfNumpy(value)
        return value if isinstance(value, type) else Refusing(value, name)
    if isinstance(value, FunctionType):
        if value not in graph.followed:
            graph.followed[value] = _Followed(graph, value)
        return graph.followed[value]
    if isinstance(value, functools.partial):
        followed = Follow(graph, value.func, name, function)
        return functools.partial(followed, *value.args, **value.keywords)
    if isinstance(value, MethodType):
        followed = Follow(graph, value.__func__, name, function)
        return functools.partial(followed, value.__self__)
    if isinstance(value, BuiltinFunctionType) and module not in _HARMLESS:
        return Refusing(value, name, always=True)
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        is_real = value.dtype.kind == "f"
        array = AsNumbers(value) if is_real else value.view(Table)
        array.flags.writeable = False
        return array
    if id(value) not in graph.surroundings:
        surrounding = _Surrounding(function, name, _Contents((value,)))
        if hasattr(value, "__next__"):
            raise surrounding.Refused("it takes from an iterator,")
        graph.surroundings[id(value)] = surrounding
    return value


class _Module:
    """A module whose functions are followed."""

    def __init__(self, graph: Graph, module: ModuleType, name: str, function: Any):
        object.__setattr__(self, "_followed", (graph, module, name, function))

    def __setattr__(self, attribute: str, value: Any) -> None:
        raise Untraceable(f"it assigns to {self._followed[2]}.{attribute}")

    def __getattr__(self, attribute: str) -> Any:
        graph, module, name, function = self._followed
        value = getattr(module, attribute)
        return Follow(graph, value, f"{name}.{attribute}", function)


class _Followed:
    """A function that notes what it and its helpers do.

    Args:
        graph: Where to note it.
        function: The function.
    """

    def __init__(self, graph: Graph, function: FunctionType):
        self._graph, self._function = graph, function
        self._copy: FunctionType | None = None

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        function = self._function
        try:
            copy = self._copy = self._copy or self._Copy()
            return self._graph.Call(copy, arguments, keywords)
        except Exception as error:  # Whatever it does to what is no number.
            line = self._Line(error.__traceback__)
            if not isinstance(error, Untraceable):
                error = Untraceable(f"{type(error).__name__}: {error}")
            error.place = error.place or f"{function.__name__}(), line {line}"
            error.function = function
            raise error from None

    def _Line(self, traceback: Any) -> int:
        line, codes = self._function.__code__.co_firstlineno, self._Codes()
        while traceback is not None:
            if traceback.tb_frame.f_code in codes:
                line = traceback.tb_lineno
            traceback = traceback.tb_next
        return line

    def _Codes(self) -> list[CodeType]:
        """Returns the code of the function, and that of those inside of it."""
        codes = [self._function.__code__]
        for code in codes:
            codes += [x for x in code.co_consts if isinstance(x, CodeType)]
        return codes

    def _Copy(self) -> FunctionType:
        """Returns the function with what it has from outside replaced."""
        function, graph, codes = self._function, self._graph, self._Codes()
        for code in codes:
            _CheckCode(code, code is codes[0])
        graph.codes |= set(codes)

        def Import(name: str, *arguments: Any) -> Any:
            module = __import__(name, *arguments)
            is_of_numpy = isinstance(arguments[2], list)  # As its own code asks.
            return module if is_of_numpy else _Module(graph, module, name, function)

        own = {**BUILTINS, "__import__": Import}
        names = {**function.__globals__, "__builtins__": own}
        for name in {name for code in codes for name in code.co_names} & names.keys():
            names[name] = Follow(graph, names[name], name, function)
        cells = []
        for name, cell in zip(
            function.__code__.co_freevars, function.__closure__ or (), strict=True
        ):
            is_empty = cell == CellType()
            content = () if is_empty else (cell.cell_contents,)
            cells.append(CellType(*(Follow(graph, x, name, function) for x in content)))
        copy = FunctionType(
            function.__code__,
            names,
            function.__name__,
            tuple(
                Follow(graph, value, "a default", function)
                for value in function.__defaults__ or ()
            ),
            tuple(cells),
        )
        copy.__kwdefaults__ = {
            name: Follow(graph, value, name, function)
            for name, value in (function.__kwdefaults__ or {}).items()
        }
        return copy


_REFUSED = {
    "PUSH_EXC_INFO": "it catches errors",
    "MATCH_CLASS": "it asks of which class something is",
    "STORE_GLOBAL": "it assigns to a global variable",
    "DELETE_GLOBAL": "it deletes a global variable",
    "STORE_DEREF": "it assigns to a variable outside of it",
    "IS_OP": "it asks whether something `is` True or False",
}
_REFUSED_NUMBERS = {dis.opmap[name] for name in _REFUSED}


def _CheckCode(code: CodeType, is_outermost: bool) -> None:
    """Refuses what is seen in code without running it."""
    if not _REFUSED_NUMBERS & set(code.co_code[::2]):
        return
    instructions = list(dis.get_instructions(code))
    # `with np.errstate()` catches nothing.
    num_blocks = sum(x.opname == "WITH_EXCEPT_START" for x in instructions)
    num_harmless = sum(x.argval == "errstate" for x in instructions)
    line = code.co_firstlineno
    for before, x in zip([None, *instructions], instructions, strict=False):
        line = (x.positions and x.positions.lineno) or line
        if x.opname not in _REFUSED:
            continue
        if x.opname == "IS_OP" and not (before and isinstance(before.argval, bool)):
            continue
        if x.opname == "STORE_DEREF" and not (
            is_outermost and x.argval in code.co_freevars
        ):
            continue
        if x.opname == "PUSH_EXC_INFO" and num_harmless >= num_blocks > 0:
            num_blocks -= 1
            num_harmless -= 1
            continue
        error = Untraceable(_REFUSED[x.opname])
        error.place = f"{code.co_name}(), line {line}"
        raise error
