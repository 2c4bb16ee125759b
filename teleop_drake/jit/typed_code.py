"""Loops over arrays as LLVM's code, from the part of Python used by the integrator.

It consists of numbers, arrays, named tuples of arrays, loops, conditions, and calls of
functions in the same style. Types follow from the arguments, and a variable has one
type. Other code is refused with its line when it is compiled.
"""

import ast
import functools
import inspect
from collections.abc import Sequence
from types import FunctionType
from typing import Any

import numpy as np

from teleop_drake.jit.cache import Kept
from teleop_drake.jit.native import Library, TypedFunction
from teleop_drake.jit.typed_expressions import (
    EVALUATE,
    INTEGER,
    NOTHING,
    ConstantText,
    ExpressionWriter,
    NotTyped,
    PartsOf,
    Type,
    TypeOf,
    Value,
)

_INTRINSICS = {"fabs": "double", "sqrt": "double", "pow": "double, double"}


def MakeTypedCode(function: FunctionType, types: Sequence[Type]) -> str:
    """Returns a function and all that it calls as LLVM's code.

    Args:
        function: The function. It ends at an index that is out of bounds, and the
            variable `fault` then points to the function's name and the line.
        types: The types of its arguments. A named tuple is a pointer to its Header().

    Raises:
        NotTyped: If the function cannot be compiled here.
    """
    module = _Module()
    module.Compile(function, tuple(types), "")
    return "\n".join(
        [
            "@fault = global ptr null",
            *module.constants,
            *(
                f"declare double @llvm.{name}.f64({arguments})"
                for name, arguments in _INTRINSICS.items()
            ),
            *module.functions,
            "!0 = !{}",
            '!1 = !{!"branch_weights", i32 1000, i32 1}',
            '!2 = !{!"branch_weights", i32 1, i32 1000}',
        ]
    )


@functools.cache
def CompileTyped(function: Any, types: tuple[Type, ...]) -> TypedFunction:
    """Returns a function in machine code, which is kept in the user's cache."""
    name = function.__name__
    data, _ = Kept(name, MakeTypedCode(function, types))
    return TypedFunction(Library(data, name, "fault"), name)


class _Module:
    """The definitions of functions and constants."""

    def __init__(self) -> None:
        self.constants: list[str] = []
        self.functions: list[str] = []
        self._known: dict[tuple[FunctionType, tuple[Type, ...]], tuple[str, Type]] = {}
        self._arrays: dict[int, Value] = {}
        # Of each file, by their first lines.
        self._definitions: dict[str, dict[int, ast.FunctionDef]] = {}

    def Definition(self, function: FunctionType) -> ast.FunctionDef:
        """Returns the definition of a function, from its file that is parsed once."""
        lines, first = inspect.findsource(function)
        file = function.__code__.co_filename
        if file not in self._definitions:
            self._definitions[file] = {
                min([node.lineno, *(x.lineno for x in node.decorator_list)]): node
                for node in ast.walk(ast.parse("".join(lines)))
                if isinstance(node, ast.FunctionDef)
            }
        return self._definitions[file][first + 1]

    def Compile(
        self, function: FunctionType, types: tuple[Type, ...], linkage: str = "internal"
    ) -> tuple[str, Type]:
        """Returns the name of a function for types, and what it returns."""
        key = function, types
        if key not in self._known:
            name = function.__name__
            if linkage:
                name = f"{name}.{len(self._known)}"
            self._known[key] = name, None
            code = _Function(self, function, types)
            self._known[key] = name, code.result or NOTHING
            self.functions.append(code.Text(name, linkage))
        return self._known[key]

    def Constant(self, array: Any) -> Value:
        """Returns a constant array of numpy."""
        if id(array) not in self._arrays:
            kind = TypeOf(np.ascontiguousarray(array))
            name = f"@array{len(self._arrays)}"
            items = ", ".join(
                f"{kind.item} {ConstantText(item.item())}" for item in array.ravel()
            )
            self.constants.append(
                f"{name} = private constant [{array.size} x {kind.item}] [{items}]"
            )
            dimensions = tuple(str(n) for n in array.shape)
            self._arrays[id(array)] = Value(kind, (name, *dimensions))
        return self._arrays[id(array)]

    def Text(self, text: str) -> str:
        """Returns the name of a constant text."""
        name = f'@"{text}"'
        size = len(text) + 1
        line = f'{name} = private constant [{size} x i8] c"{text}\\00"'
        if line not in self.constants:
            self.constants.append(line)
        return name


class _Function(ExpressionWriter):
    """The code of one function for types of arguments, and the type of its result."""

    def __init__(
        self, module: _Module, function: FunctionType, types: tuple[Type, ...]
    ):
        self.result: Type = None
        super().__init__(module, function)
        # Where `continue` and `break` go.
        self._loops: list[tuple[str, str]] = []
        definition = module.Definition(function)
        names = [argument.arg for argument in definition.args.args]
        if len(names) != len(types):
            raise NotTyped(f"{function.__name__} takes {len(names)} arguments")
        self._arguments = []
        for i, (name, kind) in enumerate(zip(names, types, strict=True)):
            parts = PartsOf(kind)
            operands = tuple(f"%a{i}_{k}" for k in range(len(parts)))
            self._arguments += [
                f"{part} {operand}"
                for part, operand in zip(parts, operands, strict=True)
            ]
            self._Assign(name, Value(kind, operands))
        self._Block(definition.body)
        if self._is_open and self.result not in (None, NOTHING):
            raise self._Refuse("it may end without returning a number", definition)
        if self._is_open:
            self._lines.append("  ret void")

    def Text(self, name: str, linkage: str) -> str:
        """Returns the definition."""
        head = f"define {linkage} {self.result or NOTHING} @{name}"
        arguments = ", ".join(self._arguments)
        lines = [f"{head}({arguments}) {{", "entry:", *self._slots, *self._lines]
        result = self.result or NOTHING
        value = "" if result == NOTHING else " zeroinitializer"
        return "\n".join([*lines, "fault:", f"  ret {result}{value}", "}"])

    # Statements.

    def _Block(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            if not self._is_open:
                return  # What follows a return.
            self._Statement(statement)

    def _Statement(self, node: ast.stmt) -> None:
        """Writes a statement; refuses statements that have no case here."""
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case ast.Expr(value=ast.Call() as call):
                self._Expression(call)
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self._Assign(name, self._Expression(value))
            case ast.Assign(targets=[ast.Subscript() as target], value=value):
                self._Store(self._Element(target), self._Expression(value), target)
            case ast.AugAssign(target=ast.Name(id=name) as target, op=op, value=value):
                old = self._Expression(target)
                self._Assign(
                    name, self._Operate(op, old, self._Expression(value), node)
                )
            case ast.AugAssign(target=ast.Subscript() as target, op=op, value=value):
                place = self._Element(target)
                old = self._Loaded(place)
                by = self._Expression(value)
                self._Store(place, self._Operate(op, old, by, node), target)
            case ast.If():
                self._If(node)
            case ast.While(test=test, body=body, orelse=[]):
                head, inner, end = self._Names(3)
                self._Label(head)
                self._Branch(self._Truth(self._Expression(test)), inner, end)
                self._Label(inner)
                self._Loop(body, head, end)
                self._Jump(head)
                self._Label(end)
            case ast.For(
                target=ast.Name(id=name),
                iter=ast.Call(func=ast.Name(id="range"), args=limits),
                body=body,
                orelse=[],
            ):
                self._For(name, limits, body)
            case ast.Return(value=value):
                self._Return(value)
            case ast.Continue():
                self._Jump(self._loops[-1][0])
            case ast.Break():
                self._Jump(self._loops[-1][1])
            case _:
                raise self._Refuse(type(node).__name__, node)

    def _Return(self, value: ast.expr | None) -> None:
        if value is None:
            self._lines.append("  ret void")
        else:
            result = self._Expression(value)
            self.result = self.result or result.type
            if not isinstance(self.result, str) or self.result == EVALUATE:
                raise self._Refuse("it returns no number", value)
            operand = self._As(self.result, result).operands[0]
            self._lines.append(f"  ret {self.result} {operand}")
        self._is_open = False

    def _Store(self, place: Value, value: Value, target: ast.expr) -> None:
        if place.type.num_dimensions:
            raise self._Refuse("it writes a whole array", target)
        kind = place.type.item
        operand = self._As(kind, value).operands[0]
        self._lines.append(f"  store {kind} {operand}, ptr {place.operands[0]}")

    def _If(self, node: ast.If) -> None:
        yes, no, end = self._Names(3)
        self._Branch(self._Truth(self._Expression(node.test)), yes, no)
        ends_open = False
        for label, body in ((yes, node.body), (no, node.orelse)):
            self._Label(label)
            self._Block(body)
            ends_open |= self._is_open
            self._Jump(end)
        if ends_open:
            self._Label(end)

    def _Loop(self, body: Sequence[ast.stmt], next_round: str, end: str) -> None:
        self._loops.append((next_round, end))
        self._Block(body)
        self._loops.pop()

    def _For(
        self, name: str, limits: Sequence[ast.expr], body: Sequence[ast.stmt]
    ) -> None:
        """Writes a loop over a range, in steps of one.

        Args:
            name: The variable of the loop.
            limits: Before which number the loop ends, or the first number and that.
        """
        if len(limits) > 2:
            raise self._Refuse("a range with steps", limits[0])
        *begin, last = [self._Expression(limit).operand for limit in limits]
        first = begin[0] if begin else "0"
        # The counter is not the variable: as in Python, the body does not change it.
        counter = self._Slot(INTEGER)
        self._Put(INTEGER, counter, Value(INTEGER, (first,)))
        head, inner, following, end = self._Names(4)
        self._Label(head)
        i = self._Take(INTEGER, counter)
        more = self._Do(f"icmp slt i64 {i.operand}, {last}")
        self._Branch(more, inner, end)
        self._Label(inner)
        self._Assign(name, i)
        self._Loop(body, following, end)
        self._Label(following)
        i = self._Take(INTEGER, counter)
        self._Put(INTEGER, counter, self._Is(INTEGER, f"add i64 {i.operand}, 1"))
        self._Jump(head)
        self._Label(end)
