"""Colours of a page's curves, which are legible on light and on dark paper."""

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
    mixed, share = color, 0.0
    while Contrast(mixed, paper) < CONTRAST:
        share += 0.02
        pairs = zip(_Channels(color), _Channels(end), strict=True)
        channels = [round((1 - share) * a + share * b) for a, b in pairs]
        mixed = "#" + "".join(f"{channel:02x}" for channel in channels)
    return mixed


def _Luminance(color: str) -> float:
    linear = []
    for channel in _Channels(color):
        x = channel / 255
        linear.append(x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4)
    red, green, blue = linear
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _Channels(color: str) -> list[int]:
    """Returns red, green and blue of `#rrggbb`, from 0 to 255."""
    return [int(color[i : i + 2], 16) for i in (1, 3, 5)]
