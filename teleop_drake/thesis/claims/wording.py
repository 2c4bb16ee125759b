"""Numbers as the rows of the ledger write them."""

from collections.abc import Sequence

import numpy as np

from teleop_drake.thesis.claims.evidence import Run


def Pair(first: float, second: float, scale: float = 1.0, unit: str = "") -> str:
    """Returns the values of direct force and of the adaptive controller."""
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


def BothAxes(direct: Run, adaptive: Run, name: str, unit: str) -> str:
    """Returns a metric of both controllers on every axis."""
    return (
        f"direct {Axes(direct.metrics[name])}; "
        f"adaptive {Axes(adaptive.metrics[name])} {unit}"
    )
