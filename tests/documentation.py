"""The text of the README and of the pages of the documentation."""

import os
import re
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.image import imread

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
PAGES = sorted((ROOT / "teleop_drake" / "docs").glob("*.md"))
TEXT = "\n".join(path.read_text(encoding="utf-8") for path in (README, *PAGES))


def Blocks(language: str) -> list[str]:
    """Returns the blocks of code in that language, the README's first."""
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)
    return [text for name, text in blocks if name == language]


def CountWords(text: str) -> int:
    """Returns the number of words of a page outside of tables and code.

    Code is what stands between fences or is indented by four spaces; comments do not
    count either.
    """
    text = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    prose = [line for line in text.splitlines() if not line.startswith(("|", "    "))]
    return sum(len(line.split()) for line in prose)


def CheckPicture(committed: Path, drawn: str | os.PathLike[str]) -> None:
    """Compares pixel by pixel but for the rendering of fonts, which may differ.

    Matplotlib before 3.11 has other defaults, and other places for the axes.
    """
    if tuple(map(int, matplotlib.__version__.split(".")[:2])) < (3, 11):
        pytest.skip("the committed pictures are of matplotlib 3.11")
    before = imread(committed)
    now = imread(drawn)
    assert now.shape == before.shape
    assert np.mean(np.abs(now - before)) < 0.01
