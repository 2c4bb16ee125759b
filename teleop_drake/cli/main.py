"""The command `teleop-drake`.

Each command is a module in commands/ that defines its options and its action. Drake,
NumPy and Matplotlib take a second to import, so only the commands that need them do;
help and errors in options appear at once.
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
        argv: The arguments after `teleop-drake`; by default, those of the process.
    """
    # Matrices are small here: BLAS's threads would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _CollectLessGarbage()
    _ReplaceWhatCannotBeWritten()
    try:
        parser = MakeParser()
        if "_ARGCOMPLETE" in os.environ:  # A shell sets it at the tab key.
            from teleop_drake.cli.commands.completion import Complete

            Complete(parser)
        args = parser.parse_args(argv)
        # A scenario may name kinds that are defined in modules of the current folder.
        if args.command_name not in _WITHOUT_OWN_KINDS and os.getcwd() not in sys.path:
            sys.path.append(os.getcwd())
        exit_code: int = args.command(args)
        sys.stdout.flush()
        return exit_code
    except (Exception, KeyboardInterrupt) as e:  # noqa: BLE001
        return _ExitCodeOf(e)


def _CollectLessGarbage() -> None:
    """Collects garbage less often, which saves an eighth of a short command's time.

    Imports create many objects that live until the exit, where freezing them excludes
    them from the last collection.
    """
    gc.set_threshold(5000)
    atexit.register(gc.freeze)


def _ReplaceWhatCannotBeWritten() -> None:
    """Makes stdout replace characters that its encoding lacks, such as ±."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def _ExitCodeOf(error: BaseException) -> int:
    """Prints an error on one line and returns its exit code; re-raises bugs."""
    if isinstance(error, Interrupted):
        return Fail(INTERRUPTED, error)
    if IsInterrupted(error):
        return Fail(INTERRUPTED, "interrupted")
    # SciPy and NumPy raise a ValueError for numbers that no check has foreseen.
    if isinstance(error, BadInput | ValueError):
        return Fail(BAD_INPUT, error)
    if isinstance(error, BrokenPipeError):
        # The reader of the pipe, such as `head`, has ended. Without the redirection
        # Python would report another error when it flushes stdout at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    # For example, the disk is full. Other reasons were checked beforehand.
    if isinstance(error, OSError | Failed):
        return Fail(FAILED, error)
    raise error


# The message of argparse for a value that is not among an option's choices.
_INVALID_CHOICE = re.compile(
    r"argument (.+): invalid choice: '?(.*?)'? \(choose from (.*)\)$"
)


class _Parser(argparse.ArgumentParser):
    """A parser that reports a bad option on one line, without the usage."""

    def error(self, message: str) -> typing.NoReturn:
        choice = _INVALID_CHOICE.match(message)
        if choice is None:
            raise BadInput(f"{message}; `{self.prog} --help` has the options")
        from teleop_drake.loops.framework.validation import Choices  # It imports numpy.

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
    "check": "Compare a run in a file, of any program, with a published reference run.",
    "latency": "Estimate the delay between two recorded signals, and what a trace of "
    "delays means.",
    "completion": "Print a script with which a shell completes commands and scenarios.",
    "docs": "Print where the documentation is, or write it as HTML.",
}

# The modules of commands that share one with another command.
_FILES = {"drive": "page", "operate": "serve"}

# Commands that never run a scenario's own kinds.
_WITHOUT_OWN_KINDS = ("list", "show", "check", "latency", "completion", "docs")


class _ShowVersion(argparse.Action):
    """The action of --version; prints versions, also of Drake, NumPy and Python."""

    def __call__(self, parser: argparse.ArgumentParser, *args: Any) -> None:
        from importlib import metadata

        own, *others = [
            f"{name} {metadata.version(name)}"
            for name in ("teleop-drake", "drake", "numpy")
        ]
        others.append(f"Python {sys.version.split()[0]}")
        print(f"{own} ({', '.join(others)})")
        parser.exit()


class _CommandParser(_Parser):
    """The parser of a command, whose module is imported when the command is called.

    The module defines AddOptions(parser) and Execute(args), which returns the exit
    code.
    """

    def AddOptionsOfCommand(self) -> None:
        """Adds the options of the command unless they have been added."""
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

    The parsed arguments have a function `command`, which takes the parsed arguments
    and returns the exit code.
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
