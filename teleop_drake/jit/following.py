"""Functions, with all that they call, whose operations on Numbers are recorded.

A copy of a function is made with other globals: numpy, math, Python's built-in
functions and the function's helpers are replaced. A statement that cannot be followed
is refused with its line.
"""

import dis
import functools
from collections.abc import Callable
from types import (
    BuiltinFunctionType,
    CellType,
    CodeType,
    FunctionType,
    MethodType,
    ModuleType,
)
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

import numpy as np

from teleop_drake.jit.contents import Contents, Opaque
from teleop_drake.jit.symbolic_arrays import (
    AsNumbers,
    Table,
)
from teleop_drake.jit.symbols import (
    Untraceable,
)
from teleop_drake.jit.traced_numpy import BUILTINS, REPLACED, OfNumpy, Refused, Refusing
from teleop_drake.jit.tracing import Graph, MustJoinCaller

P = ParamSpec("P")
T = TypeVar("T")


def Traced(trace: Callable[Concatenate[Graph, P], T]) -> Callable[P, T]:
    """Returns a function that traces others in a new graph.

    It raises Untraceable if they cannot be a graph or have side effects.
    """

    @functools.wraps(trace)
    def Trace(*arguments: P.args, **keywords: P.kwargs) -> T:
        joined: set[CodeType] = set()
        surroundings: dict[int, _Surrounding] = {}
        try:
            while True:
                graph = Graph(joined=joined, surroundings=surroundings)
                try:
                    with np.errstate(all="ignore"):
                        result = trace(graph, *arguments, **keywords)
                except MustJoinCaller as helper:
                    joined |= set(helper.args)
                    continue
                for surrounding in surroundings.values():
                    if surrounding.contents.Changed():
                        raise surrounding.Refused("it changes")
                return result
        except Exception:
            for surrounding in surroundings.values():
                surrounding.contents.Restore()
            raise

    return Trace


# Modules whose functions return another value in each call, and harmless ones.
_CHANGING = "numpy.random.", "random.", "secrets.", "time.", "uuid."
_HARMLESS = "_operator", "_functools", "builtins"


class _Surrounding(NamedTuple):
    """A value from outside of a function, with its name and its original contents.

    The function is None outside of functions.
    """

    function: FunctionType | None
    name: str
    contents: Contents

    def Refused(self, why: str) -> Untraceable:
        """Returns an error with the line in which the value is mentioned."""
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
    """Returns the replacement of a value from outside of a function."""
    # Functions and modules of numpy, math and Python.
    try:
        if value in REPLACED:
            return REPLACED[value]
    except TypeError:  # It has no hash.
        pass
    if isinstance(value, ModuleType):
        return _Module(graph, value, name, function)
    owner = type(getattr(value, "__self__", None))
    module = getattr(value, "__module__", None) or owner.__module__
    if callable(value) and f"{module}.".startswith(_CHANGING):
        return Refused(value, name)
    if module.split(".")[0] in ("numpy", "math") and callable(value):
        if hasattr(value, "_implementation") or isinstance(value, np.ufunc):
            return OfNumpy(value)
        return value if isinstance(value, type) else Refusing(value, name)
    # Functions of Python are followed, also as methods or with bound arguments.
    if isinstance(value, FunctionType):
        if value not in graph.followed:
            graph.followed[value] = _Followed(graph, value)
        return graph.followed[value]
    if isinstance(value, MethodType):
        value = functools.partial(value.__func__, value.__self__)
    if isinstance(value, functools.partial):
        followed = Follow(graph, value.func, name, function)
        return functools.partial(followed, *value.args, **value.keywords)
    if isinstance(value, BuiltinFunctionType) and module not in _HARMLESS:
        return Refused(value, name)
    # An array becomes read-only. Any other value is checked for changes at the end.
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        is_real = value.dtype.kind == "f"
        array = AsNumbers(value) if is_real else value.view(Table)
        array.flags.writeable = False
        return array
    if id(value) not in graph.surroundings:
        if hasattr(value, "__next__"):
            nothing = _Surrounding(function, name, Contents(()))
            raise nothing.Refused("it takes from an iterator,")
        graph.surroundings[id(value)] = _Surrounding(function, name, Contents((value,)))
    return value


class _Module(Opaque):
    """A module whose functions are followed."""

    def __init__(self, graph: Graph, module: ModuleType, name: str, function: Any):
        vars(self)["_followed"] = graph, module, name, function

    def __setattr__(self, attribute: str, value: Any) -> None:
        raise Untraceable(f"it assigns to {self._followed[2]}.{attribute}")

    def __getattr__(self, attribute: str) -> Any:
        graph, module, name, function = self._followed
        value = getattr(module, attribute)
        return Follow(graph, value, f"{name}.{attribute}", function)


class _Followed(Opaque):
    """A function that records its operations and those of its helpers."""

    _graph: Graph
    _function: Any
    _copy: Any

    def __init__(self, graph: Graph, function: FunctionType):
        vars(self).update(_graph=graph, _function=function, _copy=None)

    def __setattr__(self, attribute: str, value: Any) -> None:
        name = self._function.__name__
        raise Untraceable(f"it assigns to {name}.{attribute}")

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        function = self._function
        try:
            if self._copy is None:
                vars(self)["_copy"] = self._Copy()
            return self._graph.Call(self._copy, arguments, keywords)
        except Exception as error:  # Whatever it does to what is no number.
            line = self._Line(error.__traceback__)
            if not isinstance(error, Untraceable):
                error = Untraceable(f"{type(error).__name__}: {error}")
            error.place = error.place or f"{function.__name__}(), line {line}"
            error.function = function
            raise error from None

    def _Line(self, traceback: Any) -> int:
        line = self._function.__code__.co_firstlineno
        codes = self._Codes()
        while traceback is not None:
            if traceback.tb_frame.f_code in codes:
                line = traceback.tb_lineno
            traceback = traceback.tb_next
        return line

    def _Codes(self) -> list[CodeType]:
        """Returns the code of a function and of the functions defined inside of it."""
        codes = [self._function.__code__]
        for code in codes:
            codes += [x for x in code.co_consts if isinstance(x, CodeType)]
        return codes

    def _Copy(self) -> FunctionType:
        """Returns the function with what it has from outside replaced."""
        function = self._function
        graph = self._graph
        codes = self._Codes()
        for code in codes:
            _CheckCode(code, code is codes[0])
        graph.codes |= set(codes)

        def Import(name: str, *arguments: Any) -> Any:
            module = __import__(name, *arguments)
            is_of_numpy = isinstance(arguments[2], list)  # As its own code asks.
            return module if is_of_numpy else _Module(graph, module, name, function)

        def Outside(value: Any, name: str) -> Any:
            return Follow(graph, value, name, function)

        own = {**BUILTINS, "__import__": Import}
        names = {**function.__globals__, "__builtins__": own}
        for name in {name for code in codes for name in code.co_names} & names.keys():
            names[name] = Outside(names[name], name)
        closure = zip(codes[0].co_freevars, function.__closure__ or (), strict=True)
        cells = tuple(
            CellType(*() if x == CellType() else (Outside(x.cell_contents, name),))
            for name, x in closure
        )
        defaults = tuple(Outside(x, "a default") for x in function.__defaults__ or ())
        copy = FunctionType(codes[0], names, function.__name__, defaults, cells)
        others = function.__kwdefaults__ or {}
        copy.__kwdefaults__ = {name: Outside(x, name) for name, x in others.items()}
        return copy


_REFUSED = {
    "PUSH_EXC_INFO": "it catches errors",
    "MATCH_CLASS": "it asks of which class something is",
    "STORE_GLOBAL": "it assigns to a global variable",
    "DELETE_GLOBAL": "it deletes a global variable",
    "STORE_DEREF": "it assigns to a variable outside of it",
    "IS_OP": "it asks whether one thing `is` another one",
}
_REFUSED_NUMBERS = {dis.opmap[name] for name in _REFUSED}


def _IsNone(instruction: dis.Instruction | None) -> bool:
    if instruction is None or instruction.opname != "LOAD_CONST":
        return False
    return instruction.argval is None


def _CheckCode(code: CodeType, is_outermost: bool) -> None:
    """Refuses code that can be rejected without running it."""
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
        if x.opname == "IS_OP" and _IsNone(before):
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
