"""The command `teleop-drake`.

Each command is a file of commands/, imported when it is called, with its options and
what it does. Drake, numpy and matplotlib are imported by the commands that need them:
help and bad options cost no second.
"""

import argparse
import atexit
import gc
import importlib
import io
import os
import re
import sys
import typing
from collections.abc import Sequence
from typing import Any

from teleop_drake.cli.exit_codes import (
    BAD_INPUT,
    FAILED,
    INTERRUPTED,
    BadInput,
    Fail,
    Failed,
    Interrupted,
    IsInterrupted,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command `teleop-drake` and returns its exit code.

    Args:
        argv: The arguments after the command's name; None: those of the process.
    """
    # Matrices are small here: BLAS's threads would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _CollectLessGarbage()
    _ReplaceWhatCannotBeWritten()
    try:
        parser = MakeParser()
        if "_ARGCOMPLETE" in os.environ:  # A shell asks at the tab key.
            from teleop_drake.cli.commands.completion import Complete

            Complete(parser)
        args = parser.parse_args(argv)
        # So that a scenario can name kinds in modules of the folder one works in.
        if args.command_name not in _WITHOUT_OWN_KINDS and os.getcwd() not in sys.path:
            sys.path.append(os.getcwd())
        exit_code: int = args.command(args)
        sys.stdout.flush()
        return exit_code
    except (Exception, KeyboardInterrupt) as e:  # noqa: BLE001
        return _ExitCodeOf(e)


def _CollectLessGarbage() -> None:
    """Spares an eighth of a short command's time.

    Imports make many objects that stay, and at exit all memory is returned at once.
    """
    gc.set_threshold(5000)
    atexit.register(gc.freeze)


def _ReplaceWhatCannotBeWritten() -> None:
    """Makes stdout replace letters that its encoding lacks, such as the sign ±."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def _ExitCodeOf(error: BaseException) -> int:
    """Returns the exit code after an error, printed on a line; raises what is none."""
    if isinstance(error, Interrupted):
        return Fail(INTERRUPTED, error)
    if IsInterrupted(error):
        return Fail(INTERRUPTED, "interrupted")
    # SciPy's and NumPy's errors are of numbers that no check has foreseen.
    if isinstance(error, BadInput | ValueError):
        return Fail(BAD_INPUT, error)
    if isinstance(error, BrokenPipeError):
        # The reader, `head` perhaps, has seen enough. Python would complain when it
        # flushes stdout at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    # The disk is full, say: all else was checked beforehand.
    if isinstance(error, OSError | Failed):
        return Fail(FAILED, error)
    raise error


# What argparse says of an option whose value is none of its choices.
_INVALID_CHOICE = re.compile(
    r"argument (.+): invalid choice: '?(.*?)'? \(choose from (.*)\)$"
)


class _Parser(argparse.ArgumentParser):
    """Reports a bad option on one line, without the usage."""

    def error(self, message: str) -> typing.NoReturn:
        choice = _INVALID_CHOICE.match(message)
        if choice is None:
            raise BadInput(f"{message}; `{self.prog} --help` has the options")
        from teleop_drake.validation import Choices  # It imports numpy.

        name, value, choices = choice.groups()
        allowed = Choices(value, re.findall(r"[\w.-]+", choices))
        raise BadInput(f"{name} = {value!r}: must be {allowed}")


_COMMANDS = {
    "list": "List the built-in scenarios, the controllers and the robots.",
    "show": "Print the resolved scenario as YAML.",
    "run": "Simulate a scenario and print its metrics.",
    "compare": "Compare controllers: a table and a figure.",
    "sweep": "Simulate a scenario, or a study's several, for many delays, controllers "
    "and other values.",
    "tune": "Search for gains of a controller: the best, or a Pareto front.",
    "analyze": "Find the delays at which the loop is stable, and why it fails at "
    "others.",
    "replay": "Show a run, or several, in 3-D: opens a page, or writes it.",
    "drive": "Drive a scenario with your own hand, in real time: opens a page.",
    "diagram": "Draw the block diagram of a scenario.",
    "page": "Write the block diagram as a page in which it simulates.",
    "serve": "Serve as the robot's side of a loop over a real network.",
    "operate": "Operate a robot over a real network: measure, record, predict.",
    "reproduce": "Simulate the thesis again: its figures, a ledger of its claims, a "
    "report.",
    "check": "Compare a run of anybody's, in a file, with the published reference run "
    "of its name.",
    "completion": "Let the tab key of a shell complete commands and scenarios.",
    "docs": "Say where the documentation is, or write it as HTML.",
}

# Commands that another one's file has.
_FILES = {"drive": "page", "operate": "serve"}

# Commands that run nothing of a scenario.
_WITHOUT_OWN_KINDS = ("list", "show", "check", "completion", "docs")


class _ShowVersion(argparse.Action):
    """Prints the versions of this package and of what its numbers depend on."""

    def __call__(self, parser: argparse.ArgumentParser, *args: Any) -> None:
        from importlib import metadata

        from teleop_drake import __version__

        others = [f"{name} {metadata.version(name)}" for name in ("drake", "numpy")]
        others.append(f"Python {sys.version.split()[0]}")
        print(f"teleop-drake {__version__} ({', '.join(others)})")
        parser.exit()


class _CommandParser(_Parser):
    """Imports the file of its command when the command is called.

    That file has AddOptions(parser) and Execute(args), which returns the exit code.
    """

    def AddOptionsOfCommand(self) -> None:
        """Adds the options of the command, if it does not have them yet."""
        if self.get_default("command") is None:
            name = self.prog.split()[-1]
            file = _FILES.get(name, name)
            command = importlib.import_module(f"teleop_drake.cli.commands.{file}")
            command.AddOptions(self)
            self.set_defaults(command=command.Execute)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        self.AddOptionsOfCommand()
        return super().parse_known_args(args, namespace)


def MakeParser() -> argparse.ArgumentParser:
    """Returns the parser of the whole command line.

    Its result has `command`, which takes the result and returns the exit code.
    """
    parser = _Parser(
        prog="teleop-drake",
        description="Haptic teleoperation under communication delay.",
        epilog="`teleop-drake COMMAND --help` has the options of a command.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version", action=_ShowVersion, nargs=0, help="print the versions and exit"
    )
    commands = parser.add_subparsers(
        title="commands",
        metavar="COMMAND",
        required=True,
        dest="command_name",
        parser_class=_CommandParser,
    )
    for name, summary in _COMMANDS.items():
        commands.add_parser(name, help=summary, description=summary, allow_abbrev=False)
    return parser
