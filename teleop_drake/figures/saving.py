"""Figures as files: reproducible, complete or not at all, and described in words."""

import re
from collections.abc import Iterable
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from teleop_drake.files import Replacing
from teleop_drake.validation import Refuse

# For each suffix: where the description stands, and metadata that would change with
# each file.
_METADATA: dict[str, tuple[str, tuple[str, ...]]] = {
    ".png": ("Description", ("Software",)),
    ".svg": ("Title", ("Date", "Creator")),
    ".pdf": ("Subject", ("CreationDate", "Creator", "Producer")),
}


def SaveFigure(figure: Figure, *paths: str | Path) -> None:
    """Writes a figure; the same figure gives the same bytes.

    A file appears complete or not at all.

    It carries a description in words, what DescribeFigure() returns: in a .png as the
    text `Description`, in an .svg as its title, in a .pdf as its subject.

    Args:
        paths: Where to; the suffix, .png, .svg or .pdf, decides the format.

    Raises:
        OSError: If a file cannot be written.
        ValueError: If a suffix is none of these.
    """
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
    """Returns what a figure shows, in words: for those who do not see it.

    It says what the panels show against what, and the names of the lines.
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
    return re.sub(r"[${}\\]", "", f"{text}.")  # Of a formula: $F_{e,x}$ is F_e,x.


def _Different(texts: Iterable[str]) -> list[str]:
    """Returns texts on a line each, every one once and none that is empty."""
    return [text for text in dict.fromkeys(" ".join(x.split()) for x in texts) if text]
