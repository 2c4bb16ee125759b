"""The command `teleop-drake check`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli.exit_codes import DONE, FAILED
from teleop_drake.cli.progress import Notice
from teleop_drake.loops.framework.validation import CheckChoice

if TYPE_CHECKING:
    from teleop_drake.cli.reference_runs import Difference


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    choice = parser.add_mutually_exclusive_group(required=True)
    choice.add_argument(
        "file",
        nargs="?",
        metavar="FILE.csv",
        help="a run: a comment `# reference: NAME`, names of columns, numbers",
    )
    choice.add_argument(
        "--list", action="store_true", help="print the names of the references"
    )
    choice.add_argument("--show", metavar="NAME", help="describe a reference in words")
    choice.add_argument(
        "--template",
        metavar="NAME",
        help="print a file with the columns and instants of a reference, to fill in",
    )


def Execute(args: argparse.Namespace) -> int:
    """Compares a run with the reference that it names, or describes references."""
    from teleop_drake.cli import reference_runs

    names = reference_runs.Names()
    if args.list:
        for name in names:
            print(f"{name:<40} {reference_runs.Describe(name)['title']}")
        return DONE
    if args.show is not None:
        CheckChoice("--show", args.show, names)
        about = reference_runs.Describe(args.show)
        print(f"{args.show}: {about['title']}\n\n{about['task'].rstrip()}")
        return DONE
    if args.template is not None:
        CheckChoice("--template", args.template, names)
        print(reference_runs.Template(args.template))
        return DONE
    run = reference_runs.ReadTable(Path(args.file))
    if "clock" in run.notes:
        Notice(f"time: {run.notes['clock']}")
    name = run.notes.get("reference", "")
    CheckChoice(f"{args.file}: # reference", name, names)
    differences = reference_runs.Compare(name, run, args.file)
    return _Print(name, differences)


def _Print(name: str, differences: "dict[str, Difference]") -> int:
    """Prints the differences, likely faults and the verdict; returns the exit code."""
    print(f"{name}\n{'signal':<24} {'difference':>10} {'tube':>10}  share     at")
    for signal, (largest, tube, time, _) in differences.items():
        numbers = f"{largest:10.2e} {tube:10.2e} {largest / tube:6.2f}"
        print(f"{signal:<24} {numbers}  {time:.4g} s")
    for signal, difference in differences.items():
        if difference.fault:  # Only a signal outside of its tube has one.
            print(f"{signal} is {difference.fault}")
    is_inside = all(difference.is_inside for difference in differences.values())
    print("inside" if is_inside else "outside", "of the tubes")
    return DONE if is_inside else FAILED
