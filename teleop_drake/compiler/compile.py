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
from typing import Any, cast

import numpy as np

from teleop_drake.compiler.jit import helpers, jit
from teleop_drake.compiler.source import Program
from teleop_drake.machine_code import (
    native,
    scalar_code,
    symbols,
    traced_numpy,
    tracing,
    typed_code,
    typed_expressions,
    typed_values,
)
from teleop_drake.machine_code.native import (
    Evaluate,
    Integrator,
    Kept,
    Library,
    ObjectFile,
    Processor,
)
from teleop_drake.machine_code.scalar_code import MakeCode, TraceProgram
from teleop_drake.machine_code.symbols import Untraceable
from teleop_drake.machine_code.typed_code import MakeTypedCode
from teleop_drake.machine_code.typed_values import EVALUATE, TypeOf
from teleop_drake.numerics.delay_integrator import advance

# More numbers than any array has.
_ANY_LENGTH = 2**40

# Their files decide what becomes of a program.
_COMPILERS = (
    native,
    scalar_code,
    symbols,
    traced_numpy,
    tracing,
    typed_code,
    typed_expressions,
    typed_values,
)

# Whatever changes them may change the code.
_VERSIONS_OF = ("numba", "numpy", "scipy", "drake", "llvmlite")


def CompileIntegrator(*arguments: Any) -> Integrator:
    """Returns delay_integrator.advance() as machine code.

    It is compiled once for all diagrams, and kept in the user's cache.

    Args:
        arguments: As advance() takes them after the function that it integrates.
    """
    return _Integrator((EVALUATE, *map(TypeOf, arguments)))


@functools.cache
def _Integrator(types: tuple[Any, ...]) -> Integrator:
    key = _Key(repr((types, Processor())), [advance])
    data, _ = Kept(
        _CacheFolder() / key[:2] / f"advance_{key}.o",
        lambda: ObjectFile(MakeTypedCode(cast(FunctionType, advance), types)),
    )
    return Integrator(Library(data))


def CompileEvaluate(program: Program) -> Evaluate:
    """Returns the function `evaluate` of a program as machine code.

    The code is kept in the user's cache, under a hash of the source, of the functions
    that it calls, and of versions. Several processes may do so at once. Where nothing
    can be kept it is compiled each time.

    What a graph of operations cannot do, such as a loop until something has converged,
    is left to numba, which takes longer.

    Args:
        program: What to compute, in the part of Python that numba knows.
    """
    parameters, integers = program.parameters
    return _Compiled(
        program.text,
        tuple(program.names.items()),
        program.sizes,
        len(parameters),
        tuple(integers.tolist()),
    )


@functools.cache
def _Compiled(
    text: str,
    names: tuple[tuple[str, Callable[..., Any]], ...],
    sizes: tuple[int, int, int],
    num_parameters: int,
    integers: tuple[int, ...],
) -> Evaluate:
    key = _Key(
        repr((text, sizes, num_parameters, integers, Processor())),
        [function for _, function in names],
    )
    file = _CacheFolder() / key[:2] / f"evaluate_{key}.o"

    def Make() -> bytes:
        q = np.array(integers, np.int64)
        traced = TraceProgram(text, dict(names), sizes, num_parameters, q)
        return ObjectFile(MakeCode(traced))

    try:
        data, is_from_cache = Kept(file, Make)
    except Untraceable:
        return _CompiledByNumba(text, names, sizes[1])
    library = Library(data)
    return Evaluate(library.Address("evaluate"), library, is_from_cache)


def _CompiledByNumba(
    text: str, functions: tuple[tuple[str, Callable[..., Any]], ...], num_x: int
) -> Evaluate:
    import numba
    from numba import types

    key = _Key(text, [function for _, function in functions])
    file = _CacheFolder() / key[:2] / f"evaluate_{key}.py"
    is_kept = _Keep(file, text)
    names: dict[str, Any] = {
        f: jit(function) if isinstance(function, FunctionType) else function
        for f, function in functions
    }
    names["__name__"] = __name__  # Without a module numba cannot keep it.
    exec(compile(text, str(file) if is_kept else "<evaluate>", "exec"), names)
    numbers, integers = types.float64[::1], types.int64[::1]
    signature = types.void(
        *(types.float64, numbers, numbers, numbers, integers, numbers, numbers),
        types.boolean,
    )
    dispatcher = numba.njit(signature, cache=is_kept)(names["evaluate"])
    return _ByPointers(dispatcher, num_x)


def _ByPointers(evaluate: Any, num_x: int) -> Evaluate:
    """Returns a compiled function of arrays as one that takes pointers.

    How long the arrays are stays with the caller: the function takes parts of them.

    Args:
        evaluate: The function. Where it raises an error, no rate is a number.
        num_x: How many rates there are.
    """
    import numba
    from numba import types

    carray = numba.carray  # type: ignore[attr-defined, unused-ignore]

    def call(
        t: Any, x: Any, m: Any, p: Any, q: Any, y: Any, dx: Any, everything: Any
    ) -> None:
        rates = carray(dx, num_x)
        try:
            evaluate(
                t,
                carray(x, _ANY_LENGTH),
                carray(m, _ANY_LENGTH),
                carray(p, _ANY_LENGTH),
                carray(q, _ANY_LENGTH),
                carray(y, _ANY_LENGTH),
                rates,
                everything != 0,
            )
        except Exception:
            for i in range(num_x):
                rates[i] = np.nan

    pointer: Callable[..., Any] = types.CPointer
    numbers, integers = pointer(types.float64), pointer(types.int64)
    signature = types.void(
        *(types.float64, numbers, numbers, numbers, integers, numbers, numbers),
        types.int32,
    )
    function = numba.cfunc(signature)(call)
    misses = sum(evaluate.stats.cache_misses.values())
    return Evaluate(int(function.address or 0), function, misses == 0)


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
    for module in _COMPILERS:
        content.update(_FileContent(str(module.__file__)))
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
