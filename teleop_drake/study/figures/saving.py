"""Writes figures to reproducible files that carry a description in words."""

import re
from collections.abc import Iterable
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from teleop_drake.loops.framework.files import Replacing
from teleop_drake.loops.framework.validation import CheckKind, Refuse

# For each suffix: the metadata entry of the description, and the entries that would
# differ from file to file.
_METADATA: dict[str, tuple[str, tuple[str, ...]]] = {
    ".png": ("Description", ("Software",)),
    ".svg": ("Title", ("Date", "Creator")),
    ".pdf": ("Subject", ("CreationDate", "Creator", "Producer")),
}


def SaveFigure(figure: Figure, *paths: str | Path) -> None:
    """Writes a figure; the same figure gives the same bytes.

    A file appears complete or not at all.

    It carries the description of DescribeFigure(): in a .png as the text
    `Description`, in an .svg as its title, in a .pdf as its subject.

    Args:
        paths: The files; the suffix, .png, .svg or .pdf, sets the format.

    Raises:
        OSError: If a file cannot be written.
        ValueError: If a suffix is none of these.
    """
    CheckKind("figure", figure, Figure, "a Figure, as PlotRun(recording) returns")
    for path in map(Path, paths):
        suffix = path.suffix.lower()
        if suffix not in _METADATA:
            Refuse("path", str(path), "*.png, *.svg or *.pdf")
        place, changing = _METADATA[suffix]
        metadata = {**dict.fromkeys(changing), place: DescribeFigure(figure)}
        with (
            Replacing(path) as temporary,
            rc_context({"svg.hashsalt": "teleop-drake", "pdf.fonttype": 42}),
        ):
            figure.savefig(temporary, format=suffix[1:], dpi=200, metadata=metadata)


def DescribeFigure(figure: Figure) -> str:
    """Returns a description of a figure for people who cannot see it.

    It lists the axes and titles of the panels, and the entries of the legends.
    """
    axes = [ax for ax in figure.axes if ax.get_visible()]
    shown = _Different(ax.get_ylabel() for ax in axes)
    titles = _Different(ax.get_title() for ax in axes)
    against = _Different(ax.get_xlabel() for ax in axes)
    text = f"{len(axes)} panels" if len(axes) > 1 else "One panel"
    if shown or titles:
        text += f": {'; '.join(shown or titles)}"
    if shown and titles:
        text += f"; of {', '.join(titles)}"
    if against:
        text += f"; against {' and '.join(against)}"
    legends = figure.findobj(Legend)
    names = _Different(name.get_text() for box in legends for name in box.get_texts())
    if names:
        text += f". Legend: {', '.join(names)}"
    return re.sub(r"[${}\\]", "", f"{text}.")  # The formula $F_{e,x}$ becomes F_e,x.


def _Different(texts: Iterable[str]) -> list[str]:
    """Returns the different texts that are not empty, each without line breaks."""
    return [text for text in dict.fromkeys(" ".join(x.split()) for x in texts) if text]
