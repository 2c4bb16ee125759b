"""A cache on disk of the object files made from LLVM's code, one for each user."""

import contextlib
import functools
import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path

from teleop_drake.files import Replacing
from teleop_drake.jit.native import ObjectFile, Target

# Beyond this total size, files of all versions are deleted, least recently used first.
_MAX_BYTES = 64_000_000

_HASH = hashlib.sha256
_HASH_SIZE = _HASH().digest_size


def Kept(
    name: str, code: str, make: Callable[[str], bytes] | None = None
) -> tuple[bytes, bool]:
    """Returns the object file of LLVM's code from the cache, or makes and stores it.

    Several processes may do so at once. The object file is made anew if the cache
    cannot be written, or if the file in the cache is damaged.

    The file's name begins with `name`. `make` is the function that makes the file from
    the code. The second result is whether the file was in the cache.
    """
    folder = _Folder()
    file = folder / _Version() / f"{name}_{_HASH(code.encode()).hexdigest()[:32]}.o"
    with contextlib.suppress(OSError):
        content = file.read_bytes()
        data = content[_HASH_SIZE:]
        if _HASH(data).digest() == content[:_HASH_SIZE]:
            with contextlib.suppress(OSError):
                os.utime(file)  # A file's time is the time of its last use.
            return data, True
    data = (make or ObjectFile)(code)
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with Replacing(file) as temporary:
            temporary.write_bytes(_HASH(data).digest() + data)
        _Sweep(folder)
    return data, False


def _Folder() -> Path:
    """Returns the folder of this user's cache."""
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA", "~")
    elif sys.platform == "darwin":
        root = "~/Library/Caches"
    else:
        root = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(root).expanduser() / "teleop-drake" / "kernels"


@functools.cache
def _Version() -> str:
    """Returns a folder name that identifies llvmlite's version and the processor."""
    return _HASH(Target().encode()).hexdigest()[:16]


def _Sweep(folder: Path) -> None:
    """Deletes the files that were used longest ago."""
    size = 0
    files = [(file.stat(), file) for file in folder.rglob("*") if file.is_file()]
    for status, file in sorted(files, key=lambda x: x[0].st_mtime, reverse=True):
        size += status.st_size
        if size > _MAX_BYTES:
            file.unlink(missing_ok=True)
