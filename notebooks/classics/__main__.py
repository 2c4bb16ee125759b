"""Draws the figures of the page "Classic results" into the documentation."""

import importlib
import io
import sys
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parents[2] / "teleop_drake/docs"
STUDIES = (
    "sampled_wall",
    "wave_line",
    "four_channels",
    "passive_wall",
    "proportional_damping",
    "move_and_wait",
    "felt_stiffness",
)


def PictureOf(study: str) -> Path:
    """Returns where the figure of a study is."""
    return DOCS / f"classics_{study}.png"


def Render(study: str) -> Image.Image:
    """Returns the figure of a study in few colours, which makes the file small."""
    figure = importlib.import_module(f"classics.{study}").Draw()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return Image.open(buffer).convert("RGB").quantize(64)


def main(studies: list[str]) -> None:
    """Draws some studies, or all."""
    for study in studies or STUDIES:
        Render(study).save(PictureOf(study), optimize=True)
        print(f"Written: {PictureOf(study)}")


if __name__ == "__main__":
    main(sys.argv[1:])
