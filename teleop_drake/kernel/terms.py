"""The one reader of terms: Drake's callbacks and compiled programs are made by it."""

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from teleop_drake.kernel.kernel import Kernel, Law, Name, Part, Term

T = TypeVar("T")

WORDS = ("time", "state", "mode")
"""The names that every kernel can take."""


class TermReader(Generic[T]):
    """Reads terms; a subclass has a method for each part of one, and says what it is.

    Attributes:
        names: All that it has met.
        Number: For an integer, which is handed over as it is.
        Joined: For vectors one after another.
        Part: For some elements of a vector.
        Call: For what a function returns.
        Word: For the time, the state or the mode.
        Parameter: For a parameter.
        Rate: For the rate of the state.
        Port: For an input port or another output; raises if there is none.

    Args:
        kernel: Whose terms these are.
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
        """Returns what is made of a term."""
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
