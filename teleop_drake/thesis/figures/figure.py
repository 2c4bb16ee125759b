"""A figure of the thesis, its two files, and the panels that several share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from pydrake.systems.framework import Diagram

from teleop_drake.figures.block_diagram import WriteDiagram
from teleop_drake.figures.runs import SaveFigure
from teleop_drake.figures.style import (
    BOUNDARY_STYLE,
    FONT_SIZE,
    SMALL_FONT_SIZE,
    WIDTH,
    FormatAxes,
)
from teleop_drake.recording import Recording
from teleop_drake.thesis.runs import ThesisRuns

ROW_HEIGHT = 1.9  # inches
LEGEND_HEIGHT = 0.7  # inches


@dataclass(kw_only=True)
class ThesisFigure:
    """One figure.

    Attributes:
        number: As in the thesis, for instance "4.1".
        title: What it shows, in a few words.
        caption: How to read it.
        make: Makes it: a matplotlib Figure, or the Diagram to be drawn.
    """

    number: str
    title: str
    caption: str
    make: Callable[[ThesisRuns], Figure | Diagram]

    @property
    def stem(self) -> str:
        """Name of its files without the suffix, for instance `figure_4_1`."""
        return "figure_" + self.number.replace(".", "_")


def WritePicture(
    picture: Figure | Diagram, stem: Path, formats: Sequence[str] = ("png", "svg")
) -> list[Path]:
    """Writes a figure or a block diagram in some formats.

    The same picture gives the same bytes. Each file appears complete or not at all.

    Args:
        picture: A figure, whose layout is fixed thereby, or a diagram, drawn as the
            boxes of its own parts.
        stem: The path without the suffix, in an existing folder.

    Raises:
        RuntimeError: If nothing here can lay out a block diagram.
    """
    paths = [stem.with_name(f"{stem.name}.{suffix}") for suffix in formats]
    if isinstance(picture, Figure):
        # The layout costs as much as the drawing and is the same for both.
        layout = picture.get_layout_engine()
        if layout is not None:
            layout.execute(picture)
            picture.set_layout_engine("none")
        for path in paths:
            SaveFigure(picture, path)
    else:
        for path in paths:
            WriteDiagram(picture, path, max_depth=1)
    return paths


def TimeFigure(recording: Recording, num_rows: int) -> tuple[Figure, list[Axes]]:
    """Returns empty panels against time, with first puncture and contact marked."""
    figure = Figure(
        figsize=(WIDTH, ROW_HEIGHT * num_rows + LEGEND_HEIGHT), layout="constrained"
    )
    axes = list(figure.subplots(num_rows, 1, sharex=True, squeeze=False)[:, 0])
    for ax in axes:
        FormatAxes(ax)
        ax.set_xlim(0.0, float(recording.time[-1]))
        for name in ("puncture", "contact"):
            for time in recording.EventTimes(name)[:1]:
                ax.axvline(time, **BOUNDARY_STYLE)
                if ax is axes[0]:
                    ax.annotate(
                        name,
                        (time, 1.0),
                        xycoords=("data", "axes fraction"),
                        xytext=(0, 2),
                        textcoords="offset points",
                        ha="center",
                        fontsize=SMALL_FONT_SIZE,
                    )
    axes[-1].set_xlabel("time [s]", fontsize=FONT_SIZE)
    return figure, axes


def AddLegendAbove(
    figure: Figure, handles: Sequence[Line2D], title: str | None = None
) -> None:
    """Adds a legend above all panels; the title is what its entries have in common."""
    figure.legend(
        handles=handles,
        title=title,
        title_fontsize=SMALL_FONT_SIZE,
        loc="outside upper center",
        ncols=len(handles) if len(handles) <= 5 else 4,
        fontsize=SMALL_FONT_SIZE,
        frameon=False,
    )
