"""The command `teleop-drake docs`: lists the pages, or writes the site."""

import argparse
from functools import partial
from pathlib import Path

from teleop_drake.cli.options import NAMES
from teleop_drake.cli.output import PrepareFolder
from teleop_drake.cli.progress import Notice, TellLine
from teleop_drake.cli.site import PAGES, PARTS, Site, Title
from teleop_drake.loops.framework.validation import CheckChoice, Refuse


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
        help="what the site has beside its pages (default: %(default)s)",
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def Execute(args: argparse.Namespace) -> int:
    """Prints the paths of the pages, or writes the site."""
    if args.out is None:
        width = max(len(str(page)) for page in PAGES)
        for page in PAGES:
            print(f"{page!s:<{width}}  {Title(page)}")
        return 0
    parts = [part for part in args.parts if part]
    for part in parts:
        CheckChoice("--parts", part, PARTS)
    PrepareFolder(args.out, "index.html")
    try:
        site = Site(Path(args.out), parts, partial(TellLine, args.quiet))
        site.Write()
    except ModuleNotFoundError as e:
        mended = "`pip install 'teleop-drake[docs]'` brings it"
        Refuse("--out", args.out, f"left out where {e.name} is missing ({mended})")
    for note in site.notes:
        Notice(note)
    print(Path(args.out) / "index.html")
    return 0
