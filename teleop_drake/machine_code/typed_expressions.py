"""Expressions of numbers and arrays in LLVM's language; see typed_code."""

import ast
import builtins
from types import FunctionType
from typing import Any, Protocol

import numpy as np

from teleop_drake.machine_code.typed_values import (
    BOOLEAN,
    FLOAT,
    INTEGER,
    NOTHING,
    ArrayType,
    ConstantText,
    NotTyped,
    NumSlots,
    PartsOf,
    TupleType,
    Type,
    Value,
)

_COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "lt",
    ast.LtE: "le",
    ast.Gt: "gt",
    ast.GtE: "ge",
    ast.Eq: "eq",
    ast.NotEq: "ne",
}

# What a variable has before it has a value: no number, and no index.
_NO_VALUES = {FLOAT: ConstantText(float("nan")), INTEGER: str(-(2**62))}


class Module(Protocol):
    """What functions share."""

    def Compile(
        self, function: FunctionType, types: tuple[Type, ...], linkage: str = ...
    ) -> tuple[str, Type]:
        """Returns the name of a function for types, and what it returns."""

    def Constant(self, array: Any) -> Value:
        """Returns a constant array of numpy."""

    def Text(self, text: str) -> str:
        """Returns the name of a constant text."""


def IndicesOf(node: ast.Subscript) -> list[ast.expr]:
    """Returns the indices of an element."""
    return node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]


class ExpressionWriter:
    """Writes expressions of one function, and what their values need."""

    def __init__(self, module: Module, function: FunctionType):
        self._module, self._function = module, function
        self._lines: list[str] = []
        self._slots: list[str] = []
        self._num_names = 0
        self._variables: dict[str, tuple[Type, list[str]]] = {}
        self._is_open = True
        # Elements of arrays, and places of indices there, that have been checked.
        self._checked: set[tuple[int, int]] = set()

    # Writing.

    def _Name(self) -> str:
        self._num_names += 1
        return f"v{self._num_names}"

    def _Do(self, instruction: str) -> str:
        name = f"%{self._Name()}"
        self._lines.append(f"  {name} = {instruction}")
        return name

    def _Label(self, label: str) -> None:
        """Begins a block, into which the one before goes on if it has no end."""
        self._Jump(label)
        self._lines.append(f"{label}:")
        self._is_open = True

    def _Jump(self, label: str) -> None:
        if self._is_open:
            self._lines.append(f"  br label %{label}")
        self._is_open = False

    def _Branch(self, condition: ast.expr, yes: str, no: str) -> None:
        value = self._Truth(self._Expression(condition))
        self._lines.append(f"  br i1 {value}, label %{yes}, label %{no}")
        self._is_open = False

    def _Slot(self, kind: Type) -> list[str]:
        slots = []
        for part in PartsOf(kind):
            name = f"%{self._Name()}"
            self._slots.append(f"  {name} = alloca {part}")
            if part in _NO_VALUES:
                self._slots.append(f"  store {part} {_NO_VALUES[part]}, ptr {name}")
            slots.append(name)
        return slots

    def _Demand(self, condition: str, node: ast.AST | None) -> None:
        """Ends the function with an error unless a condition holds."""
        where = self._module.Text(self._Where(node))
        good, bad = self._Name(), self._Name()
        self._lines += [
            f"  br i1 {condition}, label %{good}, label %{bad}, !prof !1",
            f"{bad}:",
            f"  store ptr {where}, ptr @fault",
            "  br label %fault",
            f"{good}:",
        ]

    def _Put(self, kind: Type, slots: list[str], value: Value) -> None:
        value = self._As(kind, value)
        for part, slot, operand in zip(
            PartsOf(kind), slots, value.operands, strict=True
        ):
            self._lines.append(f"  store {part} {operand}, ptr {slot}")

    def _Take(self, kind: Type, slots: list[str]) -> Value:
        return Value(
            kind,
            tuple(
                self._Do(f"load {part}, ptr {slot}")
                for part, slot in zip(PartsOf(kind), slots, strict=True)
            ),
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
            return Value(
                FLOAT, (self._Do(f"sitofp i64 {value.operands[0]} to double"),)
            )
        raise NotTyped(
            f"{self._function.__name__}: a variable is {kind} and {value.type}"
        )

    def _Truth(self, value: Value) -> str:
        if value.type == BOOLEAN:
            return value.operands[0]
        if value.type == INTEGER:
            return self._Do(f"icmp ne i64 {value.operands[0]}, 0")
        raise self._Refuse("the truth of what is no yes or no", None)

    def _Refuse(self, what: str, node: ast.AST | None) -> NotTyped:
        return NotTyped(f"{self._Where(node)}: {what}")

    def _Where(self, node: ast.AST | None) -> str:
        line = getattr(node, "lineno", self._function.__code__.co_firstlineno)
        return f"{self._function.__name__}(), line {line}"

    # Expressions.

    def _Expression(self, node: ast.expr) -> Value:
        match node:
            case ast.Constant(value=bool() | int() | float() as value):
                return self._Number(value)
            case ast.Name(id=name):
                return self._Named(name, node)
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if (
                name not in self._variables
            ):
                owner = self._function.__globals__.get(name)
                return self._Number(getattr(owner, attribute))
            case ast.Attribute(value=inner, attr=attribute):
                return self._Field(self._Expression(inner), attribute, node)
            case ast.Subscript(
                value=ast.Attribute(value=inner, attr="shape"),
                slice=ast.Constant(value=int() as axis),
            ):
                return Value(INTEGER, (self._Expression(inner).operands[1 + axis],))
            case ast.Subscript():
                return self._Loaded(self._Element(node))
            case ast.UnaryOp(op=op, operand=operand):
                return self._Unary(op, self._Expression(operand), node)
            case ast.BinOp(left=left, op=op, right=right):
                a = self._Expression(left)
                return self._Operate(op, a, self._Expression(right))
            case ast.Compare():
                return self._Compare(node)
            case ast.BoolOp():
                return self._Logic(node)
            case ast.IfExp():
                return self._Choice(node)
            case ast.Call(func=ast.Name(id=name), keywords=[]):
                arguments = [self._Expression(argument) for argument in node.args]
                return self._Call(name, arguments, node)
            case _:
                raise self._Refuse(type(node).__name__, node)

    def _Number(self, value: Any) -> Value:
        if isinstance(value, bool):
            return Value(BOOLEAN, (ConstantText(value),))
        if isinstance(value, int):
            return Value(INTEGER, (ConstantText(value),))
        if not isinstance(value, float):
            raise self._Refuse(f"a {type(value).__name__}", None)
        return Value(FLOAT, (ConstantText(value),))

    def _Named(self, name: str, node: ast.expr) -> Value:
        if name in self._variables:
            return self._Take(*self._variables[name])
        value = self._function.__globals__.get(name)
        if isinstance(value, np.ndarray):
            return self._module.Constant(value)
        if not isinstance(value, (int, float)):
            raise self._Refuse(f"{name} before it has a value", node)
        return self._Number(value)

    def _Field(self, value: Value, name: str, node: ast.expr) -> Value:
        """Returns what a field of a named tuple is."""
        if not isinstance(value.type, TupleType):
            raise self._Refuse(f"the attribute {name}", node)
        place = 0
        for field, kind in value.type.fields:
            if field == name:
                break
            place += NumSlots(kind)
        else:
            raise self._Refuse(f"the attribute {name}", node)
        pointers = [
            self._Do(f"getelementptr i64, ptr {value.operands[0]}, i64 {place + k}")
            for k in range(len(PartsOf(kind)))
        ]
        if isinstance(kind, TupleType):
            return Value(kind, (pointers[0],))
        # No function writes into a header.
        operands = [
            self._Do(f"load {part}, ptr {pointer}, !invariant.load !0")
            for part, pointer in zip(PartsOf(kind), pointers, strict=True)
        ]
        return Value(kind, tuple(operands))

    def _Element(self, node: ast.Subscript) -> Value:
        """Returns the array of fewer dimensions that is at an index."""
        array = self._Expression(node.value)
        if not isinstance(array.type, ArrayType):
            raise self._Refuse("an index of what is no array", node)
        if isinstance(node.slice, ast.Slice):
            return self._Slice(array, node.slice)
        indices = []
        for axis, item in enumerate(IndicesOf(node)):
            index = self._Expression(item)
            if (id(node), axis) not in self._checked:
                index = self._Checked(index, array.operands[1 + axis], node)
            indices.append(index)
        return self._At(array, indices)

    def _Checked(self, index: Value, dimension: str, node: ast.AST) -> Value:
        """Returns an index as one from the beginning; it has to be in the array."""
        operand = self._As(INTEGER, index).operands[0]
        if operand.startswith("-"):
            operand = self._Do(f"add i64 {operand}, {dimension}")
        inside = self._Do(f"icmp ult i64 {operand}, {dimension}")
        if operand.isdigit() or index.operands[0] != operand:
            self._Demand(inside, node)
            return Value(INTEGER, (operand,))
        before, outside, good = self._Name(), self._Name(), self._Name()
        self._lines += [
            f"  br label %{before}",
            f"{before}:",
            f"  br i1 {inside}, label %{good}, label %{outside}, !prof !1",
            f"{outside}:",
        ]
        from_end = self._Do(f"add i64 {operand}, {dimension}")
        self._Demand(self._Do(f"icmp ult i64 {from_end}, {dimension}"), node)
        end = self._Name()
        self._lines += [
            f"  br label %{end}",
            f"{end}:",
            f"  br label %{good}",
            f"{good}:",
        ]
        operand = self._Do(f"phi i64 [{operand}, %{before}], [{from_end}, %{end}]")
        return Value(INTEGER, (operand,))

    def _Slice(self, array: Value, part: ast.Slice) -> Value:
        """Returns the rows of an array from one to before another."""
        if part.lower is None or part.upper is None or part.step is not None:
            raise self._Refuse("a slice without both ends, or with steps", part)
        first, end = self._Expression(part.lower), self._Expression(part.upper)
        dimension, *rest = array.operands[1:]
        for low, high in (
            ("0", first.operands[0]),
            (first.operands[0], end.operands[0]),
            (end.operands[0], dimension),
        ):
            self._Demand(self._Do(f"icmp sle i64 {low}, {high}"), part)
        # The first row, as an array of fewer dimensions, is where it begins.
        pointer = self._At(array, [first]).operands[0]
        size = self._Do(f"sub i64 {end.operands[0]}, {first.operands[0]}")
        return Value(array.type, (pointer, size, *rest))

    def _At(self, array: Value, indices: list[Value]) -> Value:
        """Returns the array of fewer dimensions that is at indices."""
        item, num_dimensions = array.type
        pointer, *dimensions = array.operands
        place = "0"
        for k, dimension in enumerate(dimensions):
            place = self._Do(f"mul nsw i64 {place}, {dimension}")
            if k < len(indices):
                index = indices[k].operands[0]
                place = self._Do(f"add nsw i64 {place}, {index}")
        pointer = self._Do(f"getelementptr {item}, ptr {pointer}, i64 {place}")
        rest = dimensions[len(indices) :]
        kind = ArrayType(item, num_dimensions - len(indices))
        return Value(kind, (pointer, *rest))

    def _Loaded(self, array: Value) -> Value:
        """Returns an array, or the element that one without dimensions is."""
        item, num_dimensions = array.type
        if num_dimensions:
            return array
        return Value(item, (self._Do(f"load {item}, ptr {array.operands[0]}"),))

    def _Unary(self, op: ast.unaryop, value: Value, node: ast.expr) -> Value:
        if isinstance(op, ast.Not):
            return Value(BOOLEAN, (self._Do(f"xor i1 {self._Truth(value)}, true"),))
        if not isinstance(op, ast.USub):
            raise self._Refuse(type(op).__name__, node)
        operand = value.operands[0]
        if value.type == INTEGER:
            if operand.isdigit():
                return Value(INTEGER, (f"-{operand}",))
            return Value(INTEGER, (self._Do(f"sub i64 0, {operand}"),))
        return Value(FLOAT, (self._Do(f"fneg double {operand}"),))

    def _Same(self, a: Value, b: Value) -> tuple[Type, str, str]:
        """Returns two numbers as such of one type."""
        kind = FLOAT if FLOAT in (a.type, b.type) else a.type
        return kind, self._As(kind, a).operands[0], self._As(kind, b).operands[0]

    def _Operate(self, op: ast.operator, a: Value, b: Value) -> Value:
        if isinstance(op, (ast.Div, ast.Pow)):
            a, b = self._As(FLOAT, a), self._As(FLOAT, b)
        kind, x, y = self._Same(a, b)
        if isinstance(op, ast.Pow):
            call = f"call double @llvm.pow.f64(double {x}, double {y})"
            return Value(FLOAT, (self._Do(call),))
        if isinstance(op, ast.FloorDiv) and kind == INTEGER and y == "2":
            return Value(INTEGER, (self._Do(f"ashr i64 {x}, 1"),))
        names = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div"}
        if type(op) not in names or kind not in (FLOAT, INTEGER):
            raise self._Refuse(f"{type(op).__name__} of {kind}", None)
        prefix = "f" if kind == FLOAT else ""
        return Value(kind, (self._Do(f"{prefix}{names[type(op)]} {kind} {x}, {y}"),))

    def _Compare(self, node: ast.Compare) -> Value:
        """Returns whether comparisons hold, one after another."""
        result = ""
        a = self._Expression(node.left)
        for op, right in zip(node.ops, node.comparators, strict=True):
            b = self._Expression(right)
            kind, x, y = self._Same(a, b)
            name = _COMPARISONS.get(type(op))
            if name is None:
                raise self._Refuse(type(op).__name__, node)
            if kind == FLOAT:
                prefix = "u" if name == "ne" else "o"  # What is no number differs.
                holds = self._Do(f"fcmp {prefix}{name} double {x}, {y}")
            else:
                prefix = "" if name in ("eq", "ne") else "s"
                holds = self._Do(f"icmp {prefix}{name} {kind} {x}, {y}")
            result = self._Do(f"and i1 {result}, {holds}") if result else holds
            a = b
        return Value(BOOLEAN, (result,))

    def _Logic(self, node: ast.BoolOp) -> Value:
        """Returns the result of `and` or `or`, which ask no more than they have to."""
        slots, end = self._Slot(BOOLEAN), self._Name()
        for operand in node.values:
            value = Value(BOOLEAN, (self._Truth(self._Expression(operand)),))
            self._Put(BOOLEAN, slots, value)
            following = self._Name()
            labels = (
                (following, end) if isinstance(node.op, ast.And) else (end, following)
            )
            self._lines.append(
                f"  br i1 {value.operands[0]}, label %{labels[0]}, label %{labels[1]}"
            )
            self._is_open = False
            self._Label(following)
        self._Label(end)
        return self._Take(BOOLEAN, slots)

    def _Choice(self, node: ast.IfExp) -> Value:
        yes, no, end = self._Name(), self._Name(), self._Name()
        self._Branch(node.test, yes, no)
        self._Label(yes)
        value = self._Expression(node.body)
        slots = self._Slot(value.type)
        self._Put(value.type, slots, value)
        self._Jump(end)
        self._Label(no)
        self._Put(value.type, slots, self._Expression(node.orelse))
        self._Label(end)
        return self._Take(value.type, slots)

    def _Call(self, name: str, arguments: list[Value], node: ast.expr) -> Value:
        if name in self._variables:
            return self._CallEvaluate(self._Named(name, node), arguments)
        function = self._function.__globals__.get(name, getattr(builtins, name, None))
        if isinstance(function, FunctionType):
            return self._CallFunction(function, arguments)
        if name == "len":
            return Value(INTEGER, arguments[0].operands[1:2])
        if name == "float":
            return self._As(FLOAT, arguments[0])
        if name == "bool":
            return Value(BOOLEAN, (self._Truth(arguments[0]),))
        if name == "int":
            return (
                Value(
                    INTEGER,
                    (self._Do(f"fptosi double {arguments[0].operands[0]} to i64"),),
                )
                if arguments[0].type == FLOAT
                else arguments[0]
            )
        if name == "abs" and arguments[0].type == FLOAT:
            call = f"call double @llvm.fabs.f64(double {arguments[0].operands[0]})"
            return Value(FLOAT, (self._Do(call),))
        if name in ("min", "max"):
            return self._Extreme("lt" if name == "min" else "gt", arguments)
        raise self._Refuse(f"a call of {name}", node)

    def _Extreme(self, comparison: str, values: list[Value]) -> Value:
        result = values[0]
        for value in values[1:]:
            kind, y, x = self._Same(value, result)
            test = f"fcmp o{comparison}" if kind == FLOAT else f"icmp s{comparison}"
            better = self._Do(f"{test} {kind} {y}, {x}")
            chosen = self._Do(f"select i1 {better}, {kind} {y}, {kind} {x}")
            result = Value(kind, (chosen,))
        return result

    def _CallFunction(self, function: FunctionType, values: list[Value]) -> Value:
        kinds = tuple(value.type for value in values)
        name, kind = self._module.Compile(function, kinds)
        operands = ", ".join(
            f"{part} {operand}"
            for value in values
            for part, operand in zip(PartsOf(value.type), value.operands, strict=True)
        )
        if kind == NOTHING:
            self._lines.append(f"  call void @{name}({operands})")
            result = Value(NOTHING, ())
        else:
            result = Value(kind, (self._Do(f"call {kind} @{name}({operands})"),))
        fault, following = self._Do("load ptr, ptr @fault"), self._Name()
        bad = self._Do(f"icmp ne ptr {fault}, null")
        self._lines.append(f"  br i1 {bad}, label %fault, label %{following}, !prof !2")
        self._lines.append(f"{following}:")
        return result

    def _CallEvaluate(self, function: Value, values: list[Value]) -> Value:
        """Writes a call of `evaluate`, which takes pointers."""
        t, *arrays, everything = values
        pointers = ", ".join(f"ptr {array.operands[0]}" for array in arrays)
        wanted = self._Do(f"zext i1 {everything.operands[0]} to i32")
        self._lines.append(
            f"  call void {function.operands[0]}(double {t.operands[0]}, {pointers}, "
            f"i32 {wanted})"
        )
        return Value(NOTHING, ())
