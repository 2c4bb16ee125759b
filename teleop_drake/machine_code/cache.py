"""What has been compiled, kept on disk for this user."""

import functools
import hashlib
import inspect
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from importlib import metadata
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from teleop_drake.machine_code.native import Processor

# Whatever changes them may change the code.
_VERSIONS_OF = ("numpy", "drake", "llvmlite")


def Kept(
    name: str,
    text: str,
    functions: Iterable[Callable[..., Any]],
    make: Callable[[], bytes],
) -> tuple[bytes, bool]:
    """Returns an object file that is kept, or makes it and keeps it.

    It is kept under a hash of all that it depends on. Several processes may do so at
    once. Where nothing can be kept it is made each time.

    Args:
        name: First part of the file's name.
        text: What it is made of.
        functions: What is compiled into it, apart from their helpers.
        make: Returns what belongs in it.

    Returns:
        What is in it, and whether it was there.
    """
    key = _Key(text, functions)
    file = _Folder() / key[:2] / f"{name}_{key}.o"
    try:
        return file.read_bytes(), True
    except OSError:
        data = make()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as temporary:
            temporary.write(data)
        os.replace(temporary.name, file)
    except OSError:
        pass
    return data, False


def _Folder() -> Path:
    """Returns where programs keep what they can make anew, for this user."""
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA", "~")
    elif sys.platform == "darwin":
        root = "~/Library/Caches"
    else:
        root = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(root).expanduser() / "teleop-drake" / "kernels"


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
        for name, value in _Surroundings(function):
            if isinstance(value, FunctionType):
                Add(value)
            elif isinstance(value, np.ndarray):
                content.update(name.encode() + value.tobytes())
            elif isinstance(value, (int, float, tuple)):
                content.update(f"{name} = {value!r}".encode())

    for function in functions:
        Add(function)
    content.update(_Compilers())
    content.update(Processor().encode())
    return content.hexdigest()[:32]


def _Surroundings(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yields what a function takes from outside of it, by name.

    Those are helpers and constants, the variables of a function around it, and default
    values.
    """
    for name in function.__code__.co_names:
        if name in function.__globals__:
            yield name, function.__globals__[name]
    for name, cell in zip(
        function.__code__.co_freevars, function.__closure__ or (), strict=True
    ):
        yield name, cell.cell_contents
    for value in function.__defaults__ or ():
        yield "default", value


def _Content(function: FunctionType) -> bytes:
    """Returns the code of a function, and the file that it is from if there is one."""
    code = function.__code__.co_code + repr(function.__code__.co_consts).encode()
    file = inspect.getsourcefile(function)
    if file is not None and Path(file).is_file():
        return code + function.__qualname__.encode() + _FileContent(file)
    return code


@functools.cache
def _FileContent(file: str) -> bytes:
    return Path(file).read_bytes()


@functools.cache
def _Compilers() -> bytes:
    """Returns what decides what becomes of a function: this folder, and versions."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    versions = [f"{name} {metadata.version(name)}" for name in _VERSIONS_OF]
    about = " ".join([platform.python_version(), platform.machine(), *versions])
    return b"".join(file.read_bytes() for file in files) + about.encode()
