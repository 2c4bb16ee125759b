"""Exit codes of the command."""

import sys

DONE = 0
"""What was asked for is done."""

FAILED = 1
"""It could not be simulated, drawn or written."""

BAD_INPUT = 2
"""One line on stderr names the field, the value and what is allowed."""

INTERRUPTED = 130
"""Ctrl-C; what there was by then is written."""


class BadInput(Exception):
    """Its text is the one line that the user gets to see."""


class Failed(Exception):
    """Its text says why something failed that was asked for correctly."""


class Interrupted(Exception):
    """Its text says what there is of what Ctrl-C has ended."""


def Fail(exit_code: int, message: object) -> int:
    """Prints an error as one line on stderr and returns the exit code."""
    line = " ".join(str(message).split())
    print(f"teleop-drake: error: {line}", file=sys.stderr)
    return exit_code


def IsInterrupted(error: BaseException) -> bool:
    """Returns whether an error is what Ctrl-C became on its way.

    In machine code it becomes a SystemError, and an ImportError while that is imported.

    Args:
        error: With those that it was raised from, or while handling them.
    """
    chain: BaseException | None = error
    while chain is not None:
        if isinstance(chain, KeyboardInterrupt):
            return True
        chain = chain.__cause__ or chain.__context__
    return False
