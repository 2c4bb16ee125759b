"""The command `teleop-drake reproduce`."""

import argparse
from functools import partial
from pathlib import Path

from teleop_drake.cli.exit_codes import DONE, FAILED, BadInput, Fail
from teleop_drake.cli.options import NAMES, AddFormatOption, FormatsOf
from teleop_drake.cli.output import PrepareFolder
from teleop_drake.cli.progress import TellLine
from teleop_drake.cli.tables import Align


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
        **NAMES,
        help="only these figures, for example 4.1,5.7: no ledger and no report; with "
        "--check only these claims, for example 4-settling",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="measure each claim again and compare it with the published ledger; exit "
        "code 1 where one differs",
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def Execute(args: argparse.Namespace) -> int:
    """Repeats the simulations of the thesis; writes figures, ledger and report."""
    formats = FormatsOf(args)
    if args.check:
        return _Check(args.only, args.quiet)

    from teleop_drake.thesis.report import Reproduce, SelectFigures

    try:
        SelectFigures(args.only)
    except ValueError as e:
        raise BadInput(f"--only: {e}") from None
    PrepareFolder(args.out, "report.html")

    try:
        paths = Reproduce(
            Path(args.out),
            only=args.only,
            formats=formats,
            progress=partial(TellLine, args.quiet),
        )
    except RuntimeError as e:
        # The diagram cannot be laid out; the message names the remedy.
        return Fail(FAILED, e)
    print(f"Written: {len(paths)} files in {args.out}, the last is {paths[-1].name}")
    return 0


def _Check(only: list[str] | None, is_quiet: bool) -> int:
    """Checks claims, prints a row for each and returns the exit code."""
    from teleop_drake.thesis.check import TOLERANCE, CheckClaims

    lines = [["claim", "expected", "tolerance", "found", "command", "seconds", ""]]
    num_failed = 0
    for claim in CheckClaims(only):
        num_failed += not claim.passes
        command = f"teleop-drake reproduce --check --only {claim.key}"
        verdict = "ok" if claim.passes else "DIFFERS"
        row = [claim.key, claim.expected, f"{TOLERANCE:.0%}", claim.found, command]
        lines.append([*row, f"{claim.seconds:.1f}", verdict])
        TellLine(is_quiet, f"{claim.key}: {verdict}")
    print(Align(lines))
    print(f"{len(lines) - 1} claims, of which {num_failed} differ")
    return FAILED if num_failed else DONE
