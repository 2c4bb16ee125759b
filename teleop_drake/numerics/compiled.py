"""Machine code for laws, where numba is installed (the extra `fast`)."""

import functools
import importlib.util
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar, cast

Law = TypeVar("Law", bound=Callable[..., Any])


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
    import numba

    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined, unused-ignore]
        return law
    return cast(Law, numba.njit(cache=True)(with_compiled_helpers(law)))


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
            names[name] = compiled(helper)
    copy = FunctionType(law.__code__, names, law.__name__, law.__defaults__)
    return functools.update_wrapper(copy, law)
