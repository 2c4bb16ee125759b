"""The delay maps of `teleop-drake analyze --map`: tables and pictures."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli.tables import Align

if TYPE_CHECKING:
    from pydrake.systems.framework import Diagram

    from teleop_drake.study.analysis.stability import StabilityAnalysis


@dataclass(frozen=True, eq=False)
class LabelledMap:
    """The delay map of one loop.

    Attributes:
        label: The label of the loop; see PointStability.label.
        diagram: The teleoperator.
        margins: The margins in s, as those of DelayMargins().
    """

    label: str
    diagram: "Diagram"
    margins: Mapping[str, float]

    @property
    def stem(self) -> str:
        """The label as a part of a file's name."""
        return self.label.replace(",", "").replace(" ", "_")

    def ToRecord(self) -> dict[str, float | None]:
        """Returns the margins in s for JSON, in which null means any delay."""
        return {
            wire: None if margin == math.inf else margin
            for wire, margin in self.margins.items()
        }

    def Draw(self, path: Path, formats: Sequence[str]) -> list[Path]:
        """Writes the block diagram with coloured connections; returns the files.

        Args:
            path: The files without their suffixes.
            formats: The suffixes.
        """
        from teleop_drake.loops.draw.block_diagram import WriteDiagram

        paths = [path.with_name(f"{path.name}.{suffix}") for suffix in formats]
        for file in paths:
            WriteDiagram(self.diagram, file, delay_margins=self.margins)
        return paths


def MapDelays(analysis: "StabilityAnalysis") -> list[LabelledMap]:
    """Returns the delay map of each loop of an analysis, with the tool at rest."""
    from teleop_drake.loops.linear.delay_map import DelayMargins
    from teleop_drake.study.analysis.loop import Linearizer

    linearizer = Linearizer(analysis.scenario)
    maps = []
    for loop in analysis.Loops():
        point = loop.model.point
        context = linearizer.ContextAt(replace(point, velocity=0 * point.velocity))
        # The operator's device moves, even if the tool is at rest.
        margins = DelayMargins(linearizer.diagram, context, is_moving=True)
        maps.append(LabelledMap(loop.label, linearizer.diagram, margins))
    return maps


def MapTable(maps: Sequence[LabelledMap]) -> str:
    """Returns a table of the margins of the outermost connections, in s."""
    wires = [wire for wire in maps[0].margins if "/" not in wire]
    lines = [["late connection", *(f"{x.label} [s]" for x in maps), ""]]
    for wire in sorted(wires, key=lambda wire: min(x.margins[wire] for x in maps)):
        cells = [_Cell(x.margins[wire]) for x in maps]
        lines.append([wire, *cells, ""])
    words = [
        "How much later each signal alone may come, with the tool at rest and all "
        "states of the controller free",
        Align(lines),
        "any: stable with every delay; unstable: already without one",
    ]
    return "\n".join(words)


def _Cell(margin: float) -> str:
    """Returns a margin in s as text."""
    if margin == math.inf:
        return "any"
    return f"{margin:.4g}" if margin > 0 else "unstable"
