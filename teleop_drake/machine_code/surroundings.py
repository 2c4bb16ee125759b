"""Comparison of all that functions read from outside of their arguments.

Machine code holds the values of globals, attributes, elements of lists and dicts,
closures and defaults as they were when the functions were traced. Surroundings finds
everything that the functions may read there, rather too much than too little, and
compares it by identity, arrays by value. This takes a few microseconds.

The standard library, numpy, scipy and Drake do not change. An object whose state
cannot be seen from Python, such as a generator of random numbers, always does.
"""

import builtins
import contextlib
import sys
import types
from collections import OrderedDict, defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from itertools import chain
from operator import is_
from types import CellType, FunctionType, MappingProxyType, ModuleType
from typing import Any, Generic, TypeVar

import numpy as np

from teleop_drake.machine_code.symbols import Ref

_T = TypeVar("_T")

_LIBRARIES = sys.stdlib_module_names | {"numpy", "pydrake", "scipy"}

# Nothing in them changes.
_FIXED = (
    bool, int, float, complex, str, bytes, range, slice, types.NoneType,
    types.EllipsisType, types.CodeType, types.ClassMethodDescriptorType,
    types.GetSetDescriptorType, types.MemberDescriptorType, types.MethodDescriptorType,
    types.MethodWrapperType, types.WrapperDescriptorType, type(vars(Ref)["place"]),
    np.generic, np.dtype, np.ufunc, type(np.sum),
)  # fmt: skip

# Bases of a library whose state is in their elements, attributes and slots.
_VISIBLE = {
    object, tuple, list, dict, set, frozenset, deque, OrderedDict, defaultdict,
    MappingProxyType, types.MethodType, CellType, partial, property, staticmethod,
    classmethod,
}  # fmt: skip
_VISIBLE_MODULES = {"abc", "dataclasses", "enum", "types", "typing"}

_CONTENTS = CellType.cell_contents


class Surroundings:
    """All that some functions may read besides their arguments, as it is now.

    Args:
        roots: The functions, or anything else to compare.
    """

    def __init__(self, *roots: Any):
        self._is_visible = True
        # The comparisons as expressions, and the objects in them by name.
        self._terms: list[str] = []
        self._objects: dict[str, Any] = {"IsSame": _IsSame}
        # Modules and classes, and the names that any function may take from them.
        self._owners: list[ModuleType | type] = []
        self._names: set[str] = set()
        # By identity.
        self._seen: dict[int, Any] = {}
        self._namespaces: dict[int, tuple[Mapping[str, Any], set[str]]] = {}
        pending = [*roots]
        while pending:
            while pending:
                pending += self._Visit(pending.pop())
            for owner in self._owners:
                pending += self._AddNames(owner, vars(owner), self._NamesOf(owner))
        # One expression: a function for each comparison takes three times as long.
        text = " and ".join(self._terms) or "True"
        self._compare: Callable[[], bool] = eval(f"lambda: {text}", self._objects)

    def AreSame(self) -> bool:
        """Returns whether everything is still as it was."""
        try:
            return self._is_visible and self._compare()
        except (AttributeError, KeyError, ValueError):  # It is gone.
            return False

    def _Expect(self, term: str, *objects: Any) -> None:
        """Adds a comparison, in which {} stands for an object."""
        names = [f"x{len(self._objects) + i}" for i in range(len(objects))]
        self._objects.update(zip(names, objects, strict=True))
        self._terms.append(term.format(*names))

    def _AddNames(
        self, owner: Any, namespace: Mapping[str, Any], names: Iterable[str]
    ) -> list[Any]:
        """Adds names, and returns the values of those that are new."""
        _, known = self._namespaces.setdefault(id(owner), (namespace, set()))
        new = set(names) - known
        known |= new
        for name in new:
            if name in namespace:
                self._Expect("{}[{}] is {}", namespace, name, namespace[name])
            else:
                self._Expect("{} not in {}", name, namespace)
        return [namespace[name] for name in new if name in namespace]

    def _NamesOf(self, owner: ModuleType | type) -> set[str]:
        """Returns the names of a module or class that functions may take."""
        if isinstance(owner, ModuleType):
            return self._names & vars(owner).keys()
        return {
            name
            for base in owner.__mro__
            for name, value in vars(base).items()
            if name in self._names
            or (name.startswith("__") and isinstance(value, FunctionType))
        }

    def _Visit(self, item: Any) -> Iterable[Any]:
        """Adds an object, and returns the objects that can be reached from it."""
        if isinstance(item, _FIXED) or id(item) in self._seen:
            return ()
        self._seen[id(item)] = item
        if isinstance(item, (FunctionType, type, ModuleType)):
            name = item.__name__ if isinstance(item, ModuleType) else item.__module__
            if (name or "").partition(".")[0] in _LIBRARIES:
                return ()
        if isinstance(item, FunctionType):
            return self._VisitFunction(item)
        if isinstance(item, types.BuiltinFunctionType):
            return (item.__self__,)
        if isinstance(item, ModuleType):
            self._owners.append(item)
            return ()
        if isinstance(item, type):
            self._owners.append(item)
            return *item.__bases__, type(item)
        if isinstance(item, np.ndarray):
            self._Expect("{}.tobytes() == {}", item, item.tobytes())
            return list(item.flat) if item.dtype == object else ()
        return self._VisitObject(item)

    def _VisitFunction(self, function: FunctionType) -> Iterable[Any]:
        names, space = _NamesIn(function.__code__), function.__globals__
        self._names |= names
        self._Expect("{}.__code__ is {}", function, function.__code__)
        defaults = function.__defaults__, function.__kwdefaults__
        if any(defaults):
            self._Expect(
                "({0}.__defaults__ is {1} and {0}.__kwdefaults__ is {2})",
                function,
                *defaults,
            )
        package = space.get("__package__")
        imported = (sys.modules.get(n) for x in names for n in (x, f"{package}.{x}"))
        taken = (x for x in names if x in space or hasattr(builtins, x))
        return [
            *self._AddNames(space, space, taken),
            *imported,
            *defaults,
            *(function.__closure__ or ()),
            vars(function) or None,
        ]

    def _VisitObject(self, item: Any) -> Iterable[Any]:
        bases = type(item).__mro__
        if not all(map(_IsVisible, bases)):
            self._is_visible = False
            return ()
        inside: list[Any] = [type(item)]
        if isinstance(item, (tuple, frozenset)):
            inside += item
        elif isinstance(item, (list, set, deque)):
            self._Expect("IsSame({}, {})", item, tuple(item))
            inside += item
        elif isinstance(item, (dict, MappingProxyType)):
            inside += self._VisitDict(item)
        if hasattr(item, "__dict__"):
            inside += self._VisitDict(vars(item))
        for slot in chain.from_iterable(vars(base).values() for base in bases):
            if isinstance(slot, types.MemberDescriptorType) or slot is _CONTENTS:
                with contextlib.suppress(AttributeError, ValueError):  # It is empty.
                    inside.append(slot.__get__(item))
                    if slot.__get__(item) is inside[-1]:  # No number of C's.
                        self._Expect("{}({}) is {}", slot.__get__, item, inside[-1])
        return inside

    def _VisitDict(self, values: Mapping[Any, Any]) -> Iterable[Any]:
        self._Expect("IsSame({}, {})", values, tuple(values))
        self._Expect("IsSame({}.values(), {})", values, tuple(values.values()))
        return *values, *values.values()


class UpToDate(Generic[_T]):
    """A value that depends on functions, made anew when their surroundings change."""

    def __init__(self, functions: Iterable[Any], make: Callable[[], _T]):
        self._functions, self._make = tuple(functions), make
        self._made: tuple[_T, Surroundings] | None = None

    def Get(self) -> tuple[_T, Surroundings]:
        """Returns the value, and the surroundings that it was made in."""
        if self._made is None or not self._made[1].AreSame():
            surroundings = Surroundings(*self._functions)
            self._made = self._make(), surroundings
        return self._made


def _IsVisible(base: type) -> bool:
    """Returns whether Python sees the state that a base class adds to an object."""
    if base in _VISIBLE or base.__module__ in _VISIBLE_MODULES:
        return True
    is_made_in_python = bool(base.__flags__ & 1 << 9)  # Py_TPFLAGS_HEAPTYPE
    return is_made_in_python and base.__module__.partition(".")[0] not in _LIBRARIES


def _NamesIn(code: types.CodeType) -> set[str]:
    """Returns the names and the texts in a function, also in its inner functions."""
    names = {x for x in chain(code.co_names, code.co_consts) if isinstance(x, str)}
    inner = (_NamesIn(x) for x in code.co_consts if isinstance(x, types.CodeType))
    return names.union(*inner)


def _IsSame(items: Collection[Any], before: Collection[Any]) -> bool:
    return len(items) == len(before) and all(map(is_, items, before))
