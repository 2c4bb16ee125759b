"""The command `teleop-drake reproduce`."""

import argparse
import sys
from pathlib import Path

from teleop_drake.cli.exit_codes import FAILED, BadInput, Fail
from teleop_drake.cli.options import AddFormatOption, FormatsOf
from teleop_drake.cli.output import PrepareFolder


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.add_argument(
        "--out",
        metavar="DIR",
        default="out",
        help="write figures, ledger (.json and .csv) and report.html there (default: "
        "out)",
    )
    AddFormatOption(parser, default="png,svg")
    parser.add_argument(
        "--only",
        metavar="A,B,...",
        help="only these figures, for example 4.1,5.7: no ledger and no report",
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def Execute(args: argparse.Namespace) -> int:
    """Simulates and writes what the thesis shows."""
    formats = FormatsOf(args)

    from teleop_drake.thesis.report import Reproduce, SelectFigures

    only = None
    if args.only is not None:
        only = [number.strip() for number in args.only.split(",")]
    try:
        SelectFigures(only)
    except ValueError as e:
        raise BadInput(f"--only: {e}") from None
    PrepareFolder(args.out, "report.html")

    def Report(line: str) -> None:
        if not args.quiet:
            print(line, file=sys.stderr, flush=True)

    try:
        paths = Reproduce(
            Path(args.out),
            only=only,
            formats=formats,
            progress=Report,
        )
    except RuntimeError as e:
        # Nothing here can lay out a diagram; the message says what to install.
        return Fail(FAILED, e)
    print(f"Written: {len(paths)} files in {args.out}, the last is {paths[-1].name}")
    return 0
