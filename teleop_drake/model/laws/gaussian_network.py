"""Gaussian radial basis functions on an equidistant lattice (section 3.2).

A network is y(u) = W Phi(u). The weights W are part of the law that adapts them. This
file contains only the basis functions Phi(u) and their rate of change.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckNumber, Refuse


def equidistant_lattice(
    lower: ArrayLike, upper: ArrayLike, count: Sequence[int]
) -> tuple[Array, Array]:
    """Returns equidistant centres mu_i of the basis functions (3.1), and their spacing.

    The first and the last centre of an axis lie on its bounds. With count 1 the only
    centre is in the middle, and the spacing is the whole length, as with count 2, so
    that one function covers the interval.

    Args:
        lower: Lower bounds (m), in the unit of the network's input.
        upper: Upper bounds (m), greater than `lower` on every axis.
        count: Number of centres per axis (m), each >= 1.

    Returns:
        The centres (N, m), where N is the product of `count` and the last axis varies
        fastest, and the distance between neighbouring centres on each axis (m).
    """
    low, high = (np.array(x, dtype=float, ndmin=1) for x in (lower, upper))
    if low.ndim != 1 or low.size == 0 or low.shape != high.shape:
        Refuse("lower, upper", [lower, upper], "vectors of one size")
    if not (np.isfinite([low, high]).all() and (low < high).all()):
        allowed = "finite, lower less than upper on every axis"
        Refuse("lower, upper", np.array([low, high]), allowed)
    counts = np.array(count, dtype=int)
    if counts.shape != low.shape or (counts != count).any() or (counts < 1).any():
        Refuse("count", count, f"{low.size} whole numbers >= 1, one for each axis")
    axes = [
        np.linspace(a, b, c) if c > 1 else np.array([(a + b) / 2])
        for a, b, c in zip(low, high, counts, strict=True)
    ]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    spacing: Array = (high - low) / np.maximum(counts - 1, 1)
    return centres.reshape(-1, low.size), spacing


def gaussian_functions(
    u: Array, u_dot: Array, centres: Array, widths: Array
) -> tuple[Array, Array]:
    """Returns Phi(u) of (3.1) and dPhi/dt = dPhi/du u_dot, both (N).

    Args:
        u: Input (m).
        u_dot: Time rate of u (m), in the unit of u per s.
        centres: The centres mu_i (N, m).
        widths: The square roots of R's diagonal (m).
    """
    offset = (u - centres) / widths
    Phi = np.exp(-(offset * offset).sum(axis=1))
    return Phi, Phi * (offset @ (u_dot / widths)) * -2.0


def basis_functions(u: Array, centres: Array, widths: Array) -> Array:
    """Returns Phi(u) of (3.1) (N); the arguments are those of gaussian_functions()."""
    return gaussian_functions(u, np.zeros(u.size), centres, widths)[0]


class Lattice(NamedTuple):
    """The basis functions of a network for compiled code.

    Attributes:
        centres: The centres mu_i (N, m).
        widths: The square roots of R's diagonal (m).
    """

    centres: Array
    widths: Array


class GaussianNetwork:
    """The basis functions of one network: Phi of (3.1) and its rate of change.

        phi_i(u) = exp(-(u - mu_i)^T R^-1 (u - mu_i)),   i = 1 .. N           (3.1)

    with the centres mu_i on an equidistant lattice and R = diag(widths^2). The exponent
    has no factor 1/2: at a distance of one width from its centre a function is 1/e. The
    thesis states neither the bounds nor the width; the user chooses both.

    Attributes:
        centres: The centres mu_i (N, m), read-only.
        widths: The square roots of R's diagonal (m), read-only.

    Args:
        lower: Lower bounds of the lattice (m), in the unit of the input u.
        upper: Upper bounds of the lattice (m).
        count: Number of centres per axis (m).
        width: Width of the functions in units of the lattice spacing, > 0.
    """

    def __init__(
        self,
        *,
        lower: ArrayLike,
        upper: ArrayLike,
        count: Sequence[int],
        width: float,
    ):
        CheckNumber("width", width, above=0)
        self.centres, spacing = equidistant_lattice(lower, upper, count)
        self.widths: Array = width * spacing
        self.centres.setflags(write=False)
        self.widths.setflags(write=False)

    def as_numbers(self) -> Lattice:
        """Returns the basis functions as a named tuple for compiled code."""
        return Lattice(self.centres, self.widths)

    @property
    def num_inputs(self) -> int:
        """Size m of the input u."""
        return int(self.centres.shape[1])

    @property
    def num_functions(self) -> int:
        """Number N of basis functions."""
        return len(self.centres)

    def evaluate(self, u: Array) -> Array:
        """Returns Phi(u) (N), each in (0, 1]."""
        return basis_functions(u, self.centres, self.widths)
