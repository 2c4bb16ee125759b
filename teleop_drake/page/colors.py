"""Colours of a page's curves, which are legible on light and on dark paper."""

from typing import Any

import numpy as np
from matplotlib.colors import to_hex, to_rgb

from teleop_drake.figures.style import COLORS

# The papers: --panel of page.css, on which curves have the least contrast.
LIGHT_PAPER = "#f5f6f8"
DARK_PAPER = "#1d2026"

CONTRAST = 4.5
"""Least contrast of a colour with its paper (WCAG 2.2, 1.4.3: text)."""


def PageColor(index: int) -> str:
    """Returns the colour of a controller as CSS has it, for light and dark paper.

    Args:
        index: Of the controller; after the last colour they begin anew.
    """
    color = COLORS[index % len(COLORS)]
    on_light = _Towards(color, "#000000", LIGHT_PAPER)
    on_dark = _Towards(color, "#ffffff", DARK_PAPER)
    return f"light-dark({on_light}, {on_dark})"


def Contrast(one: str, other: str) -> float:
    """Returns the contrast of two colours as WCAG 2.2 defines it, from 1 to 21."""
    low, high = sorted((_Luminance(one), _Luminance(other)))
    return (high + 0.05) / (low + 0.05)


def _Towards(color: str, end: str, paper: str) -> str:
    """Returns a colour, mixed with another until it has the contrast with paper."""
    begin: Any = np.array(to_rgb(color))
    change = to_rgb(end) - begin
    mixed = color
    share = 0.0
    while Contrast(mixed, paper) < CONTRAST:
        share += 0.02
        mixed = to_hex(begin + share * change)
    return mixed


def _Luminance(color: str) -> float:
    x = np.array(to_rgb(color))
    linear = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])
