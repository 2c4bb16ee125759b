"""Any Diagram of Drake's, with exact delays: run it, compile it, draw it, ask margins.

    from teleop_drake.loops import TransportDelay as TransportDelay
    from teleop_drake.loops import simulate as simulate

README.md in this folder shows how. Each name is imported on its first use.
"""

import re
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

# An import of one name in a stub.
_IMPORT = re.compile(r"^from ([\w.]+) import (?:\(\s*)?(\w+|\*)", re.MULTILINE)


def ReadStub(file: str) -> dict[str, str]:
    """Returns the modules of the names that the stub of a package imports.

    The stub is `__init__.pyi`, which type checkers read as well.

    Args:
        file: The `__init__.py` beside the stub.
    """
    with open(f"{file}i", encoding="utf-8") as stub:
        imports = _IMPORT.findall(stub.read())
    return {name: module for module, name in imports}


def Importer(package: str, places: Mapping[str, str]) -> Callable[[str], Any]:
    """Returns the `__getattr__` of a package that imports each name on its first use.

    Args:
        package: The name of the package.
        places: The module of each name.
    """

    def Import(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(places[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return Import


_PLACES = ReadStub(__file__)

__all__ = sorted(_PLACES)
__getattr__ = Importer(__name__, _PLACES)


def __dir__() -> list[str]:
    """Returns the public names, including those not imported yet."""
    return list(__all__)
