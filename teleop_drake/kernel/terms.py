"""The one reader of terms: Drake's callbacks and compiled programs are made by it."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

from teleop_drake.kernel.kernel import Kernel, Law, Name, Part, Term

T = TypeVar("T")

WORDS = ("time", "state", "mode")
"""The names that every kernel can take."""


class TermReader(ABC, Generic[T]):
    """Reads terms; a subclass says what it makes of each part of one.

    Attributes:
        names: All that it has met.

    Args:
        kernel: Whose terms these are.
    """

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

    @abstractmethod
    def Number(self, number: int) -> T:
        """Takes an integer, which is handed over as it is."""

    @abstractmethod
    def Joined(self, parts: list[T]) -> T:
        """Takes vectors one after another."""

    @abstractmethod
    def Part(self, whole: T, part: Part) -> T:
        """Takes some elements of a vector."""

    @abstractmethod
    def Call(self, law: Law, arguments: Sequence[Name | int]) -> T:
        """Takes what a function returns."""

    @abstractmethod
    def Word(self, word: str) -> T:
        """Takes the time, the state or the mode."""

    @abstractmethod
    def Parameter(self, name: str, value: Any) -> T:
        """Takes a parameter."""

    @abstractmethod
    def Rate(self, term: Term) -> T:
        """Takes the rate of the state."""

    @abstractmethod
    def Port(self, name: str) -> T:
        """Takes an input port or another output; raises if there is none."""
