"""Colours of a page's curves, which are legible on light and on dark paper."""

# The papers: --panel of page.css, the background with the least contrast to curves.
LIGHT_PAPER = "#f5f6f8"
DARK_PAPER = "#1d2026"

# The colours of the figures on light and on dark paper: mixed with black or white where
# the contrast is less than 4.5 (WCAG 2.2, 1.4.3: text).
_ON_LIGHT_AND_DARK = (
    ("#0072B2", "#3891c3"),
    ("#b75100", "#d8680f"),
    ("#007e5c", "#009E73"),
    ("#9b5c7f", "#CC79A7"),
    ("#39779a", "#56B4E9"),
    ("#936600", "#E69F00"),
    ("#000000", "#8a8a8a"),
    ("#5A2D00", "#9f856b"),
    ("#9600F0", "#bc5cf5"),
)


def PageColor(index: int) -> str:
    """Returns the CSS colour of a controller, for light and dark paper.

    Args:
        index: The index of the controller; after the last colour the first one follows.
    """
    light, dark = _ON_LIGHT_AND_DARK[index % len(_ON_LIGHT_AND_DARK)]
    return f"light-dark({light}, {dark})"
