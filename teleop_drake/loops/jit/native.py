"""Compiles LLVM's code to object files, caches them, and links them into the process.

Each user has a cache of object files on disk.
"""

import contextlib
import ctypes
import functools
import hashlib
import itertools
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.files import Replacing

# The level of optimisation of LLVM's code. At a lower level, the checks of indices
# remain inside of loops.
_LEVEL = 3

# The level of optimisation of the machine code. A higher level takes longer, and the
# code is no faster.
_MACHINE_LEVEL = 1

# Beyond this total size, files of all versions are deleted, least recently used first.
_MAX_BYTES = 64_000_000

_HASH = hashlib.sha256
_HASH_SIZE = _HASH().digest_size


@functools.cache
def _Machine() -> Any:
    """Returns LLVM's description of this machine."""
    import llvmlite.binding as llvm

    try:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
    except RuntimeError:  # Newer versions of llvmlite refuse it and do not need it.
        pass
    return llvm.Target.from_default_triple().create_target_machine(
        opt=_MACHINE_LEVEL,
        reloc="pic",
        codemodel="jitdefault",
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        jit=True,
    )


def ObjectFile(code: str) -> bytes:
    """Returns LLVM's code as an object file."""
    import llvmlite.binding as llvm

    machine = _Machine()
    module = llvm.parse_assembly(code)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=_LEVEL)
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)


def Kept(name: str, code: str, make: Callable[[str], bytes] = ObjectFile) -> bytes:
    """Returns the object file of LLVM's code from the cache, or makes and stores it.

    Several processes may do so at once. The object file is made anew if the cache
    cannot be written, or if the file in the cache is damaged.

    Args:
        name: The beginning of the file's name.
        code: The code in LLVM's language.
        make: The function that makes the object file from the code.
    """
    folder = _Folder()
    file = folder / _Version() / f"{name}_{_HASH(code.encode()).hexdigest()[:32]}.o"
    with contextlib.suppress(OSError):
        content = file.read_bytes()
        data = content[_HASH_SIZE:]
        if _HASH(data).digest() == content[:_HASH_SIZE]:
            with contextlib.suppress(OSError):
                os.utime(file)  # A file's time is the time of its last use.
            return data
    data = make(code)
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with Replacing(file) as temporary:
            temporary.write_bytes(_HASH(data).digest() + data)
        _Sweep(folder)
    return data


def _Folder() -> Path:
    """Returns the folder of this user's cache."""
    root = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    if sys.platform == "darwin":
        root = "~/Library/Caches"
    return Path(root).expanduser() / "teleop-drake" / "kernels"


@functools.cache
def _Version() -> str:
    """Returns the name of the folder of object files: a hash of what they depend on.

    Besides their code, these are llvmlite's version, the processor and the levels of
    optimisation.
    """
    import llvmlite
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    processor = f"{llvm.get_default_triple()} {llvm.get_host_cpu_name()} {features}"
    target = f"llvmlite {llvmlite.__version__} {processor} {_LEVEL} {_MACHINE_LEVEL}"
    return _HASH(target.encode()).hexdigest()[:16]


def _Sweep(folder: Path) -> None:
    """Deletes the least recently used files beyond a total of _MAX_BYTES."""
    size = 0
    files = [(file.stat(), file) for file in folder.rglob("*") if file.is_file()]
    for status, file in sorted(files, key=lambda x: x[0].st_mtime, reverse=True):
        size += status.st_size
        if size > _MAX_BYTES:
            file.unlink(missing_ok=True)


@functools.cache
def _Linker() -> Any:
    """Returns the linker of libraries, and a counter that numbers them."""
    import llvmlite.binding as llvm

    _Machine()
    return llvm.create_lljit_compiler(), itertools.count()


class Library:
    """The named functions and variables of an object file, linked into the process."""

    def __init__(self, data: bytes, *names: str):
        import llvmlite.binding as llvm

        linker, numbers = _Linker()
        builder = llvm.JITLibraryBuilder().add_object_img(data).add_current_process()
        for name in names:
            builder.export_symbol(name)
        self._addresses = builder.link(linker, f"library{next(numbers)}")

    def Address(self, name: str) -> int:
        """Returns the address of a function or variable."""
        return int(self._addresses[name])

    def RaiseFault(self) -> None:
        """Raises an IndexError if a function has ended at an index; see typed_code."""
        place = ctypes.c_char_p.from_address(self.Address("fault"))
        if place.value is not None:
            where = place.value.decode()
            place.value = None
            raise IndexError(f"{where}: an index is outside of its array")


# PYFUNCTYPE holds Python's lock: its release would take as long as a short law.
_EVALUATE = ctypes.PYFUNCTYPE(
    None, ctypes.c_double, *[ctypes.c_void_p] * 5, ctypes.c_int32
)


class Evaluate:
    """The function `evaluate` of a library in machine code; see `scalar_code`."""

    def __init__(self, library: Library):
        address = library.Address("evaluate")
        self.pointer = ctypes.c_void_p(address)
        self._library = library
        self._function = _EVALUATE(address)

    def __call__(self, t: float, *others: Any) -> None:
        """Calls the function."""
        *arrays, wanted = others
        self._function(t, *(array.ctypes.data for array in arrays), wanted)


# An array of no bytes, as which the start of any array can be addressed.
_Nothing = ctypes.c_char * 0


def _Address(array: Any) -> int:
    """Returns the address of an array, in a third of the time of array.ctypes."""
    return ctypes.addressof(_Nothing.from_buffer(array))


def BoundEvaluate(library: Library, p: Array, dx: Array) -> Callable[[], None]:
    """Returns a function that evaluates a law with the same arrays each time.

    Args:
        library: The library of the law; see scalar_code.TraceLaw().
        p: The arguments of the law, read in each call.
        dx: The result of the law, written in each call.
    """
    function = _EVALUATE(library.Address("evaluate"))
    addresses = None, None, _Address(p), None, _Address(dx)
    call = functools.partial(function, 0.0, *addresses, 0)
    call.__dict__["owners"] = library, p, dx
    return call


def Header(value: Any) -> list[int]:
    """Returns the header of a named tuple: its arrays' addresses and dimensions.

    A field that is None has no place in it.
    """
    if value is None:
        return []
    if isinstance(value, np.ndarray):
        return [_Address(value), *value.shape]
    if isinstance(value, (int, np.integer)):
        return [int(value)]
    return [number for item in value for number in Header(item)]


class Packed:
    """A named tuple of arrays with its header, for functions that take it many times.

    Args:
        value: The tuple. The memory of its arrays must not move.
    """

    def __init__(self, value: tuple[Any, ...]):
        self.value: Any = value
        self.header = np.array(Header(value), np.int64)
        self.pointer = ctypes.c_void_p(_Address(self.header))


class TypedFunction:
    """A function of arrays in machine code; see typed_code."""

    def __init__(self, library: Library, name: str):
        self._library = library
        self._function = ctypes.CFUNCTYPE(ctypes.c_int64)(library.Address(name))

    def __call__(self, *arguments: Any) -> int:
        """Calls it with floats, named tuples (Packed or not), and an Evaluate."""
        # The headers must not be freed before the call returns.
        owners = [Packed(x) if isinstance(x, tuple) else x for x in arguments]
        status: int = self._function(*map(_Argument, owners))
        self._library.RaiseFault()
        return status


def _Argument(value: Any) -> ctypes.c_void_p | ctypes.c_double:
    """Returns a value as the argument of a function in machine code."""
    if isinstance(value, Packed | Evaluate):
        return value.pointer
    return ctypes.c_double(value)
