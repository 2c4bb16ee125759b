"""The command `teleop-drake docs`: lists the pages, or writes the site."""

import argparse
import re
import sys
from pathlib import Path

from teleop_drake.cli.options import NAMES
from teleop_drake.cli.output import PrepareFolder
from teleop_drake.cli.progress import Notice
from teleop_drake.loops.framework.validation import CheckChoice, Refuse

_PACKAGE = Path(__file__).parents[2]
_DOCS = _PACKAGE / "docs"
_INDEX = _DOCS / "index.md"

# The pages: the index, then the pages in the order of its table. The list of the
# thesis's misprints is in the folder of its claims.
_NAMES = re.findall(r"(?m)^\| \[[^]]+\]\((\w+\.md)\)", _INDEX.read_text("utf-8"))
PAGES = [
    _INDEX,
    *(_DOCS / name for name in _NAMES),
    _PACKAGE / "thesis" / "errata.md",
]

PARTS = ("live", "api", "thesis", "notebooks")
"""The optional parts of a site, in addition to its pages."""

_NO_NOTEBOOKS = (
    "notebooks: left out, because an installed package has none; run "
    "`teleop-drake docs --out DIR` in a checkout of the repository"
)


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="write the site into this folder: pages, living diagrams, the API "
        "reference, the executable thesis, and notebooks with their outputs; needs "
        "the extra `docs`",
    )
    parser.add_argument(
        "--parts",
        **NAMES,
        default=",".join(PARTS),
        help="what the site has beside its pages; without `notebooks`, they are not "
        "run and have no outputs (default: %(default)s)",
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def Execute(args: argparse.Namespace) -> int:
    """Prints the paths of the pages, or writes the site."""
    if args.out is None:
        width = max(len(str(page)) for page in PAGES)
        for page in PAGES:
            title = page.read_text("utf-8").splitlines()[0].removeprefix("# ")
            print(f"{page!s:<{width}}  {title}")
        return 0
    parts = [part for part in args.parts if part]
    for part in parts:
        CheckChoice("--parts", part, PARTS)
    (start,) = PrepareFolder(args.out, "index.html")
    try:
        from sphinx.application import Sphinx
    except ModuleNotFoundError as e:
        mended = "`pip install 'teleop-drake[docs]'` brings it"
        Refuse("--out", args.out, f"left out where {e.name} is missing ({mended})")
    if "notebooks" in parts and not (_PACKAGE.parent / "notebooks").is_dir():
        Notice(_NO_NOTEBOOKS)
    site = Sphinx(
        srcdir=_PACKAGE.parent,
        confdir=_DOCS,
        outdir=args.out,
        doctreedir=start.parent / ".doctrees",
        buildername="html",
        confoverrides={"nb_execution_cache_path": str(start.parent / ".doctrees/runs")},
        status=None if args.quiet else sys.stderr,
        warning=sys.stderr,
        tags=parts,
    )
    site.build()
    if site.statuscode == 0:
        print(start)
    return site.statuscode
