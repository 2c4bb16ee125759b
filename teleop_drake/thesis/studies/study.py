"""What a study says."""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure


@dataclass(kw_only=True)
class Study:
    """What a study says.

    Attributes:
        title: A few words.
        text: Paragraphs, an empty line between two of them.
        figures: Figures by a name that can be part of a file name.
        table: The headers and the rows, all text.
    """

    title: str
    text: str
    figures: dict[str, Figure]
    table: tuple[Sequence[str], Sequence[Sequence[str]]]
