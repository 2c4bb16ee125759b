"""Who takes part in the league: an entry of entries.yaml."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.scenario import AsTeleoperation, LoadScenario, Scenario

ENTRIES = Path(__file__).with_name("entries.yaml")

Gains = dict[str, float]
"""Values of the gains by their paths."""

EDGE = 0.02
"""A gain this close to an end of its range, as a share of it, is at the edge."""


class Entry(NamedTuple):
    """Who takes part.

    Attributes:
        name: The architecture's name in the table.
        settings: Fields of the scenario by their paths.
        gains: The ranges of the gains by their paths; empty: nothing is searched.
        passive: Whether it is passive by design, in words.
    """

    name: str
    settings: Mapping[str, Any]
    gains: Mapping[str, tuple[float, float]]
    passive: str

    @property
    def overrides(self) -> list[tuple[str, Any]]:
        """The settings as overrides of a scenario."""
        return list(self.settings.items())

    def GainsAt(self, place: Array) -> Gains:
        """Returns the gains at a place, 0 to 1 along each logarithmic range."""
        values = (
            low * (high / low) ** share
            for (low, high), share in zip(self.gains.values(), place, strict=True)
        )
        return {
            path: float(f"{value:.4g}")
            for path, value in zip(self.gains, values, strict=True)
        }

    def Edges(self, gains: Gains) -> str:
        """Returns the gains at an end of their range, as in `Lambda low, B high`."""
        found = []
        for path, value in gains.items():
            low, high = self.gains[path]
            share = math.log(value / low) / math.log(high / low)
            if not EDGE < share < 1 - EDGE:
                end = "low" if share < EDGE else "high"
                found.append(f"{path.rpartition('.')[2]} {end}")
        return ", ".join(found)

    def Widened(self, factor: float) -> "Entry":
        """Returns the entry with each range wider by a factor at both ends."""
        gains = {
            path: (low / factor, high * factor)
            for path, (low, high) in self.gains.items()
        }
        return self._replace(gains=gains)


def ReadEntries(file: Path = ENTRIES) -> dict[str, Entry]:
    """Reads the entries of a file by their names."""
    tree = yaml.safe_load(file.read_text(encoding="utf-8"))
    return {
        name: Entry(name, item["set"], item["gains"] or {}, str(item["passive"]))
        for name, item in tree.items()
    }


def OneAxis(entry: Entry, gains: Gains, delay: float) -> Scenario:
    """Returns one_dof with an entry, the delay in s each way."""
    values = {**entry.settings, **gains, "delay": delay}
    scenario = LoadScenario("one_dof", values)
    return AsTeleoperation(scenario)
