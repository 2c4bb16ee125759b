"""Joins the ES modules of the page into one script."""

import re
from importlib import resources

# The imports of a module as prettier formats them, over one line or several.
_IMPORT = re.compile(r'^import (?:[^;"]* from )?"\./([\w.]+)";\n', re.M)
_EXPORT = re.compile(r"^export (?=async|class|const|function)", re.M)


def JoinModules(name: str) -> str:
    """Returns an ES module and all of its imports as one plain script.

    Browsers load no modules from a page on the disk. So the texts of the modules are
    joined, each after its imports, without `import` and `export`. Their top-level names
    must differ, which the tests check.
    """
    joined: dict[str, str] = {}

    def Join(name: str) -> None:
        if name in joined:
            return
        text = ReadPart(f"js/{name}")
        for imported in _IMPORT.findall(text):
            Join(imported)
        joined[name] = _EXPORT.sub("", _IMPORT.sub("", text))

    Join(name)
    return '"use strict";\n' + "\n".join(joined.values())


def ReadPart(name: str) -> str:
    """Returns the text of a file in the folder of this module."""
    return resources.files("teleop_drake.page").joinpath(name).read_text("utf-8")
