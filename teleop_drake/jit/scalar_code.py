"""A generated function `evaluate` as a graph of operations, and the graph in LLVM.

The code has no loops, no arrays besides the arguments, and only known types. LLVM
therefore compiles it in a fraction of the time that general code takes.
"""

from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.arrays import Indices
from teleop_drake.jit.following import Follow, Traced
from teleop_drake.jit.symbolic_arrays import (
    Numbers,
    Table,
)
from teleop_drake.jit.symbols import (
    AsReal,
    Number,
    Ref,
    Untraceable,
)
from teleop_drake.jit.tracing import BOOLEAN, Graph, Node
from teleop_drake.jit.typed_expressions import ConstantText

Stores = dict[tuple[str, int], Any]

LIBRARY_FUNCTIONS = (
    "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh",
    "tanh", "pow", "fmod",
)  # fmt: skip
"""The functions of C's mathematics library that the code may call."""

_INTRINSICS = (
    "sqrt", "fabs", "floor", "ceil", "trunc", "rint", "copysign", "exp", "log", "sin",
    "cos", "pow",
)  # fmt: skip
_WITH_TWO_SIDES = ("pow", "atan2", "fmod", "copysign")
_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_COMPARISONS = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge", "eq": "oeq"}


class ScalarProgram(NamedTuple):
    """The numbers that `evaluate` writes, with their places, always or on demand."""

    graph: Graph
    stores: Stores
    more_stores: Stores


@Traced
def TraceProgram(
    graph: Graph,
    text: str,
    names: dict[str, Callable[..., Any]],
    sizes: tuple[int, int, int],
    num_parameters: int,
    integers: Indices,
) -> ScalarProgram:
    """Returns what a generated function `evaluate` computes, with y, x and m of sizes.

    Its integers q are part of the structure.
    """
    num_y, num_x, num_m = sizes
    x = _Given(graph, "x", num_x)
    m = _Given(graph, "m", num_m)
    p = _Given(graph, "p", num_parameters)
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
    exec(text, traced)
    traced["evaluate"](graph.Add("load", "t", 0), x, m, p, q, y, dx, Everything())
    if not states:
        raise Untraceable("it does not say what is wanted in any case")
    stores = states[0]
    more = {}
    for place, value in _Changes(graph, arrays).items():
        if place not in stores or _Operand(stores[place]) != _Operand(value):
            more[place] = value
    return ScalarProgram(graph, stores, more)


@Traced
def TraceLaw(graph: Graph, law: FunctionType, samples: Sequence[Any]) -> ScalarProgram:
    """Returns what a law computes: from p, its arguments in a row, dx, its result.

    The samples are arguments like those it will get. Whole numbers and arrays of them
    are not in p: they are part of the structure.
    """
    graph.is_given_finite = False
    leaves = LeavesOf(samples)
    p = _Given(graph, "p", sum(np.size(x) for x in leaves if not IsWhole(x)))
    end = 0

    def Argument(sample: Any) -> Any:
        nonlocal end
        if isinstance(sample, tuple):
            items = map(Argument, sample)
            is_named = hasattr(sample, "_fields")
            return type(sample)(*items) if is_named else tuple(items)
        if IsWhole(sample):
            is_array = isinstance(sample, np.ndarray)
            return sample.view(Table) if is_array else sample
        start = end
        end += np.size(sample)
        return p[start:end].reshape(np.shape(sample))[()]

    arguments = [Argument(sample) for sample in samples]
    result = np.asarray(Follow(graph, law, law.__name__)(*arguments), object)
    if not all(isinstance(x, (Number, int, float, np.generic)) for x in result.flat):
        raise Untraceable(f"{law.__name__}() returns something else than numbers")
    return ScalarProgram(
        graph, {("dx", i): value for i, value in enumerate(result.flat)}, {}
    )


def LeavesOf(value: Any) -> list[Any]:
    """Returns the numbers and arrays in (named) tuples and lists of them."""
    if isinstance(value, (tuple, list)):
        return [leaf for item in value for leaf in LeavesOf(item)]
    return [value]


def IsWhole(value: Any) -> bool:
    """Returns whether a value is a whole number, or an array of them."""
    return bool(np.asarray(value).dtype.kind in "iub")


def _Given(graph: Graph, name: str, size: int) -> Numbers:
    array = np.empty(size, object)
    for i in range(size):
        array[i] = graph.Add("load", name, i)
    return array.view(Numbers)


def _Changes(graph: Graph, arrays: dict[str, Numbers]) -> Stores:
    """Returns the elements of arrays that have changed, by their places."""
    changes = {}
    for name, array in arrays.items():
        for i, value in enumerate(array):
            if _Operand(value) != graph.Add("load", name, i).ref:
                changes[name, i] = value
    return changes


def _Operand(value: Any) -> Any:
    value = AsReal(value)
    return value.ref if isinstance(value, Number) else value


def MakeCode(program: ScalarProgram) -> str:
    """Returns the source of `evaluate` in LLVM's language.

    It takes t, pointers to x, m, p, q, y and dx, and whether everything is wanted. It
    has no use for q, whose numbers are in the code."""
    sides = [
        {place: _Operand(value) for place, value in stores.items()}
        for stores in (program.stores, program.more_stores)
    ]
    writer = _Writer(program.graph.nodes)
    writer.Store(sides[0])
    writer.lines += ["  br i1 %wants, label %more, label %done", "more:"]
    writer.Store(sides[1])
    writer.lines += ["  br label %done", "done:", "  ret void", "}"]
    declarations = [
        f"declare double @llvm.{name}.f64({_Doubles(name)})" for name in _INTRINSICS
    ] + [
        f"declare double @{name}({_Doubles(name)})"
        for name in LIBRARY_FUNCTIONS
        if name not in _INTRINSICS
    ]
    return "\n".join([*declarations, _HEAD, *writer.lines, ""])


def _Doubles(name: str) -> str:
    return "double, double" if name in _WITH_TWO_SIDES else "double"


_HEAD = """
define void @evaluate(
  double %t, ptr %x, ptr %m, ptr %p, ptr %q, ptr %y, ptr %dx, i32 %all) {
entry:
  %wants = trunc i32 %all to i1"""


class _Writer:
    """Writes the operations of a graph as lines, each where it is first needed."""

    def __init__(self, nodes: Sequence[Node]):
        self.lines: list[str] = []
        self._nodes = nodes
        # Of the nodes that are computed already.
        self._names: dict[int, str] = {}
        self._num_names = 0

    def Store(self, stores: Stores) -> None:
        """Writes what computes values and puts them where they belong."""
        for (name, i), value in stores.items():
            if isinstance(value, Ref):
                self._Compute(value.place)
            operand = self._Operand(value)
            pointer = self._Pointer(name, i)
            self.lines.append(f"  store double {operand}, ptr {pointer}")

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
            self._names[place] = self._Instruction(*self._nodes[place])

    def _Operand(self, argument: Any) -> str:
        """Returns a constant, or the name of a node that is computed."""
        if isinstance(argument, Ref):
            return self._names[argument.place]
        is_boolean = isinstance(argument, (bool, np.bool_))
        return ConstantText((bool if is_boolean else float)(argument))

    def _Assign(self, instruction: str) -> str:
        self._num_names += 1
        name = f"%v{self._num_names}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def _Pointer(self, array: str, i: int) -> str:
        return self._Assign(f"getelementptr double, ptr %{array}, i64 {i}")

    def _Instruction(self, operation: str, arguments: Sequence[Any]) -> str:
        """Writes an operation and returns the name of its value."""
        if operation == "load":
            array, i = arguments
            if array == "t":
                return "%t"
            return self._Assign(f"load double, ptr {self._Pointer(array, i)}")
        values = [self._Operand(argument) for argument in arguments]
        if operation in _ARITHMETIC:
            return self._Assign(f"{_ARITHMETIC[operation]} double {', '.join(values)}")
        if operation == "neg":
            return self._Assign(f"fneg double {values[0]}")
        if operation == "select":
            yes_or_no, a, b = values
            return self._Assign(f"select i1 {yes_or_no}, double {a}, double {b}")
        if operation == "not":
            return self._Assign(f"xor i1 {values[0]}, true")
        if operation in ("and", "or"):
            return self._Assign(f"{operation} i1 {', '.join(values)}")
        if operation in BOOLEAN:
            comparison = _COMPARISONS.get(operation, "une")
            return self._Assign(f"fcmp {comparison} double {', '.join(values)}")
        name = f"llvm.{operation}.f64" if operation in _INTRINSICS else operation
        doubles = ", ".join(f"double {value}" for value in values)
        return self._Assign(f"call double @{name}({doubles})")
