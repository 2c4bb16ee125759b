"""Machine code for laws, where numba is installed (the extra `fast`)."""

import functools
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any, TypeVar, cast

Law = TypeVar("Law", bound=Callable[..., Any])


class CompiledLaw:
    """A law that is called as machine code, or as it is within interpreted().

    Args:
        law: The law.
    """

    def __init__(self, law: Callable[..., Any]):
        self.law = law

    @functools.cached_property
    def dispatcher(self) -> Callable[..., Any]:
        """The law for numba, which takes a while to import."""
        import numba

        dispatcher: Callable[..., Any] = numba.njit(cache=True)(
            with_compiled_helpers(self.law)
        )
        return dispatcher

    def __call__(self, *args: Any) -> Any:
        """Calls the law."""
        return (self.law if _is_interpreted else self.dispatcher)(*args)


_is_interpreted = False


@contextmanager
def interpreted() -> Iterator[None]:
    """Lets compiled laws run as they are, where a few calls do not pay compiling."""
    global _is_interpreted
    before, _is_interpreted = _is_interpreted, True
    try:
        yield
    finally:
        _is_interpreted = before


def is_python(law: Callable[..., Any]) -> bool:
    """Returns whether a law will not be called as machine code.

    Args:
        law: Of compiled().
    """
    return _is_interpreted or not isinstance(law, CompiledLaw)


@functools.cache
def compiled(law: Law) -> Law:
    """Returns a law as machine code if numba is installed, otherwise the law itself.

    The result takes positional arguments, and is the same function of them to within
    rounding. It is compiled at the first call and kept on disk beside the law, or in
    the user's cache where that is not possible. NUMBA_DISABLE_JIT=1 turns it off.

    Args:
        law: A function of numbers, arrays and tuples of these, in the part of Python
            that numba knows. The functions of this package that it calls are in its
            own file: only changes to that file make numba compile it anew.
    """
    if any(importlib.util.find_spec(name) is None for name in ("numba", "scipy")):
        return law  # numba's linear algebra is scipy's.
    if _is_disabled():
        return law
    return cast(Law, CompiledLaw(law))


def _is_disabled() -> bool:
    """Returns whether numba is not to compile; it is not imported for that."""
    numba = sys.modules.get("numba")
    if numba is None:
        return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
    return bool(numba.config.DISABLE_JIT)


def with_compiled_helpers(law: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a copy of a function that calls compiled functions.

    Args:
        law: A function in the part of Python that numba knows.
    """
    assert isinstance(law, FunctionType)
    names = dict(law.__globals__)
    for name in law.__code__.co_names:
        helper = names.get(name)
        if isinstance(helper, FunctionType):
            assert helper.__module__ == law.__module__, helper
            inner = compiled(helper)
            is_wrapped = isinstance(inner, CompiledLaw)
            names[name] = inner.dispatcher if is_wrapped else inner
    copy = FunctionType(law.__code__, names, law.__name__, law.__defaults__)
    return functools.update_wrapper(copy, law)
