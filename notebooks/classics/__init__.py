"""Classic results of haptics and teleoperation, recomputed by the package.

Each file is a study: its docstring has the published statement and its source, its
functions compute the numbers of the page "Classic results", and Draw() draws its figure
there. `python -m classics` in this folder's parent draws all of them.
"""

from collections.abc import Callable
from functools import wraps

from matplotlib import rc_context

from teleop_drake.study.figures.style import FONT_SIZE, SMALL_FONT_SIZE, Figure

_STYLE = {
    "font.size": FONT_SIZE,
    "axes.titlesize": FONT_SIZE,
    "legend.fontsize": SMALL_FONT_SIZE,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
}


def InPageStyle(draw: Callable[[], Figure]) -> Callable[[], Figure]:
    """Makes a function draw with the fonts and lines of the page."""

    @wraps(draw)
    def Draw() -> Figure:
        with rc_context(_STYLE):
            return draw()

    return Draw
