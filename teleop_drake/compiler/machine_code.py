"""Machine code of a generated program, kept on disk."""

import functools
import hashlib
import inspect
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path
from types import FunctionType
from typing import Any

from teleop_drake.compiler.jit import helpers, jit
from teleop_drake.numerics.compiled import with_compiled_helpers
from teleop_drake.numerics.delay_integrator import advance

# Whatever changes them may change the code.
_VERSIONS_OF = ("numba", "numpy", "scipy", "drake", "llvmlite")


def _EvaluateSignature() -> Any:
    """Returns the types of the generated function `evaluate`, those of any diagram."""
    from numba import types

    numbers, integers = types.float64[::1], types.int64[::1]
    t, x, m, y, dx = types.float64, numbers, numbers, numbers, numbers
    return types.void(t, x, m, numbers, integers, y, dx, types.boolean)


def CompileIntegrator(*arguments: Any) -> Callable[..., Any]:
    """Returns delay_integrator.advance() as machine code.

    It is compiled once for all diagrams, and kept on disk beside its source or in the
    user's cache.

    Args:
        arguments: As advance() takes them after the function that it integrates.
    """
    import numba
    from numba import types

    return _Integrator(
        types.int64(
            types.FunctionType(_EvaluateSignature()), *map(numba.typeof, arguments)
        )
    )


@functools.cache
def _Integrator(signature: Any) -> Callable[..., Any]:
    import numba

    law = with_compiled_helpers(advance)
    dispatcher: Callable[..., Any] = numba.njit(signature, cache=True)(law)
    return dispatcher


def CompileEvaluate(
    text: str, functions: dict[str, Callable[..., Any]]
) -> Callable[..., Any]:
    """Returns a generated function `evaluate` as machine code.

    The code is kept in the user's cache, under a hash of the source, of the functions
    that it calls, and of versions. Several processes may do so at once. Where nothing
    can be kept it is compiled each time.

    Args:
        text: The source, in the part of Python that numba knows.
        functions: What it calls, functions and named tuples, by the names in the
            source.
    """
    return _Evaluate(text, tuple(functions.items()))


@functools.cache
def _Evaluate(
    text: str, functions: tuple[tuple[str, Callable[..., Any]], ...]
) -> Callable[..., Any]:
    import numba

    key = _Key(text, [function for _, function in functions])
    file = _CacheFolder() / key[:2] / f"evaluate_{key}.py"
    is_kept = _Keep(file, text)
    names: dict[str, Any] = {
        f: jit(function) if isinstance(function, FunctionType) else function
        for f, function in functions
    }
    names["__name__"] = __name__  # Without a module numba cannot keep it.
    exec(compile(text, str(file) if is_kept else "<evaluate>", "exec"), names)
    compiler = numba.njit(_EvaluateSignature(), cache=is_kept)
    dispatcher: Callable[..., Any] = compiler(names["evaluate"])
    return dispatcher


def _CacheFolder() -> Path:
    """Returns where programs keep what they can make anew, for this user."""
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA", "~")
    elif sys.platform == "darwin":
        root = "~/Library/Caches"
    else:
        root = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(root).expanduser() / "teleop-drake" / "kernels"


def _Keep(file: Path, text: str) -> bool:
    """Writes a source once, complete or not at all; returns whether it is there.

    numba compiles anew what is newer than its code, so a file that is there stays.
    """
    if file.exists():
        return os.access(file.parent, os.W_OK)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
            "w", dir=file.parent, delete=False, encoding="utf-8"
        ) as temporary:
            temporary.write(text)
        try:
            os.link(temporary.name, file)
        except FileExistsError:  # Another process was faster.
            pass
        finally:
            os.unlink(temporary.name)
    except OSError:
        return False
    return True


def _Key(text: str, functions: Iterable[Callable[..., Any]]) -> str:
    """Returns a hash of all that the machine code of a source depends on."""
    content = hashlib.sha256(text.encode())
    seen: set[Callable[..., Any]] = set()

    def Add(function: Callable[..., Any]) -> None:
        if function in seen:
            return
        if not isinstance(function, FunctionType):  # A named tuple.
            content.update(repr((function, getattr(function, "_fields", ()))).encode())
            return
        seen.add(function)
        content.update(_Content(function))
        for _, helper in helpers(function):
            Add(helper)

    for function in functions:
        Add(function)
    Add(jit.__wrapped__)  # How all of them are compiled.
    content.update(_Versions().encode())
    return content.hexdigest()[:32]


def _Content(function: FunctionType) -> bytes:
    """Returns the file that a function is from, or its code if there is none."""
    file = inspect.getsourcefile(function)
    if file is not None and Path(file).is_file():
        return _FileContent(file) + function.__qualname__.encode()
    return function.__code__.co_code + repr(function.__code__.co_consts).encode()


@functools.cache
def _FileContent(file: str) -> bytes:
    return Path(file).read_bytes()


@functools.cache
def _Versions() -> str:
    versions = [f"{name} {metadata.version(name)}" for name in _VERSIONS_OF]
    return " ".join([platform.python_version(), platform.machine(), *versions])
