"""Numbers as the rows of the ledger write them."""

from collections.abc import Iterable, Sequence

import numpy as np

from teleop_drake.thesis.claims.evidence import Both

MM_S = (1e3, "mm/s")
MN = (1e3, "mN")
"""Units as PrintedNumber takes them."""


def Pair(first: float, second: float, scale: float = 1.0, unit: str = "") -> str:
    """Returns the values of direct force and of the adaptive controller.

    Args:
        first: That of direct force.
        second: That of the adaptive controller.
        scale: How many of the unit shown there are in one SI unit.
        unit: Its symbol.
    """
    return f"direct {scale * first:.4g}, adaptive {scale * second:.4g} {unit}".strip()


def Axes(values: Sequence[float]) -> str:
    """Returns one value per axis, such as "x 0.1, y 0.2"."""
    return ", ".join(f"{axis} {x:.3g}" for axis, x in zip("xyz", values, strict=False))


def Shares(values: np.ndarray, axes: str = "xy") -> str:
    """Returns one share per axis in per cent."""
    return ", ".join(f"{axis} {x:.1%}" for axis, x in zip(axes, values, strict=True))


def Seconds(time: float | None) -> str:
    """Returns a time in seconds, "never" if there is none."""
    return "never" if time is None else f"{time:.3g} s"


def Listed(values: Iterable[float]) -> str:
    """Returns numbers with commas between them."""
    return ", ".join(f"{value:.3g}" for value in values)


def BothAxes(both: Both, path: str, unit: str) -> str:
    """Returns a metric of both controllers on every axis."""
    direct, adaptive = (Axes(run[path]) for run in both)
    return f"direct {direct}; adaptive {adaptive} {unit}"


def BothSeconds(both: Both, path: str) -> str:
    """Returns a metric of both controllers that is a time or None."""
    direct, adaptive = (Seconds(run[path]) for run in both)
    return f"direct {direct}, adaptive {adaptive}"
