"""The machine code of the last programs, so that a further run need not trace again.

A program is known by its structure and by the functions of this package that it calls.
Neither holds a system of Drake's, nor anything of a user's code.
"""

from collections import deque
from collections.abc import Callable
from types import FunctionType
from typing import Any, NamedTuple

from teleop_drake.loops.engine.expression_tape import Tape
from teleop_drake.loops.engine.program import Program

# Programs of a session of work; comparing with each takes microseconds.
_NUM_KEPT = 16


class _Known(NamedTuple):
    """A program without its systems and numbers, and its machine code."""

    laws: list[Any]
    structure: list[Any]
    function: Callable[..., Any]


_KNOWN: deque[_Known] = deque(maxlen=_NUM_KEPT)


def KnownFunction(program: Program) -> Callable[..., Any] | None:
    """Returns the machine code of a program, if it has been compiled before."""
    laws = program.laws
    structure = program.structure
    for known in list(_KNOWN):
        if known.laws == laws and known.structure == structure:
            return known.function
    return None


def Remember(program: Program, function: Callable[..., Any]) -> None:
    """Keeps the machine code of a program that calls functions of this package only."""
    laws = program.laws
    if all(map(IsOfPackage, laws)):
        _KNOWN.appendleft(_Known(laws, program.structure, function))


def IsOfPackage(law: Any) -> bool:
    """Returns whether a law is a function of this package that holds no values."""
    if isinstance(law, Tape):
        return True
    is_function = isinstance(law, FunctionType) and law.__closure__ is None
    return is_function and law.__module__.partition(".")[0] == "teleop_drake"


def ForgetPrograms() -> None:
    """Removes all programs."""
    _KNOWN.clear()
