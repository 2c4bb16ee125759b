"""The command `teleop-drake docs`."""

import argparse
from pathlib import Path

from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.cli.output import PrepareFolder


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
    from teleop_drake.cli.site import PAGES, Title, WriteSite

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
