"""The command `teleop-drake docs`: the pages, and the reference from the docstrings."""

import argparse
import os
import pkgutil
import re
import types
import warnings
from pathlib import Path

import teleop_drake
from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.cli.output import PrepareFolder

_PACKAGE = Path(teleop_drake.__file__).parent
_DOCS = _PACKAGE / "docs"

# The pages, the index first. The misprints of the thesis stand beside its claims.
PAGES = [
    _DOCS / "index.md",
    *sorted(path for path in _DOCS.glob("*.md") if path.stem != "index"),
    _PACKAGE / "thesis" / "errata.md",
]


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="write the pages and the API reference as HTML into this folder; needs "
        "the extra `docs`",
    )


def Execute(args: argparse.Namespace) -> int:
    """Says where the pages are, or writes them and the API reference as HTML."""
    if args.out is None:
        width = max(len(str(page)) for page in PAGES)
        for page in PAGES:
            print(f"{page!s:<{width}}  {Title(page)}")
        return 0
    PrepareFolder(args.out, "index.html")
    try:
        WriteSite(Path(args.out))
    except ModuleNotFoundError as e:
        raise BadInput(
            f"--out = {args.out!r}: must be left out where {e.name} is missing "
            "(`pip install 'teleop-drake[docs]'` brings it)"
        ) from None
    print(Path(args.out) / "index.html")
    return 0


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
