"""What every benchmark is told."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Options:
    """How thorough a benchmark is.

    Attributes:
        quick: Whether to measure once and little, to see that everything works.
        peers: Whether to run JiTCDDE, too, which has to be installed.
    """

    quick: bool = False
    peers: bool = False

    @property
    def repeats(self) -> int:
        """How often each contender runs."""
        return 1 if self.quick else 3

    def Duration(self, scenario) -> float:
        """Returns how much of a scenario to simulate, in s."""
        return 0.5 if self.quick else scenario.duration
