"""Traces programs and laws, and writes their graphs of operations in LLVM's language.

The code has no loops, no arrays besides the arguments, and only known types. LLVM
therefore compiles it in a fraction of the time that general code takes.
"""

import struct
from collections.abc import Callable, Iterable, Sequence
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.loops.jit.following import Follow
from teleop_drake.loops.jit.packing import Layout
from teleop_drake.loops.jit.symbolic_arrays import (
    SEARCH,
    AsNumbers,
    Numbers,
)
from teleop_drake.loops.jit.symbols import (
    COMPARISONS,
    AsReal,
    Number,
    Ref,
    Untraceable,
)
from teleop_drake.loops.jit.tracing import Graph, Node

# The value, a node or a constant, of elements of arrays: by the array's name and index.
Stores = dict[tuple[str, int], Any]

# The values of `wanted`, which select the results of `evaluate`. RATE: the rate, and
# the signals on which it and the delays depend. ALL: the rate and all signals. SIGNALS:
# all signals without the rate. The function in Python always computes the rate.
RATE = 0
ALL = 1
SIGNALS = 2

FLOAT = "double"
INTEGER = "i64"
BOOLEAN = "i1"
NOTHING = "void"

_INTRINSICS = (
    "sqrt", "fabs", "floor", "ceil", "trunc", "exp", "log", "sin", "cos", "pow",
)  # fmt: skip
# The functions of C's mathematics library that have no intrinsic.
_LIBRARY_FUNCTIONS = (
    "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "fmod", "hypot",
)  # fmt: skip
_WITH_TWO_SIDES = ("pow", "atan2", "fmod", "hypot")

# Operations with an instruction of their own, to which the operands are appended.
_INSTRUCTIONS = {
    "neg": "fneg double ",
    "not": "xor i1 true, ",
    "and": "and i1 ",
    "or": "or i1 ",
}


def Declarations() -> list[str]:
    """Returns the declarations of all functions that Instruction() may call."""
    declarations = []
    for name in (*_INTRINSICS, *_LIBRARY_FUNCTIONS):
        doubles = "double, double" if name in _WITH_TWO_SIDES else "double"
        declarations.append(f"declare double @{_FunctionOf(name)}({doubles})")
    return declarations


def _FunctionOf(operation: str) -> str:
    return f"llvm.{operation}.f64" if operation in _INTRINSICS else operation


def Instruction(operation: str, kind: str, values: Sequence[str]) -> str:
    """Returns LLVM's instruction for an operation on numbers of a type.

    Args:
        operation: The name of the operation, as in tracing.Node.
        kind: The type of the numbers.
        values: The operands in LLVM's language.
    """
    operands = ", ".join(values)
    prefix = "f" if kind == FLOAT else ""
    if operation in ("add", "sub", "mul", "div"):
        return f"{prefix}{operation} {kind} {operands}"
    if operation in COMPARISONS:
        is_ordered = operation not in ("eq", "ne")
        if kind != FLOAT:
            return f"icmp {'s' * is_ordered}{operation} {kind} {operands}"
        # nan differs from every number; all other comparisons with it are false.
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
        lines: The instructions and labels so far.
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
    """The traced form of a program or a law.

    Attributes:
        graph: The operations.
        stores: The value of each element of dx and y that the first part of the program
            computes, keyed by the array's name and the index.
        more_stores: The value of each further element, of the second part.
    """

    graph: Graph
    stores: Stores
    more_stores: Stores


class Arrays(NamedTuple):
    """The arrays of a program, see engine.program: of floats, or of a graph's Numbers.

    Attributes:
        t: The time in s.
        x: Continuous state.
        m: Discrete state.
        p: The parameters that are floats.
        y: Signals, which the program computes.
        dx: Rate of the continuous state, which the program computes.
        follow: A function that returns what the program calls for a law: the law itself
            or, when the program is traced, the copy that records operations.
    """

    t: Any
    x: Any
    m: Any
    p: Any
    y: Any
    dx: Any
    follow: Callable[[Any], Any] = lambda function: function


def TraceProgram(
    parts: Sequence[Callable[[Arrays], None]],
    sizes: tuple[int, int, int],
    num_parameters: int,
) -> ScalarProgram:
    """Traces the two parts of a program.

    Args:
        parts: The part that is always executed, and the part that is executed unless
            only RATE is wanted.
        sizes: The lengths of y, x and m.
        num_parameters: The length of p.
    """
    graph = Graph()
    num_y, num_x, num_m = sizes
    arrays = Arrays(
        t=graph.Add("load", "t", 0),
        x=_Given(graph, "x", num_x),
        m=_Given(graph, "m", num_m),
        p=_Given(graph, "p", num_parameters),
        y=_Given(graph, "y", num_y),
        dx=_Given(graph, "dx", num_x),
        follow=lambda law: Follow(graph, law, getattr(law, "__name__", "a function")),
    )
    arrays.p.flags.writeable = False
    needed, others = parts
    needed(arrays)
    stores = _Changes(graph, arrays)
    others(arrays)
    more = {
        place: operand
        for place, operand in _Changes(graph, arrays).items()
        if stores.get(place) != operand
    }
    return ScalarProgram(graph, stores, more)


def TraceLaw(
    law: FunctionType, layouts: Sequence[Layout], num_parameters: int
) -> ScalarProgram:
    """Traces a law as a program that reads the law's arguments from p.

    The result is written into dx. Whole numbers and arrays of them are not in p but
    constants of the graph.

    Args:
        law: The law.
        layouts: The places of its arguments in p.
        num_parameters: The length of p.
    """
    graph = Graph(is_given_finite=False)
    p = _Given(graph, "p", num_parameters)
    arguments = [layout.In(p) for layout in layouts]
    result = np.asarray(Follow(graph, law, law.__name__)(*arguments), object)
    if not all(isinstance(x, (Number, int, float, np.generic)) for x in result.flat):
        raise Untraceable(f"{law.__name__}() returns something else than numbers")
    stores = {("dx", i): _Operand(value) for i, value in enumerate(result.flat)}
    return ScalarProgram(graph, stores, {})


def _Given(graph: Graph, name: str, size: int) -> Numbers:
    return AsNumbers(graph.Given(name, size))


def _Changes(graph: Graph, arrays: Arrays) -> Stores:
    """Returns the elements of dx and y that a program has changed, by their places."""
    changes = {}
    for name in ("dx", "y"):
        for i, value in enumerate(getattr(arrays, name)):
            operand = _Operand(value)
            if operand != graph.Add("load", name, i).ref:
                changes[name, i] = operand
    return changes


def _Operand(value: Any) -> Any:
    value = AsReal(value)
    return value.ref if isinstance(value, Number) else value


def MakeCode(program: ScalarProgram) -> str:
    """Returns the source of `evaluate` in LLVM's language.

    It takes t, pointers to x, m, p, y and dx, and `wanted`: RATE, ALL or SIGNALS. After
    the operations that are always needed, the code has two parts behind conditions:
    `rate` and `more`.
    """
    more = program.more_stores
    writer = _GraphWriter(program.graph.nodes)
    signals = {place: x for place, x in program.stores.items() if place[0] != "dx"}
    of_signals = writer.NeededBy(signals | more)
    # The rates with operations that the signals do not need. Only these are skipped if
    # the rate is not wanted, because the others cost nothing.
    rates = {
        place: x
        for place, x in program.stores.items()
        if place not in signals and isinstance(x, Ref) and x.place not in of_signals
    }
    writer.StoreAll({p: x for p, x in program.stores.items() if p not in rates})
    # Operations that both parts need are written before them.
    writer.Compute(writer.NeededBy(rates) & writer.NeededBy(more))
    writer.lines += [
        f"  %wants_rate = icmp ne i32 %wanted, {SIGNALS}",
        f"  %wants_more = icmp ne i32 %wanted, {RATE}",
        "  br i1 %wants_rate, label %rate, label %signals",
        "rate:",
    ]
    writer.StoreAll(rates)
    writer.lines += [
        "  br label %signals",
        "signals:",
        "  br i1 %wants_more, label %more, label %done",
        "more:",
    ]
    writer.StoreAll(more)
    writer.lines += ["  br label %done", "done:", "  ret void", "}"]
    searches = [SEARCH] if writer.has_searches else []
    return "\n".join([*Declarations(), *searches, _HEAD, *writer.lines, ""])


_HEAD = """
define void @evaluate(
  double %t, ptr %x, ptr %m, ptr %p, ptr %y, ptr %dx, i32 %wanted) {
entry:"""


class _GraphWriter(CodeWriter):
    """Writes the operations of a graph, each where it is first needed.

    Attributes:
        has_searches: Whether the code searches a table.
    """

    def __init__(self, nodes: Sequence[Node]):
        super().__init__()
        self.has_searches = False
        self._nodes = nodes
        # The names of the nodes that are written so far.
        self._names: dict[int, str] = {}

    def StoreAll(self, stores: Stores) -> None:
        """Writes the operations of values, and stores the values at their places."""
        for (name, i), value in stores.items():
            self.Compute(self.NeededBy({(name, i): value}))
            self.Store(FLOAT, self._Operand(value), self._Pointer(name, i))

    def NeededBy(self, stores: Stores) -> set[int]:
        """Returns the nodes on which values depend and that are not written yet."""
        needed: set[int] = set()
        pending = list(stores.values())
        while pending:
            value = pending.pop()
            if not isinstance(value, Ref):
                continue
            if value.place not in needed and value.place not in self._names:
                needed.add(value.place)
                pending += self._nodes[value.place].arguments
        return needed

    def Compute(self, places: Iterable[int]) -> None:
        """Writes nodes, each after its arguments."""
        for place in sorted(places):
            self._names[place] = self._Node(*self._nodes[place])

    def _Operand(self, argument: Any) -> str:
        """Returns a constant, or the name of a node that is written."""
        if isinstance(argument, Ref):
            return self._names[argument.place]
        is_boolean = isinstance(argument, (bool, np.bool_))
        return ConstantText((bool if is_boolean else float)(argument))

    def _Pointer(self, array: str, i: int) -> str:
        return self.Do(f"getelementptr double, ptr %{array}, i64 {i}")

    def _Node(self, operation: str, arguments: Sequence[Any]) -> str:
        """Writes an operation and returns the name of its value."""
        if operation == "lookup":
            return self._Lookup(*arguments)
        if operation in ("search_left", "search_right"):
            return self._Search(operation == "search_right", *arguments)
        if operation != "load":
            values = [self._Operand(argument) for argument in arguments]
            return self.Do(Instruction(operation, FLOAT, values))
        array, i = arguments
        if array == "t":
            return "%t"
        return self.Do(f"load double, ptr {self._Pointer(array, i)}")

    def _Search(self, is_right: bool, first: int, count: int, x: Any) -> str:
        """Writes the search of a table, which begins at p[first]."""
        self.has_searches = True
        operands = (
            f"ptr {self._Pointer('p', first)}",
            f"{INTEGER} {count}",
            f"{FLOAT} {self._Operand(x)}",
            f"{BOOLEAN} {ConstantText(is_right)}",
        )
        return self.Do(f"call double @search({', '.join(operands)})")

    def _Lookup(self, first: int, distance: int, count: int, index: Any) -> str:
        """Writes p[first + distance index]; nan unless the table has the index."""
        index = self._Operand(index)
        is_low = self.Do(f"fcmp oge double {index}, {ConstantText(0.0)}")
        is_high = self.Do(f"fcmp olt double {index}, {ConstantText(float(count))}")
        is_inside = self.Do(f"and i1 {is_low}, {is_high}")
        zero = ConstantText(0.0)
        safe = self.Do(f"select i1 {is_inside}, double {index}, double {zero}")
        row = self.Do(f"fptosi double {safe} to i64")
        whole = self.Do(f"sitofp i64 {row} to double")
        is_whole = self.Do(f"fcmp oeq double {whole}, {safe}")
        step = self.Do(f"mul i64 {row}, {distance}")
        begin = self._Pointer("p", first)
        place = self.Do(f"getelementptr double, ptr {begin}, i64 {step}")
        value = self.Do(f"load double, ptr {place}")
        nan = ConstantText(float("nan"))
        is_good = self.Do(f"and i1 {is_inside}, {is_whole}")
        return self.Do(f"select i1 {is_good}, double {value}, double {nan}")
