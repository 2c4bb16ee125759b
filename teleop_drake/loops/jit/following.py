"""Copies of functions, and of all that they call, for calls with Numbers.

To follow a function means to call a copy of it with other global names: numpy, math,
Python's built-in functions and the function's helpers have replacements that record
operations on Numbers. The copy cannot change values from outside of the function. A
statement that cannot be followed is refused with its line.
"""

import dis
import enum
import functools
from collections import Counter
from types import (
    BuiltinFunctionType,
    CellType,
    CodeType,
    FunctionType,
    MethodType,
)
from typing import Any, NoReturn

import numpy as np

from teleop_drake.loops.jit.symbolic_arrays import (
    AsNumbers,
    Table,
)
from teleop_drake.loops.jit.symbols import (
    Untraceable,
)
from teleop_drake.loops.jit.traced_numpy import (
    BUILTINS,
    REPLACED,
    OfNumpy,
    Refused,
    Refusing,
    Replacement,
)
from teleop_drake.loops.jit.tracing import Graph

# Modules whose functions return another value in each call, and modules whose built-in
# functions are called unchanged.
_CHANGING = "numpy.random.", "random.", "secrets.", "time.", "uuid."
_HARMLESS = "_functools", "builtins"

# Types whose values cannot be changed.
_PLAIN = (
    str, bytes, int, float, complex, type(None), np.generic, range, slice, frozenset,
    enum.Enum,
)  # fmt: skip

# The methods that change a list or a dictionary.
_CHANGES = (
    "__setitem__", "__delitem__", "__iadd__", "__imul__", "__ior__", "append", "clear",
    "extend", "insert", "pop", "popitem", "remove", "reverse", "setdefault", "sort",
    "update",
)  # fmt: skip


def _RefuseChange(*arguments: Any, **keywords: Any) -> NoReturn:
    raise Untraceable("it changes a list or a dictionary from outside of it")


_LIST = type("list", (list,), dict.fromkeys(_CHANGES, _RefuseChange))
_DICTIONARY = type("dict", (dict,), dict.fromkeys(_CHANGES, _RefuseChange))


def Follow(graph: Graph, value: Any, name: str) -> Any:
    """Returns the replacement of a value from outside of a function.

    Args:
        graph: The graph that records the operations.
        value: The value: a function, module, object, number or container.
        name: The name of the value, for messages.
    """
    if graph.stand_in is not None:
        found = graph.stand_in(value, name)
        if found is not None:
            return found
    # Functions of numpy, math and Python.
    try:
        if value in REPLACED:
            return REPLACED[value]
    except TypeError:  # It has no hash.
        pass
    owner = type(getattr(value, "__self__", None))
    module = getattr(value, "__module__", None) or owner.__module__
    if callable(value) and f"{module}.".startswith(_CHANGING):
        return Refused(value, name)
    if module.split(".")[0] in ("numpy", "math") and callable(value):
        if hasattr(value, "_implementation") or isinstance(value, np.ufunc):
            return OfNumpy(value)
        return value if isinstance(value, type) else Refusing(value, name)
    # Functions written in Python are followed, also as methods or with bound arguments.
    if isinstance(value, functools._lru_cache_wrapper):
        value = value.__wrapped__
    if isinstance(value, FunctionType):
        if value not in graph.followed:
            graph.followed[value] = _Followed(graph, value)
        return graph.followed[value]
    if isinstance(value, MethodType):
        value = functools.partial(value.__func__, value.__self__)
    if isinstance(value, functools.partial):
        function = Follow(graph, value.func, name)
        arguments = [Follow(graph, x, name) for x in value.args]
        keywords = {key: Follow(graph, x, key) for key, x in value.keywords.items()}
        return functools.partial(function, *arguments, **keywords)
    if isinstance(value, BuiltinFunctionType):
        is_harmless = getattr(value.__self__, "__name__", None) in _HARMLESS
        return value if is_harmless else Refused(value, name)
    # Values that could be changed are replaced by copies that refuse changes.
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        is_real = value.dtype.kind == "f"
        array = AsNumbers(value) if is_real else value.view(Table)
        array.flags.writeable = False
        return array
    if isinstance(value, tuple) or type(value) is list:
        kind = _LIST if isinstance(value, list) else getattr(value, "_make", tuple)
        return kind(Follow(graph, item, name) for item in value)
    if isinstance(value, set):
        return frozenset(value)
    if type(value) is dict:
        # The keys may be functions.
        return _DICTIONARY(Follow(graph, item, name) for item in value.items())
    return _Outside(graph, value, name)


class _Outside:
    """The replacement of a module, a class or an object from outside of a function.

    Its attributes are replaced by Follow(). It refuses assignments to attributes, and
    operations that would show that it is not the original, such as comparisons.
    """

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, graph: Graph, value: Any, name: str):
        object.__setattr__(self, "_outside", (graph, value, name))

    def __getattribute__(self, attribute: str) -> Any:
        graph, value, name = object.__getattribute__(self, "_outside")
        # For isinstance(); _CheckCode() refuses functions that read __class__.
        if attribute == "__class__":
            return type(value)
        of_class = getattr(type(value), attribute, None)
        # The getter of a class in C++ returns a plain attribute.
        getter = getattr(of_class, "fget", None)
        if isinstance(of_class, property) and isinstance(getter, FunctionType):
            return Follow(graph, MethodType(getter, value), name)()
        return Follow(graph, getattr(value, attribute), f"{name}.{attribute}")

    def __setattr__(self, attribute: str, value: Any) -> None:
        _, _, name = object.__getattribute__(self, "_outside")
        raise Untraceable(f"it assigns to {name}.{attribute}")

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        graph, value, name = object.__getattribute__(self, "_outside")
        if isinstance(value, type):
            return value(*arguments, **keywords)
        call = vars(type(value)).get("__call__")
        if not isinstance(call, FunctionType):
            raise Untraceable(f"a call of {name}()")
        return Follow(graph, MethodType(call, value), name)(*arguments, **keywords)

    def __instancecheck__(self, instance: Any) -> bool:
        _, value, _ = object.__getattribute__(self, "_outside")
        return isinstance(instance, value)

    def _Refuse(self, *others: Any) -> NoReturn:
        _, _, name = object.__getattribute__(self, "_outside")
        raise Untraceable(f"it compares {name}, or makes text of it")

    __eq__ = __ne__ = __bool__ = __repr__ = _Refuse


def Original(value: Any) -> Any:
    """Returns the object from outside of a function that a value replaces."""
    if type(value) is _Outside:
        return object.__getattribute__(value, "_outside")[1]
    return value


class _Followed(Replacement):
    """The replacement of a Python function: its copy, which records operations."""

    _graph: Graph
    _function: Any
    _copy: Any

    def __init__(self, graph: Graph, function: FunctionType):
        vars(self).update(_graph=graph, _function=function, _copy=None)

    def __getattr__(self, attribute: str) -> Any:
        return Follow(self._graph, getattr(self._function, attribute), attribute)

    def __setattr__(self, attribute: str, value: Any) -> None:
        name = self._function.__name__
        raise Untraceable(f"it assigns to {name}.{attribute}")

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Calls the copy; any error becomes Untraceable, with function and line."""
        function = self._function
        try:
            if self._copy is None:
                vars(self)["_copy"] = self._Copy()
            return self._graph.Call(self._copy, arguments, keywords)
        except Exception as error:  # A function may raise any error on Numbers.
            line = self._Line(error.__traceback__)
            if not isinstance(error, Untraceable):
                error = Untraceable(f"{type(error).__name__}: {error}")
            error.place = error.place or f"{function.__name__}(), line {line}"
            raise error from None

    def _Line(self, traceback: Any) -> int:
        """Returns the line of the function at which an error was raised."""
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
        """Returns the function with its globals, closure and defaults replaced."""
        function = self._function
        follow = functools.partial(Follow, self._graph)
        codes = self._Codes()
        for code in codes:
            _CheckCode(code, code is codes[0])
        self._graph.codes |= set(codes)

        def Import(name: str, *arguments: Any) -> Any:
            module = __import__(name, *arguments)
            # The names to import are a list if C code, as numpy's, imports; a statement
            # has a tuple or None.
            is_of_numpy = isinstance(arguments[2], list)
            return module if is_of_numpy else follow(module, name)

        own = {**BUILTINS, "__import__": Import}
        if self._graph.stand_in is not None:
            own["super"] = follow(super, "super")
        names = {**function.__globals__, "__builtins__": own}
        for name in {name for code in codes for name in code.co_names} & names.keys():
            names[name] = follow(names[name], name)
        closure = zip(codes[0].co_freevars, function.__closure__ or (), strict=True)
        cells = tuple(
            CellType(*() if x == CellType() else (follow(x.cell_contents, name),))
            for name, x in closure
        )
        defaults = tuple(follow(x, "a default") for x in function.__defaults__ or ())
        copy = FunctionType(codes[0], names, function.__name__, defaults, cells)
        others = function.__kwdefaults__ or {}
        copy.__kwdefaults__ = {name: follow(x, name) for name, x in others.items()}
        return copy


_REFUSED = {
    "PUSH_EXC_INFO": "it catches errors",
    "MATCH_CLASS": "it matches a class",
    "STORE_GLOBAL": "it assigns to a global variable",
    "DELETE_GLOBAL": "it deletes a global variable",
    "STORE_DEREF": "it assigns to a variable outside of it",
    "IS_OP": "it compares objects by `is`",
}
_REFUSED_NUMBERS = {dis.opmap[name] for name in _REFUSED}


def _IsNone(instruction: dis.Instruction | None) -> bool:
    if instruction is None or instruction.opname != "LOAD_CONST":
        return False
    return instruction.argval is None


def _CheckCode(code: CodeType, is_outermost: bool) -> None:
    """Refuses code with an instruction that cannot be followed, without running it."""
    if "__class__" in code.co_names:
        raise Untraceable("it reads __class__")
    if not _REFUSED_NUMBERS & set(code.co_code[::2]):
        return
    instructions = list(dis.get_instructions(code))
    # `with np.errstate()` has instructions that catch errors, but it catches none.
    names = Counter(x.opname for x in instructions)
    num_harmless = sum(x.argval == "errstate" for x in instructions)
    is_harmless = num_harmless == names["WITH_EXCEPT_START"] == names["PUSH_EXC_INFO"]
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
        if x.opname == "PUSH_EXC_INFO" and is_harmless:
            continue
        error = Untraceable(_REFUSED[x.opname])
        error.place = f"{code.co_name}(), line {line}"
        raise error
