"""What every benchmark is told."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Options:
    """How thorough a benchmark is.

    Attributes:
        quick: Whether to measure once and little, to see that everything works.
        peers: Whether to run other simulators too, as far as they are installed.
        out: Folder for figures; None draws none.
    """

    quick: bool = False
    peers: bool = False
    out: Path | None = None

    @property
    def repeats(self) -> int:
        """How often each contender runs."""
        return 1 if self.quick else 3

    def Duration(self, scenario) -> float:
        """Returns how much of a scenario to simulate, in s."""
        return 0.5 if self.quick else scenario.duration
