"""The reader of terms from which Drake's callbacks and compiled programs are made."""

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from teleop_drake.kernel.kernel import Kernel, Law, Name, Part, Term

T = TypeVar("T")

WORDS = ("time", "state", "mode")
"""The names that a term of any kernel may use."""


class TermReader(Generic[T]):
    """Translates terms; a subclass has a method for each kind of part of a term.

    Attributes:
        names: All names that were read.
        Number: Translates an integer.
        Joined: Translates vectors one after another.
        Part: Translates some elements of a vector.
        Call: Translates the call of a function.
        Word: Translates the time, the state or the mode.
        Parameter: Translates a parameter.
        Rate: Translates the rate of the state.
        Port: Translates an input port or another output; raises an error if there is
            none of that name.

    Args:
        kernel: The kernel to which the terms belong.
    """

    Number: Callable[[int], T]
    Joined: Callable[[list[T]], T]
    Part: Callable[[T, Part], T]
    Call: Callable[[Law, Sequence[Name | int]], T]
    Word: Callable[[str], T]
    Parameter: Callable[[str, Any], T]
    Rate: Callable[[Term], T]
    Port: Callable[[str], T]

    def __init__(self, kernel: Kernel):
        self.kernel = kernel
        self.names: set[str] = set()

    def Read(self, term: Term | int) -> T:
        """Returns the translation of a term."""
        if isinstance(term, str):
            return self._Named(term)
        if isinstance(term, int):
            return self.Number(term)
        if isinstance(term, list):
            return self.Joined([self.Read(name) for name in term])
        first, *others = term
        if callable(first):
            return self.Call(first, others)  # type: ignore[arg-type]
        return self.Part(self._Named(term[0]), term)  # type: ignore[arg-type]

    def _Named(self, name: str) -> T:
        self.names.add(name)
        kernel = self.kernel
        if name in WORDS:
            return self.Word(name)
        if name in kernel.parameters:
            return self.Parameter(name, kernel.parameters[name])
        if name == "rate" and kernel.rate is not None:
            return self.Rate(kernel.rate)
        return self.Port(name)
