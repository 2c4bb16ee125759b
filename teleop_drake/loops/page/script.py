"""Joins the ES modules of the page into one script."""

import re
from importlib import resources

# The imports of a module as prettier formats them, over one line or several.
_IMPORT = re.compile(r'^import (?:[^;"]* from )?"\./([\w.]+)";\n', re.M)
_EXPORT = re.compile(r"^export (?=async|class|const|function)", re.M)

# A line with nothing but a comment.
_COMMENT = re.compile(r"^ *//.*\n", re.M)


def JoinModules(name: str) -> str:
    """Returns an ES module and all of its imports as one plain script.

    Browsers load no modules from a page on the disk. So the texts of the modules are
    joined, each after its imports, without `import` and `export`, and with the first
    line of their comments. Their top-level names must differ, which the tests check.
    """
    joined: dict[str, str] = {}

    def Join(name: str) -> None:
        if name in joined:
            return
        text = ReadPart(f"js/{name}")
        for imported in _IMPORT.findall(text):
            Join(imported)
        head, _, rest = text.partition("\n")
        code = _COMMENT.sub("", _EXPORT.sub("", _IMPORT.sub("", rest)))
        joined[name] = f"{head}\n{code}"

    Join(name)
    return '"use strict";\n' + "\n".join(joined.values())


def ReadPart(name: str) -> str:
    """Returns the text of a file in the folder of this module."""
    return resources.files("teleop_drake.loops.page").joinpath(name).read_text("utf-8")
