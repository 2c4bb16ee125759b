"""A generated function `evaluate` as a graph of operations, and the graph in LLVM.

The code has no loops, no arrays besides the arguments, and only known types. LLVM
therefore compiles it in a fraction of the time that general code takes.
"""

import itertools
import struct
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.arrays import Indices
from teleop_drake.jit.following import Follow
from teleop_drake.jit.symbolic_arrays import (
    AsNumbers,
    Numbers,
    Table,
)
from teleop_drake.jit.symbols import (
    COMPARISONS,
    AsReal,
    Number,
    Ref,
    Untraceable,
)
from teleop_drake.jit.tracing import Graph, Node

Stores = dict[tuple[str, int], Any]

FLOAT = "double"
INTEGER = "i64"
BOOLEAN = "i1"
NOTHING = "void"

LIBRARY_FUNCTIONS = (
    "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh",
    "tanh", "pow",
)  # fmt: skip
"""The functions of C's mathematics library that the code may call."""

_INTRINSICS = (
    "sqrt", "fabs", "floor", "ceil", "trunc", "exp", "log", "sin", "cos", "pow",
)  # fmt: skip
_WITH_TWO_SIDES = ("pow", "atan2")

# The operations that are one instruction; further operands follow.
_INSTRUCTIONS = {
    "neg": "fneg double ",
    "not": "xor i1 true, ",
    "and": "and i1 ",
    "or": "or i1 ",
}


def Declarations() -> list[str]:
    """Returns the declarations of all functions that Instruction() may call."""
    return [
        f"declare double @{_FunctionOf(name)}({_Doubles(name)})"
        for name in dict.fromkeys((*_INTRINSICS, *LIBRARY_FUNCTIONS))
    ]


def _FunctionOf(operation: str) -> str:
    return f"llvm.{operation}.f64" if operation in _INTRINSICS else operation


def _Doubles(name: str) -> str:
    return "double, double" if name in _WITH_TWO_SIDES else "double"


def Instruction(operation: str, kind: str, values: Sequence[str]) -> str:
    """Returns an operation on numbers of a type in LLVM's language."""
    operands = ", ".join(values)
    prefix = "f" if kind == FLOAT else ""
    if operation in ("add", "sub", "mul", "div"):
        return f"{prefix}{operation} {kind} {operands}"
    if operation in COMPARISONS:
        is_ordered = operation not in ("eq", "ne")
        if kind != FLOAT:
            return f"icmp {'s' * is_ordered}{operation} {kind} {operands}"
        # What is not a number differs from every number.
        return f"fcmp {'u' if operation == 'ne' else 'o'}{operation} double {operands}"
    if operation == "select":
        condition, yes, no = values
        return f"select i1 {condition}, {kind} {yes}, {kind} {no}"
    if operation in _INSTRUCTIONS:
        return _INSTRUCTIONS[operation] + operands
    doubles = ", ".join(f"double {value}" for value in values)
    return f"call double @{_FunctionOf(operation)}({doubles})"


def ConstantText(value: Any) -> str:
    """Returns a number in LLVM's language."""
    if isinstance(value, (bool, int)):
        return str(value).lower()
    return "0x" + struct.pack(">d", value).hex().upper()


class CodeWriter:
    """Writes instructions, each of which names its value.

    Attributes:
        lines: What is written.
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._num_names = 0

    def NewName(self) -> str:
        """Returns a name that is not used yet, without the % of a value."""
        self._num_names += 1
        return f"v{self._num_names}"

    def Do(self, instruction: str) -> str:
        """Writes an instruction and returns the name of its value."""
        name = f"%{self.NewName()}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def Store(self, kind: str, value: str, pointer: str) -> None:
        """Writes a value of a type to memory."""
        self.lines.append(f"  store {kind} {value}, ptr {pointer}")


class ScalarProgram(NamedTuple):
    """The operands that `evaluate` writes, with their places, always or on demand."""

    graph: Graph
    stores: Stores
    more_stores: Stores


def TraceProgram(
    text: str,
    names: dict[str, Callable[..., Any]],
    sizes: tuple[int, int, int],
    num_parameters: int,
    integers: Indices,
) -> ScalarProgram:
    """Returns what a generated function `evaluate` computes, with y, x and m of sizes.

    Its integers q are part of the structure.
    """
    graph = Graph()
    num_y, num_x, num_m = sizes
    x = _Given(graph, "x", num_x)
    m = _Given(graph, "m", num_m)
    p = _Given(graph, "p", num_parameters)
    p.flags.writeable = False
    y = _Given(graph, "y", num_y)
    dx = _Given(graph, "dx", num_x)
    q = integers.copy().view(Table)
    arrays = {"dx": dx, "y": y}
    states: list[Stores] = []

    class Everything:
        """Asked whether it is wanted, notes what has been computed until then."""

        def __bool__(self) -> bool:
            states.append(_Changes(graph, arrays))
            return True

    traced: dict[str, Any] = {
        name: Follow(graph, function, name) for name, function in names.items()
    }
    traced["put"] = names["put"]  # It writes into its arguments, and is no law.
    exec(text, traced)
    traced["evaluate"](graph.Add("load", "t", 0), x, m, p, q, y, dx, Everything())
    if not states:
        raise Untraceable("it does not say what is wanted in any case")
    stores = states[0]
    more = {
        place: operand
        for place, operand in _Changes(graph, arrays).items()
        if stores.get(place) != operand
    }
    return ScalarProgram(graph, stores, more)


def TraceLaw(law: FunctionType, samples: Sequence[Any]) -> ScalarProgram:
    """Returns what a law computes: from p, its arguments in a row, dx, its result.

    The samples are arguments like those it will get. Whole numbers and arrays of them
    are not in p: they are part of the structure.
    """
    graph = Graph(is_given_finite=False)
    places = itertools.count()

    def Argument(sample: Any) -> Any:
        if isinstance(sample, tuple):
            items = map(Argument, sample)
            is_named = hasattr(sample, "_fields")
            return type(sample)(*items) if is_named else tuple(items)
        if IsWhole(sample):
            is_array = isinstance(sample, np.ndarray)
            return sample.view(Table) if is_array else sample
        numbers = [graph.Add("load", "p", next(places)) for _ in range(np.size(sample))]
        return AsNumbers(numbers).reshape(np.shape(sample))[()]

    arguments = [Argument(sample) for sample in samples]
    result = np.asarray(Follow(graph, law, law.__name__)(*arguments), object)
    if not all(isinstance(x, (Number, int, float, np.generic)) for x in result.flat):
        raise Untraceable(f"{law.__name__}() returns something else than numbers")
    stores = {("dx", i): _Operand(value) for i, value in enumerate(result.flat)}
    return ScalarProgram(graph, stores, {})


def IsWhole(value: Any) -> bool:
    """Returns whether a value is a whole number, or an array of them."""
    return bool(np.asarray(value).dtype.kind in "iub")


def _Given(graph: Graph, name: str, size: int) -> Numbers:
    return AsNumbers([graph.Add("load", name, i) for i in range(size)])


def _Changes(graph: Graph, arrays: dict[str, Numbers]) -> Stores:
    """Returns the elements of arrays that have changed, by their places."""
    changes = {}
    for name, array in arrays.items():
        for i, value in enumerate(array):
            operand = _Operand(value)
            if operand != graph.Add("load", name, i).ref:
                changes[name, i] = operand
    return changes


def _Operand(value: Any) -> Any:
    value = AsReal(value)
    return value.ref if isinstance(value, Number) else value


def MakeCode(program: ScalarProgram) -> str:
    """Returns the source of `evaluate` in LLVM's language.

    It takes t, pointers to x, m, p, q, y and dx, and whether everything is wanted. It
    has no use for q, whose numbers are in the code."""
    writer = _GraphWriter(program.graph.nodes)
    writer.StoreAll(program.stores)
    writer.lines += ["  br i1 %wants, label %more, label %done", "more:"]
    writer.StoreAll(program.more_stores)
    writer.lines += ["  br label %done", "done:", "  ret void", "}"]
    return "\n".join([*Declarations(), _HEAD, *writer.lines, ""])


_HEAD = """
define void @evaluate(
  double %t, ptr %x, ptr %m, ptr %p, ptr %q, ptr %y, ptr %dx, i32 %all) {
entry:
  %wants = trunc i32 %all to i1"""


class _GraphWriter(CodeWriter):
    """Writes the operations of a graph, each where it is first needed."""

    def __init__(self, nodes: Sequence[Node]):
        super().__init__()
        self._nodes = nodes
        # Of the nodes that are computed already.
        self._names: dict[int, str] = {}

    def StoreAll(self, stores: Stores) -> None:
        """Writes what computes values and puts them where they belong."""
        for (name, i), value in stores.items():
            if isinstance(value, Ref):
                self._Compute(value.place)
            self.Store(FLOAT, self._Operand(value), self._Pointer(name, i))

    def _Compute(self, place: int) -> None:
        """Writes a node, after those that it depends on and that are not known yet."""
        needed: set[int] = set()
        pending = [place]
        while pending:
            place = pending.pop()
            if place not in needed and place not in self._names:
                needed.add(place)
                arguments = self._nodes[place].arguments
                pending += [x.place for x in arguments if isinstance(x, Ref)]
        for place in sorted(needed):
            self._names[place] = self._Node(*self._nodes[place])

    def _Operand(self, argument: Any) -> str:
        """Returns a constant, or the name of a node that is computed."""
        if isinstance(argument, Ref):
            return self._names[argument.place]
        is_boolean = isinstance(argument, (bool, np.bool_))
        return ConstantText((bool if is_boolean else float)(argument))

    def _Pointer(self, array: str, i: int) -> str:
        return self.Do(f"getelementptr double, ptr %{array}, i64 {i}")

    def _Node(self, operation: str, arguments: Sequence[Any]) -> str:
        """Writes an operation and returns the name of its value."""
        if operation != "load":
            values = [self._Operand(argument) for argument in arguments]
            return self.Do(Instruction(operation, FLOAT, values))
        array, i = arguments
        if array == "t":
            return "%t"
        return self.Do(f"load double, ptr {self._Pointer(array, i)}")
