"""The documentation as HTML: the pages, and the API reference from the docstrings."""

import os
import pkgutil
import re
import types
import warnings
from pathlib import Path

import teleop_drake

_PACKAGE = Path(teleop_drake.__file__).parent
_DOCS = _PACKAGE / "docs"

# The pages, the index first. The misprints of the thesis stand beside its claims.
PAGES = [
    _DOCS / "index.md",
    *sorted(path for path in _DOCS.glob("*.md") if path.stem != "index"),
    _PACKAGE / "thesis" / "errata.md",
]


def Title(page: Path) -> str:
    """Returns the heading of a page."""
    return page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


def WriteSite(out: Path) -> None:
    """Writes every page, and the reference of every module of the package.

    To pdoc a page is a module that has nothing but a docstring.

    Args:
        out: The folder; `index.html` in it is the first page.

    Raises:
        ModuleNotFoundError: If pdoc is not installed.
    """
    import pdoc

    pdoc.render.configure(docformat="google", show_source=False, math=True)
    modules = {}
    for page in PAGES:
        module = types.ModuleType(page.stem, _TextOnSite(page))
        vars(module).update(__file__=str(page), __docformat__="markdown", __all__=[])
        modules[page.stem] = pdoc.doc.Module(module)
    names = [x.name for x in pkgutil.walk_packages([str(_PACKAGE)], "teleop_drake.")]
    for name in ["teleop_drake", *names]:
        if not name.endswith("__main__"):
            modules[name] = pdoc.doc.Module.from_name(name)
    # pdoc does not see that the package's own names are imported on demand.
    warnings.filterwarnings("ignore", "Found .* in teleop_drake.__all__")
    for name, documented in modules.items():
        file = out / f"{name.replace('.', '/')}.html"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(pdoc.render.html_module(documented, modules), "utf-8")
    (out / "search.js").write_text(pdoc.render.search_index(modules), "utf-8")


def _TextOnSite(page: Path) -> str:
    """Returns the text of a page, in which the links to files are those of the site.

    A link to a file of the repository that the site does not have becomes plain text.
    """

    def Link(match: re.Match[str]) -> str:
        text, file, anchor = match.groups()
        path = Path(os.path.normpath(page.parent / file))
        if path in PAGES:
            return f"{text}({path.stem}.html{anchor})"
        if path.is_relative_to(_PACKAGE) and path.suffix in ("", ".py"):
            module = path.relative_to(_PACKAGE.parent).with_suffix("")
            return f"{text}({module.as_posix()}.html{anchor})"
        return text[1:-1]

    return re.sub(
        r"(?<!!)(\[[^]]+\])\(([^):#]+)(#[^)]*|)\)", Link, page.read_text("utf-8")
    )
