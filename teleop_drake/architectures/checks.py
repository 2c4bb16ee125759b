"""Checks that several architectures share."""

import numpy as np
from numpy.typing import ArrayLike


def check_gain(
    name: str, gain: ArrayLike, size: int, *, is_definite: bool = False
) -> np.ndarray:
    """Returns a gain as an array; raises ValueError on one that is not allowed.

    Args:
        name: What to call it.
        gain: (n, n), symmetric and not negative.
        size: n.
        is_definite: Whether it must be positive definite.
    """
    matrix = np.array(gain, dtype=float)
    kind = "definite" if is_definite else "semidefinite"
    is_allowed = matrix.shape == (size, size) and bool(np.all(np.isfinite(matrix)))
    if is_allowed:
        smallest = np.linalg.eigvalsh(matrix)[0]
        is_allowed = bool(smallest > 0 if is_definite else smallest >= 0)
        is_allowed &= bool(np.allclose(matrix, matrix.T, rtol=1e-9, atol=1e-12))
    if not is_allowed:
        raise ValueError(
            f"{name}: {matrix.tolist()}; allowed: a symmetric positive {kind} "
            f"{size} x {size} matrix"
        )
    return matrix


def check_wave_path(
    scaling: float, bandwidth: float | None
) -> tuple[float, float | None]:
    """Raises ValueError on what no arriving wave can go through; returns both.

    Args:
        scaling: Factor, 0 < f <= 1.
        bandwidth: Corner of the low-pass in rad/s, > 0, or None.
    """
    if not 0 < scaling <= 1:
        raise ValueError(f"scaling: {scaling}; allowed: > 0 and <= 1")
    if bandwidth is not None and not 0 < bandwidth < np.inf:
        raise ValueError(f"bandwidth: {bandwidth}; allowed: None or > 0 (rad/s)")
    return scaling, bandwidth


def check_four_channel(acceleration_bandwidth: float | None, **factors: float) -> None:
    """Raises ValueError on parameters that neither end can have.

    Args:
        acceleration_bandwidth: None, or rad/s, > 0.
        **factors: Finite numbers.
    """
    for name, value in factors.items():
        if not np.isfinite(value):
            raise ValueError(f"{name}: {value}; allowed: a finite number")
    if acceleration_bandwidth is not None and not 0 < acceleration_bandwidth < np.inf:
        raise ValueError(
            f"acceleration_bandwidth: {acceleration_bandwidth}; allowed: None or a "
            "finite number > 0 (rad/s)"
        )


def check_passivity(num_axes: int, **values: float) -> None:
    """Raises ValueError on parameters that neither end can have.

    Args:
        num_axes: >= 1.
        **values: Finite numbers > 0.
    """
    if num_axes < 1:
        raise ValueError(f"num_axes must be >= 1, got {num_axes}")
    for name, value in values.items():
        if not 0 < value < np.inf:
            raise ValueError(f"{name}: {value}; allowed: a finite number > 0")
