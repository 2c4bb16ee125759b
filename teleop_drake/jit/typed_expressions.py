"""Expressions of numbers and arrays in LLVM's language, and their types.

No function writes into a header, so that what is read from one is an invariant load.
typed_code has the statements.
"""

import ast
import builtins
import ctypes
import struct
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.arrays import Array

FLOAT = "double"
INTEGER = "i64"
BOOLEAN = "i1"
NOTHING = "void"

EVALUATE = "evaluate"
"""The type of a function `evaluate` as scalar_code makes it."""

_COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq",
    ast.NotEq: "ne",
}  # fmt: skip
_ARITHMETIC: dict[type[ast.operator], str] = {
    ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div",
}  # fmt: skip


class ArrayType(NamedTuple):
    """An array: a pointer, and its dimensions one after another."""

    item: str
    num_dimensions: int


class TupleType(NamedTuple):
    """A named tuple: a pointer to eight bytes for each number in its arrays' headers.

    Attributes:
        fields: Names and types.
    """

    fields: tuple[tuple[str, Any], ...]


Type = Any


class NotTyped(Exception):
    """Raised for a function outside of the part of Python that is compiled here."""


class Value(NamedTuple):
    """An expression's value.

    Attributes:
        type: Its type.
        operands: Its names in LLVM; for an array, the pointer and the dimensions.
    """

    type: Type
    operands: tuple[str, ...]

    @property
    def operand(self) -> str:
        """The first operand, which is the only operand of a number."""
        return self.operands[0]


def TypeOf(value: Any) -> Type:
    """Returns the type of an argument."""
    if isinstance(value, bool):
        return BOOLEAN
    if isinstance(value, (int, np.integer)):
        return INTEGER
    if isinstance(value, (float, np.floating)):
        return FLOAT
    if isinstance(value, np.ndarray):
        assert value.flags.c_contiguous and value.dtype.itemsize == 8, value.dtype
        return ArrayType(FLOAT if value.dtype.kind == "f" else INTEGER, value.ndim)
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return TupleType(tuple(zip(value._fields, map(TypeOf, value), strict=True)))
    return EVALUATE


# The type of no bytes at all, at any place.
_Nothing = ctypes.c_char * 0


def _Address(array: Array) -> int:
    """Returns the address of an array, in a third of the time of array.ctypes."""
    return ctypes.addressof(_Nothing.from_buffer(array.data))


def Header(value: Any) -> list[int]:
    """Returns the memory of a named tuple: the arrays' addresses and dimensions."""
    if isinstance(value, np.ndarray):
        return [_Address(value), *value.shape]
    if isinstance(value, (int, np.integer)):
        return [int(value)]
    return [number for item in value for number in Header(item)]


def ConstantText(value: Any) -> str:
    """Returns a number in LLVM's language."""
    if isinstance(value, (bool, int)):
        return str(value).lower()
    return "0x" + struct.pack(">d", value).hex().upper()


def PartsOf(kind: Type) -> tuple[str, ...]:
    """Returns the types of the operands of a value."""
    if isinstance(kind, ArrayType):
        return ("ptr", *[INTEGER] * kind.num_dimensions)
    return ("ptr",) if isinstance(kind, TupleType) or kind == EVALUATE else (kind,)


def _NumSlots(kind: Type) -> int:
    """Returns how many numbers a type has in a Header()."""
    if isinstance(kind, TupleType):
        return sum(_NumSlots(inner) for _, inner in kind.fields)
    return len(PartsOf(kind))


# The initial values of variables: nan, and an index that is out of bounds.
_NO_VALUES = {FLOAT: ConstantText(float("nan")), INTEGER: str(-(2**62))}


class ExpressionWriter:
    """Writes expressions of one function, and what their values need.

    Args:
        module: The functions and constants that there are; see typed_code.
    """

    def __init__(self, module: Any, function: FunctionType):
        self._module = module
        self._function = function
        self._lines: list[str] = []
        self._slots: list[str] = []
        self._num_names = 0
        self._variables: dict[str, tuple[Type, list[str]]] = {}
        self._is_open = True

    # Writing.

    def _Names(self, number: int) -> list[str]:
        self._num_names += number
        return [f"v{self._num_names - k}" for k in range(number)]

    def _Do(self, instruction: str) -> str:
        name = f"%{self._Names(1)[0]}"
        self._lines.append(f"  {name} = {instruction}")
        return name

    def _Is(self, kind: Type, instruction: str) -> Value:
        return Value(kind, (self._Do(instruction),))

    def _Label(self, label: str) -> None:
        """Begins a block, into which the one before goes on if it has no end."""
        self._Jump(label)
        self._lines.append(f"{label}:")
        self._is_open = True

    def _Jump(self, label: str) -> None:
        if self._is_open:
            self._lines.append(f"  br label %{label}")
        self._is_open = False

    def _Branch(self, condition: str, yes: str, no: str, weights: str = "") -> None:
        line = f"  br i1 {condition}, label %{yes}, label %{no}{weights}"
        self._lines.append(line)
        self._is_open = False

    def _Slot(self, kind: Type) -> list[str]:
        slots = []
        for part in PartsOf(kind):
            name = f"%{self._Names(1)[0]}"
            self._slots.append(f"  {name} = alloca {part}")
            if part in _NO_VALUES:
                self._slots.append(f"  store {part} {_NO_VALUES[part]}, ptr {name}")
            slots.append(name)
        return slots

    def _Demand(self, condition: str, node: ast.AST | None) -> None:
        """Ends the function with an error unless a condition holds."""
        good, bad = self._Names(2)
        self._Branch(condition, good, bad, ", !prof !1")
        self._Label(bad)
        self._lines.append(
            f"  store ptr {self._module.Text(self._Where(node))}, ptr @fault"
        )
        self._Jump("fault")
        self._Label(good)

    def _Put(self, kind: Type, slots: list[str], value: Value) -> None:
        operands = self._As(kind, value).operands
        for part, slot, operand in zip(PartsOf(kind), slots, operands, strict=True):
            self._lines.append(f"  store {part} {operand}, ptr {slot}")

    def _Take(self, kind: Type, slots: list[str]) -> Value:
        pairs = zip(PartsOf(kind), slots, strict=True)
        return Value(
            kind, tuple(self._Do(f"load {x}, ptr {slot}") for x, slot in pairs)
        )

    def _Assign(self, name: str, value: Value) -> None:
        if name not in self._variables:
            self._variables[name] = value.type, self._Slot(value.type)
        self._Put(*self._variables[name], value)

    def _As(self, kind: Type, value: Value) -> Value:
        """Returns a value as one of a type."""
        if value.type == kind:
            return value
        if kind == FLOAT and value.type == INTEGER:
            return self._Is(FLOAT, f"sitofp i64 {value.operand} to double")
        raise self._Refuse(f"a variable is {kind} and {value.type}", None)

    def _Truth(self, value: Value) -> str:
        if value.type == BOOLEAN:
            return value.operand
        raise self._Refuse("the truth of what is no yes or no", None)

    def _Refuse(self, what: str, node: ast.AST | None) -> NotTyped:
        return NotTyped(f"{self._Where(node)}: {what}")

    def _Where(self, node: ast.AST | None) -> str:
        line = getattr(node, "lineno", self._function.__code__.co_firstlineno)
        return f"{self._function.__name__}(), line {line}"

    # Expressions.

    def _Expression(self, node: ast.expr) -> Value:
        match node:
            case ast.Constant(value=value):
                return self._Constant(value, node)
            case ast.Name(id=name) if name in self._variables:
                return self._Take(*self._variables[name])
            case ast.Name(id=name):
                return self._Constant(self._function.__globals__.get(name), node)
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if (
                name not in self._variables
            ):
                owner = self._function.__globals__.get(name)
                return self._Constant(getattr(owner, attribute), node)
            case ast.Attribute(value=inner, attr=attribute):
                return self._Field(self._Expression(inner), attribute, node)
            case ast.Subscript():
                return self._Loaded(self._Element(node))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                truth = self._Truth(self._Expression(operand))
                return self._Is(BOOLEAN, f"xor i1 {truth}, true")
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() as n)):
                return self._Constant(-n, node)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                x = self._Expression(operand)
                if x.type != FLOAT:
                    raise self._Refuse("the negative of a whole number", node)
                return self._Is(FLOAT, f"fneg double {x.operand}")
            case ast.BinOp(left=left, op=op, right=right):
                a = self._Expression(left)
                b = self._Expression(right)
                return self._Operate(op, a, b, node)
            case ast.Compare():
                return self._Compare(node)
            case ast.BoolOp():
                return self._Logic(node)
            case ast.Call(func=ast.Name(id=name), keywords=[]):
                arguments = [self._Expression(argument) for argument in node.args]
                return self._Call(name, arguments, node)
            case _:
                raise self._Refuse(type(node).__name__, node)

    def _Constant(self, value: Any, node: ast.expr) -> Value:
        if isinstance(value, np.ndarray):
            return self._module.Constant(value)
        if not isinstance(value, (bool, int, float)):
            what = "before it has a value: a" if isinstance(node, ast.Name) else "a"
            raise self._Refuse(
                f"{ast.unparse(node)} is {what} {type(value).__name__}", node
            )
        return Value(TypeOf(value), (ConstantText(value),))

    def _Field(self, value: Value, name: str, node: ast.expr) -> Value:
        """Returns the value of a field of a named tuple."""
        kinds = dict(value.type.fields) if isinstance(value.type, TupleType) else {}
        if name not in kinds:
            raise self._Refuse(f"the attribute {name}", node)
        before = list(kinds.values())[: list(kinds).index(name)]
        kind = kinds[name]
        place = sum(map(_NumSlots, before))
        parts = PartsOf(kind)
        pointers = [
            self._Do(f"getelementptr i64, ptr {value.operand}, i64 {place + k}")
            for k in range(len(parts))
        ]
        if isinstance(kind, TupleType):
            return Value(kind, (pointers[0],))
        return Value(
            kind,
            tuple(
                self._Do(f"load {part}, ptr {pointer}, !invariant.load !0")
                for part, pointer in zip(parts, pointers, strict=True)
            ),
        )

    def _Element(self, node: ast.Subscript) -> Value:
        """Returns the array of fewer dimensions that is at an index.

        The index has to be within the array. An index below 0 is out of bounds here.
        """
        array = self._Expression(node.value)
        if not isinstance(array.type, ArrayType):
            raise self._Refuse("an index of what is no array", node)
        indices = []
        items = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for axis, item in enumerate(items):
            index = self._As(INTEGER, self._Expression(item)).operand
            dimension = array.operands[1 + axis]
            self._Demand(self._Do(f"icmp ult i64 {index}, {dimension}"), node)
            indices.append(index)
        return self._At(array, indices)

    def _At(self, array: Value, indices: list[str]) -> Value:
        """Returns the array of fewer dimensions that is at indices."""
        item = array.type.item
        pointer, *dimensions = array.operands
        place = "0"
        for k, dimension in enumerate(dimensions):
            place = self._Do(f"mul nsw i64 {place}, {dimension}")
            if k < len(indices):
                place = self._Do(f"add nsw i64 {place}, {indices[k]}")
        pointer = self._Do(f"getelementptr {item}, ptr {pointer}, i64 {place}")
        rest = dimensions[len(indices) :]
        return Value(ArrayType(item, len(rest)), (pointer, *rest))

    def _Loaded(self, array: Value) -> Value:
        """Returns an array, or the element that one without dimensions is."""
        item, num_dimensions = array.type
        if num_dimensions:
            return array
        return self._Is(item, f"load {item}, ptr {array.operand}")

    def _Same(self, a: Value, b: Value) -> tuple[Type, str, str]:
        """Returns two numbers as such of one type."""
        kind = FLOAT if FLOAT in (a.type, b.type) else a.type
        return kind, self._As(kind, a).operand, self._As(kind, b).operand

    def _Operate(self, op: ast.operator, a: Value, b: Value, node: ast.AST) -> Value:
        if isinstance(op, (ast.Div, ast.Pow)):
            a = self._As(FLOAT, a)
            b = self._As(FLOAT, b)
        kind, x, y = self._Same(a, b)
        if isinstance(op, ast.Pow):
            return self._Is(FLOAT, f"call double @llvm.pow.f64(double {x}, double {y})")
        if isinstance(op, ast.FloorDiv) and kind == INTEGER and y == "2":
            return self._Is(INTEGER, f"ashr i64 {x}, 1")
        if type(op) not in _ARITHMETIC or kind not in (FLOAT, INTEGER):
            raise self._Refuse(f"{type(op).__name__} of {kind}", node)
        prefix = "f" if kind == FLOAT else ""
        return self._Is(kind, f"{prefix}{_ARITHMETIC[type(op)]} {kind} {x}, {y}")

    def _Holds(self, name: str, a: Value, b: Value) -> str:
        kind, x, y = self._Same(a, b)
        if kind == FLOAT:
            prefix = "u" if name == "ne" else "o"  # nan differs from every number.
            return self._Do(f"fcmp {prefix}{name} double {x}, {y}")
        prefix = "" if name in ("eq", "ne") else "s"
        return self._Do(f"icmp {prefix}{name} {kind} {x}, {y}")

    def _Compare(self, node: ast.Compare) -> Value:
        """Returns whether comparisons hold, one after another."""
        result = ""
        a = self._Expression(node.left)
        for op, right in zip(node.ops, node.comparators, strict=True):
            if type(op) not in _COMPARISONS:
                raise self._Refuse(type(op).__name__, node)
            b = self._Expression(right)
            holds = self._Holds(_COMPARISONS[type(op)], a, b)
            result = self._Do(f"and i1 {result}, {holds}") if result else holds
            a = b
        return Value(BOOLEAN, (result,))

    def _Logic(self, node: ast.BoolOp) -> Value:
        """Returns the result of `and` or `or`, which ask no more than they have to."""
        slots = self._Slot(BOOLEAN)
        (end,) = self._Names(1)
        for operand in node.values:
            truth = self._Truth(self._Expression(operand))
            self._Put(BOOLEAN, slots, Value(BOOLEAN, (truth,)))
            (following,) = self._Names(1)
            if isinstance(node.op, ast.And):
                self._Branch(truth, following, end)
            else:
                self._Branch(truth, end, following)
            self._Label(following)
        self._Label(end)
        return self._Take(BOOLEAN, slots)

    def _Call(self, name: str, arguments: list[Value], node: ast.expr) -> Value:
        if name in self._variables:
            return self._CallEvaluate(self._Take(*self._variables[name]), arguments)
        function = self._function.__globals__.get(name, getattr(builtins, name, None))
        if isinstance(function, FunctionType):
            return self._CallFunction(function, arguments)
        first = arguments[0]
        match name:
            case "len":
                return Value(INTEGER, first.operands[1:2])
            case "float":
                return self._As(FLOAT, first)
            case "int" if first.type == FLOAT:
                return self._Is(INTEGER, f"fptosi double {first.operand} to i64")
            case "abs" if first.type == FLOAT:
                call = f"call double @llvm.fabs.f64(double {first.operand})"
                return self._Is(FLOAT, call)
            case "min" | "max":
                return self._Extreme("lt" if name == "min" else "gt", arguments)
        raise self._Refuse(f"a call of {name}", node)

    def _Extreme(self, comparison: str, values: list[Value]) -> Value:
        result = values[0]
        for value in values[1:]:
            kind, y, x = self._Same(value, result)
            better = self._Holds(comparison, Value(kind, (y,)), Value(kind, (x,)))
            result = self._Is(kind, f"select i1 {better}, {kind} {y}, {kind} {x}")
        return result

    def _CallFunction(self, function: FunctionType, values: list[Value]) -> Value:
        name, kind = self._module.Compile(function, tuple(x.type for x in values))
        operands = ", ".join(
            f"{part} {operand}"
            for value in values
            for part, operand in zip(PartsOf(value.type), value.operands, strict=True)
        )
        call = f"call {kind} @{name}({operands})"
        if kind == NOTHING:
            self._lines.append(f"  {call}")
            result = Value(NOTHING, ())
        else:
            result = self._Is(kind, call)
        fault = self._Do("load ptr, ptr @fault")
        (following,) = self._Names(1)
        bad = self._Do(f"icmp ne ptr {fault}, null")
        self._Branch(bad, "fault", following, ", !prof !2")
        self._Label(following)
        return result

    def _CallEvaluate(self, function: Value, values: list[Value]) -> Value:
        """Writes a call of `evaluate`, which takes pointers."""
        t, *arrays, everything = values
        pointers = ", ".join(f"ptr {array.operand}" for array in arrays)
        wanted = self._Do(f"zext i1 {everything.operand} to i32")
        arguments = f"double {t.operand}, {pointers}, i32 {wanted}"
        self._lines.append(f"  call void {function.operand}({arguments})")
        return Value(NOTHING, ())
