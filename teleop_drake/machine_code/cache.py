"""Object files of LLVM's code, kept on disk for this user."""

import contextlib
import functools
import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path

from teleop_drake.files import Replacing
from teleop_drake.machine_code.native import ObjectFile, Target

# Files beyond this size in all are deleted, those first that were used longest ago,
# also those of other versions.
_MAX_BYTES = 64_000_000

_HASH = hashlib.sha256
_HASH_SIZE = _HASH().digest_size


def Kept(
    name: str, code: str, make: Callable[[str], bytes] | None = None
) -> tuple[bytes, bool]:
    """Returns the object file of LLVM's code from the cache, or makes it and keeps it.

    Several processes may do so at once. Where nothing can be kept it is made each time,
    and so it is where the file in the cache is damaged.

    The file's name begins with `name`. `make` may make something else of the code. The
    second result is whether it was there.
    """
    folder = _Folder()
    file = folder / _Version() / f"{name}_{_HASH(code.encode()).hexdigest()[:32]}.o"
    with contextlib.suppress(OSError):
        content = file.read_bytes()
        data = content[_HASH_SIZE:]
        if _HASH(data).digest() == content[:_HASH_SIZE]:
            with contextlib.suppress(OSError):
                os.utime(file)  # The time of its last use.
            return data, True
    data = (make or ObjectFile)(code)
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with Replacing(file) as temporary:
            temporary.write_bytes(_HASH(data).digest() + data)
        _Sweep(folder)
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


@functools.cache
def _Version() -> str:
    """Returns a folder's name for all that an object file depends on besides code."""
    return _HASH(Target().encode()).hexdigest()[:16]


def _Sweep(folder: Path) -> None:
    """Deletes what was used longest ago."""
    size = 0
    files = [(file.stat(), file) for file in folder.rglob("*") if file.is_file()]
    for status, file in sorted(files, key=lambda x: x[0].st_mtime, reverse=True):
        size += status.st_size
        if size > _MAX_BYTES:
            file.unlink(missing_ok=True)
