"""Exit codes of the command."""

import sys

DONE = 0
"""The command succeeded."""

FAILED = 1
"""A simulation, a figure or a file failed, or a check found a difference."""

BAD_INPUT = 2
"""The input is invalid; a line on stderr has the field, value and allowed values."""

INTERRUPTED = 130
"""Ctrl-C ended the command; the results obtained until then are written."""


class BadInput(Exception):
    """Invalid input; the message is the one line that the user sees."""


class Failed(Exception):
    """The failure of a valid request; the message gives the reason."""


class Interrupted(Exception):
    """The end of a command by Ctrl-C; the message states which results remain."""


def Fail(exit_code: int, message: object) -> int:
    """Prints an error as one line on stderr and returns the exit code."""
    line = " ".join(str(message).split())
    print(f"teleop-drake: error: {line}", file=sys.stderr)
    return exit_code


def IsInterrupted(error: BaseException) -> bool:
    """Returns whether an error was caused by Ctrl-C.

    Ctrl-C raises a KeyboardInterrupt. In compiled code this becomes a SystemError, and
    an ImportError while compiled code is imported.

    Args:
        error: The error; its chain of causes and contexts is searched too.
    """
    chain: BaseException | None = error
    while chain is not None:
        if isinstance(chain, KeyboardInterrupt):
            return True
        chain = chain.__cause__ or chain.__context__
    return False
