"""Translates functions with loops over arrays, such as the integrator, to LLVM's code.

The functions must be written in a part of Python: numbers, arrays, named tuples of
arrays, loops, conditions, and calls of functions in the same part. Types follow from
the arguments, and a variable has one type. A field of a named tuple may be None; what
`if field is not None` then excludes is not compiled. Other code raises an error with a
note that names its line.

Statements of control flow are translated here. Python itself executes all other
statements and expressions, with `Value`s in the place of numbers and arrays: each
operation on a Value writes its instruction.
"""

import ast
import functools
import inspect
import textwrap
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any

import numpy as np

from teleop_drake.loops.jit.native import Kept, Library, TypedFunction
from teleop_drake.loops.jit.scalar_code import (
    BOOLEAN,
    FLOAT,
    INTEGER,
    NOTHING,
    ConstantText,
    Declarations,
    Instruction,
)
from teleop_drake.loops.jit.typed_values import (
    TextOf,
    Type,
    TypeOf,
    Value,
    ValueWriter,
    Variables,
)


def MakeTypedCode(function: FunctionType, types: Sequence[Type]) -> str:
    """Returns a function and all that it calls as LLVM's code.

    Args:
        function: The function. The compiled function ends at an index that is out of
            bounds, and the variable `fault` then points to the function's name and the
            line.
        types: The types of its arguments. A named tuple is a pointer to its Header().

    Raises:
        TypeError: If the function cannot be compiled here.
    """
    module = _Module()
    module.Compile(function, tuple(types), "")
    return "\n".join(
        [
            "@fault = global ptr null",
            *module.constants.values(),
            *Declarations(),
            *module.functions,
        ]
    )


def CompileTyped(function: Any, types: tuple[Type, ...]) -> TypedFunction:
    """Returns a function in machine code, which is stored in the user's cache."""
    name = function.__name__
    data = Kept(name, MakeTypedCode(function, types))
    return TypedFunction(Library(data, name, "fault"), name)


class _Module:
    """The definitions of functions and constants in LLVM's language.

    Attributes:
        constants: The definitions of constants by their names.
        functions: The definitions of functions, each after those that it calls.
    """

    def __init__(self) -> None:
        self.constants: dict[str, str] = {}
        self.functions: list[str] = []
        self._known: dict[tuple[FunctionType, tuple[Type, ...]], tuple[str, Type]] = {}

    def Compile(
        self, function: FunctionType, types: tuple[Type, ...], linkage: str = "internal"
    ) -> tuple[str, Type]:
        """Returns the name of a function for argument types, and its result's type."""
        key = function, types
        if key not in self._known:
            code = _Function(self, function, types)
            name = function.__name__
            if linkage:
                name = f"{name}.{len(self._known)}"
            self._known[key] = name, code.result
            self.functions.append(code.Text(name, linkage))
        return self._known[key]

    def Array(self, array: Any) -> tuple[Type, str]:
        """Returns the type and the operand of a constant array of numpy."""
        kind = TypeOf(np.ascontiguousarray(array))
        name = f"@array{len(self.constants)}"
        items = ", ".join(
            f"{kind.item} {ConstantText(item)}" for item in array.ravel().tolist()
        )
        self.constants[name] = (
            f"{name} = private constant [{array.size} x {kind.item}] [{items}]"
        )
        dimensions = "".join(f", {INTEGER} {size}" for size in array.shape)
        return kind, f"{{ptr {name}{dimensions}}}"

    def Text(self, text: str) -> str:
        """Returns the name of a constant text."""
        name = f'@"{text}"'
        size = len(text) + 1
        self.constants[name] = f'{name} = private constant [{size} x i8] c"{text}\\00"'
        return name


def _BodyOf(function: FunctionType) -> list[ast.stmt]:
    """Returns the statements of a function, with their lines in its file."""
    (definition,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    assert isinstance(definition, ast.FunctionDef)
    ast.increment_lineno(definition, function.__code__.co_firstlineno - 1)
    return definition.body


class _Function(ValueWriter):
    """The code of one function for given types of its arguments.

    Attributes:
        result: The type of the function's result.
    """

    def __init__(
        self, module: _Module, function: FunctionType, types: tuple[Type, ...]
    ):
        super().__init__()
        self.result: Type = NOTHING
        self._module = module
        self._function = function
        self._variables = Variables(self)
        self._is_open = True
        # The labels to which `continue` and `break` jump, for each enclosing loop.
        self._loops: list[tuple[str, str]] = []
        self._line = function.__code__.co_firstlineno
        self._names = self._Outside()
        self._arguments: list[str] = []
        names = inspect.signature(function).parameters
        for name, kind in zip(names, types, strict=True):
            operand = f"%{self.NewName()}"
            self._arguments.append(f"{TextOf(kind)} {operand}")
            self._variables[name] = Value(self, kind, operand)
        try:
            self._Block(_BodyOf(function))
        except Exception as error:
            error.add_note(self._Where())
            raise
        if self._is_open:
            self.lines.append("  ret void")

    def Text(self, name: str, linkage: str) -> str:
        """Returns the definition of the function."""
        arguments = ", ".join(self._arguments)
        head = f"define {linkage} {self.result} @{name}({arguments}) {{"
        value = "" if self.result == NOTHING else " zeroinitializer"
        end = ["fault:", f"  ret {self.result}{value}", "}"]
        return "\n".join([head, "entry:", *self._variables.lines, *self.lines, *end])

    def _Where(self) -> str:
        return f"{self._function.__name__}(), line {self._line}"

    # Names from outside of the function.

    def _Outside(self) -> dict[str, Any]:
        """Returns the globals with which Python executes the function's statements."""
        known = {
            "abs": abs,
            "float": functools.partial(self._Converted, FLOAT),
            "int": functools.partial(self._Converted, INTEGER),
            "len": lambda array: Value(self, INTEGER, array.Part(1)),
            "min": functools.partial(self._Extreme, "lt"),
            "max": functools.partial(self._Extreme, "gt"),
        }
        names: dict[str, Any] = {"__builtins__": known}
        given = self._function.__globals__
        for name in self._function.__code__.co_names:
            value = given.get(name)
            if isinstance(value, FunctionType):
                names[name] = functools.partial(self._Call, value)
            elif isinstance(value, np.ndarray):
                names[name] = Value(self, *self._module.Array(value))
            elif name in given:
                names[name] = value
        return names

    def _Converted(self, kind: Type, value: Any) -> Value:
        value = self.AsValue(value)
        if (kind, value._kind) == (INTEGER, FLOAT):
            return Value(self, kind, self.Do(f"fptosi double {value._operand} to i64"))
        return Value(self, kind, self.As(kind, value))

    def _Extreme(self, comparison: str, first: Any, *others: Any) -> Value:
        result = self.AsValue(first)
        for other in others:
            is_better = result.Operate(comparison, other, result)
            texts = is_better._operand, self.As(FLOAT, other), self.As(FLOAT, result)
            result = Value(self, FLOAT, self.Do(Instruction("select", FLOAT, texts)))
        return result

    def _Call(self, function: FunctionType, *arguments: Any) -> Value | None:
        """Writes a call of another function of Python."""
        values = [self.AsValue(argument) for argument in arguments]
        name, kind = self._module.Compile(function, tuple(x._kind for x in values))
        operands = ", ".join(f"{TextOf(x._kind)} {x._operand}" for x in values)
        call = f"call {kind} @{name}({operands})"
        result = None
        if kind == NOTHING:
            self.lines.append(f"  {call}")
        else:
            result = Value(self, kind, self.Do(call))
        fault = self.Do("load ptr, ptr @fault")
        bad = self.Do(f"icmp ne ptr {fault}, null")
        following = self.NewName()
        self._Branch(bad, "fault", following)
        self._Label(following)
        return result

    def Demand(self, condition: str) -> None:
        """Ends the function with an error unless a condition holds."""
        good = self.NewName()
        bad = self.NewName()
        self._Branch(condition, good, bad)
        self._Label(bad)
        self.Store("ptr", self._module.Text(self._Where()), "@fault")
        self._Jump("fault")
        self._Label(good)

    # Blocks of instructions.

    def _NewLabels(self, number: int) -> list[str]:
        return [self.NewName() for _ in range(number)]

    def _Label(self, label: str) -> None:
        """Begins a block; the block before it jumps there if it has no end yet."""
        self._Jump(label)
        self.lines.append(f"{label}:")
        self._is_open = True

    def _Jump(self, label: str) -> None:
        if self._is_open:
            self.lines.append(f"  br label %{label}")
        self._is_open = False

    def _Branch(self, condition: str, yes: str, no: str) -> None:
        self.lines.append(f"  br i1 {condition}, label %{yes}, label %{no}")
        self._is_open = False

    # Statements.

    def _Block(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            if not self._is_open:
                return  # What follows a return.
            self._line = statement.lineno
            self._Statement(statement)

    def _Statement(self, node: ast.stmt) -> None:
        """Writes a statement; refuses statements that have no case here."""
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self._variables[name] = self._Evaluate(value)
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case ast.Assign(targets=[ast.Subscript()]) | ast.AugAssign() | ast.Expr():
                code = compile(ast.Module([node], []), self._Where(), "exec")
                exec(code, self._names, self._variables)
            case ast.If(
                test=ast.Compare(
                    left=left, ops=[ast.IsNot()], comparators=[ast.Constant(value=None)]
                ),
                body=body,
                orelse=orelse,
            ):
                # The type decides, so that the other branch makes no code.
                self._Block(orelse if self._Evaluate(left) is None else body)
            case ast.If(test=test, body=body, orelse=orelse):
                self._If(test, body, orelse)
            case ast.While(test=test, body=body, orelse=[]):
                self._Loop(lambda: self._Truth(test), lambda: self._Block(body))
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
                raise TypeError(type(node).__name__)

    def _Return(self, value: ast.expr | None) -> None:
        if value is None:
            self.lines.append("  ret void")
        else:
            result = self.AsValue(self._Evaluate(value))
            if self.result == NOTHING:
                self.result = result._kind
            if self.result not in (FLOAT, INTEGER, BOOLEAN):
                raise TypeError("it returns no number")
            self.lines.append(f"  ret {self.result} {self.As(self.result, result)}")
        self._is_open = False

    def _If(
        self, test: ast.expr, body: Sequence[ast.stmt], orelse: Sequence[ast.stmt]
    ) -> None:
        """Writes both branches of an `if`, and the block in which they meet again."""
        yes, no, end = self._NewLabels(3)
        self._Branch(self._Truth(test), yes, no)
        ends_open = False
        for label, part in ((yes, body), (no, orelse)):
            self._Label(label)
            self._Block(part)
            ends_open |= self._is_open
            self._Jump(end)
        if ends_open:
            self._Label(end)

    def _Loop(self, test: Callable[[], str], body: Callable[[], None]) -> None:
        """Writes a loop, with functions that write its condition and its body."""
        head, inner, end = self._NewLabels(3)
        self._Label(head)
        self._Branch(test(), inner, end)
        self._Label(inner)
        self._loops.append((head, end))
        body()
        self._loops.pop()
        self._Jump(head)
        self._Label(end)

    def _For(
        self, name: str, limits: Sequence[ast.expr], body: Sequence[ast.stmt]
    ) -> None:
        """Writes a loop over a range, in steps of one.

        Args:
            name: The variable of the loop.
            limits: The arguments of range(): the end, or the begin and the end.
        """
        if len(limits) > 2:
            raise TypeError("a range with steps")
        *begin, last = [self._Evaluate(limit) for limit in limits]
        # The counter is not the variable: as in Python, the body does not change it.
        variables = self._variables
        counter = f"%{self.NewName()}"  # No name of Python's.
        variables[counter] = begin[0] if begin else 0

        def WriteBody() -> None:
            variables[name] = variables[counter]
            variables[counter] += 1
            self._Block(body)

        self._Loop(lambda: (variables[counter] < last)._operand, WriteBody)

    # Expressions.

    def _Evaluate(self, node: ast.expr) -> Any:
        """Returns the value of an expression.

        Python evaluates all expressions but `and`, `or` and `not`, which need the truth
        of a Value.
        """
        match node:
            case ast.BoolOp():
                return self._Logic(node)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                opposite = Instruction("not", BOOLEAN, [self._Truth(operand)])
                return Value(self, BOOLEAN, self.Do(opposite))
        code = compile(ast.Expression(node), self._Where(), "eval")
        return eval(code, self._names, self._variables)

    def _Truth(self, node: ast.expr) -> str:
        value = self.AsValue(self._Evaluate(node))
        if value._kind != BOOLEAN:
            raise TypeError("a condition that is not a boolean")
        return str(value._operand)

    def _Logic(self, node: ast.BoolOp) -> Value:
        """Writes `and` or `or`, with branches past operands that do not matter."""
        name = f"%{self.NewName()}"
        end = self.NewName()
        for operand in node.values:
            truth = self._Truth(operand)
            self._variables[name] = Value(self, BOOLEAN, truth)
            following = self.NewName()
            if isinstance(node.op, ast.And):
                self._Branch(truth, following, end)
            else:
                self._Branch(truth, end, following)
            self._Label(following)
        self._Label(end)
        return self._variables[name]
