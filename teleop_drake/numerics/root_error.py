"""How well the roots of a matrix are known that is itself known only so well.

Let every entry of A be known to within E >= 0. A number z can be an eigenvalue of a
matrix within these bounds only if

    spectral radius of |(z I - A)^-1| E  >=  1,                                  (1)

because with less, I - (z I - A)^-1 dA is invertible for every |dA| <= E. (1) does not
depend on the units of the states, and it holds for defective eigenvalues: a k-fold
root that is known to within eps relative is found to be one within eps^(1/k).

A model that belongs to an instant has a second error. It changes at a known rate A',
and while a mode of z turns by a radian, 1/|z|, by A'/|z|. On the way z becomes an
eigenvalue, of A + h A'/|z| with a number |h| <= 1, only if

    spectral radius of (z I - A)^-1 A'  >=  |z|.                                 (2)

Source: N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM
(2002), chapter 7; L. N. Trefethen and M. Embree, "Spectra and Pseudospectra",
Princeton (2005).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# Circles about 0 that are looked at: how many in a decade, how many decades below the
# fastest mode, and how many points on the upper half of each.
_NUM_CIRCLES = 6
_NUM_DECADES = 9
_NUM_ANGLES = 9


def unresolved_radius(A: Array, error: Array, drift: Array) -> float:
    """Returns the size below which a root is not told from one at 0, in 1/s.

    It is the radius of the smallest circle about 0 on which neither (1) nor (2) holds
    anywhere, so that no root within the error can cross it. 0 if that is the first
    circle that is looked at.

    Args:
        A: (n, n), in 1/s.
        error: E, >= 0 (n, n).
        drift: A', per s (n, n).
    """
    modes = np.linalg.eigvals(A).astype(complex)
    fastest = float(np.abs(modes).max(initial=0.0))
    if fastest == 0:
        return 0.0
    exponents = np.linspace(-_NUM_DECADES, 0, _NUM_DECADES * _NUM_CIRCLES + 1)
    # The directions of the modes, too: none slips through between two points.
    angles = np.linspace(0, np.pi, _NUM_ANGLES)
    angles = np.concatenate([angles, np.abs(np.angle(modes))])
    for k, radius in enumerate(fastest * 10**exponents):
        if not _has_root_near(A, error, drift, radius * np.exp(1j * angles)):
            return float(radius) if k else 0.0
    return fastest


def root_error(
    matrix: ComplexArray, slope: ComplexArray, error: Array, drift: ComplexArray
) -> float:
    """Returns by how much a root s of det F(s) = 0 may be off, to first order, in 1/s.

    It is infinite for a root that is not simple.

    Args:
        matrix: F(s) (n, n).
        slope: dF/ds (n, n).
        error: Error of each entry of F, >= 0 (n, n).
        drift: By how much F changes while the mode turns by a radian (n, n).

    Returns:
        The bound.
    """
    U, _, Vh = np.linalg.svd(matrix)
    left, right = U[:, -1].conj(), Vh[-1].conj()
    gain = abs(left @ slope @ right)
    s_drift = abs(left @ drift @ right)
    s_error = float(np.abs(left) @ error @ np.abs(right))
    return (s_error + s_drift) / gain if gain > 0 else np.inf


def _has_root_near(A: Array, error: Array, drift: Array, z: ComplexArray) -> bool:
    """Returns whether (1) or (2) holds at one of the points z."""
    matrices = z[:, None, None] * np.eye(len(A)) - A
    try:
        resolvents = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:  # A root to the last digit.
        return True
    within = np.abs(np.linalg.eigvals(np.abs(resolvents) @ error)).max(axis=1)
    moved = np.abs(np.linalg.eigvals(resolvents @ drift)).max(axis=1) / np.abs(z)
    return bool(np.any(within >= 1) or np.any(moved >= 1))
