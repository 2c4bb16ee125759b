"""Linear time-invariant systems as matrices, and their minimal realisation.

dx/dt = A x + B u,    y = C x + D u,    G(s) = C (s I - A)^-1 B + D
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.arrays import Array, ComplexArray
from teleop_drake.validation import Refuse

# Directions that are reached, or seen, more weakly than this are taken to be neither,
# relative to the norm of A in balanced coordinates. Well above the error of blocks with
# differences, about 1e-10.
_TOLERANCE = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False)
class StateSpace:
    """The matrices of a linear system. They are copied and made read-only.

    Attributes:
        A: (n, n).
        B: (n, m), m inputs.
        C: (p, n), p outputs.
        D: (p, m).

    Raises:
        ValueError: If the sizes do not match or an entry is not finite.
    """

    A: Array
    B: Array
    C: Array
    D: Array

    def __post_init__(self) -> None:
        for name in ("A", "B", "C", "D"):
            matrix = np.array(getattr(self, name), dtype=float)
            if matrix.ndim != 2 or not np.isfinite(matrix).all():
                Refuse(name, matrix, "a finite matrix")
            matrix.setflags(write=False)
            object.__setattr__(self, name, matrix)
        n = len(self.A)
        p, m = self.D.shape
        for name, shape in (("A", (n, n)), ("B", (n, m)), ("C", (p, n))):
            if getattr(self, name).shape != shape:
                Refuse(f"shape of {name}", getattr(self, name).shape, str(shape))

    @property
    def num_states(self) -> int:
        """Number n of states."""
        return len(self.A)

    def frequency_response(self, frequencies: ArrayLike) -> ComplexArray:
        """Returns G(j w) (K, p, m).

        Args:
            frequencies: w in rad/s (K).
        """
        w = np.asarray(frequencies, dtype=float).reshape(-1)
        # (K, n, n) and (K, n, m), a matrix for each frequency.
        s = 1j * w[:, np.newaxis, np.newaxis]
        resolvent = s * np.eye(self.num_states) - self.A
        B = np.broadcast_to(self.B.astype(complex), (len(w), *self.B.shape))
        response = self.C @ np.linalg.solve(resolvent, B) + self.D
        return response.astype(complex)

    def part(
        self, states: ArrayLike, inputs: ArrayLike, outputs: ArrayLike
    ) -> "StateSpace":
        """Returns the system of some states, inputs and outputs, by their indices."""
        x = np.asarray(states, dtype=int)
        u = np.asarray(inputs, dtype=int)
        y = np.asarray(outputs, dtype=int)
        return StateSpace(
            A=self.A[np.ix_(x, x)],
            B=self.B[np.ix_(x, u)],
            C=self.C[np.ix_(y, x)],
            D=self.D[np.ix_(y, u)],
        )

    def closed(self, signals: ArrayLike) -> "StateSpace":
        """Returns the system with some outputs fed to the inputs of the same indices.

        They are no inputs and outputs any more.
        """
        i = np.asarray(signals, dtype=int)
        inputs = np.delete(np.arange(self.D.shape[1]), i)
        outputs = np.delete(np.arange(len(self.D)), i)
        # The closed signals z = C_i x + D_iu u + D_ii z, solved for z.
        loop = np.linalg.inv(np.eye(len(i)) - self.D[np.ix_(i, i)])
        z_by_x = loop @ self.C[i]
        z_by_u = loop @ self.D[np.ix_(i, inputs)]
        B_z = self.B[:, i]
        D_z = self.D[np.ix_(outputs, i)]
        return StateSpace(
            A=self.A + B_z @ z_by_x,
            B=self.B[:, inputs] + B_z @ z_by_u,
            C=self.C[outputs] + D_z @ z_by_x,
            D=self.D[np.ix_(outputs, inputs)] + D_z @ z_by_u,
        )

    def delayed_response(
        self, delays: ArrayLike, frequencies: ArrayLike
    ) -> ComplexArray:
        """Returns G(j w) with delays around the system (K, p - k, m - k).

        The last k outputs go back to the last k inputs, each after its delay.

        Args:
            delays: In s (k).
            frequencies: w in rad/s (K), none of them an undamped mode.
        """
        w = np.asarray(frequencies, dtype=float).reshape(-1)
        T = np.asarray(delays, dtype=float).reshape(-1)
        k = len(T)
        p, m = (size - k for size in self.D.shape)
        G = self.frequency_response(w)
        G_yu = G[:, :p, :m]
        G_yd = G[:, :p, m:]
        G_eu = G[:, p:, :m]
        G_ed = G[:, p:, m:]
        # d = shift (G_eu u + G_ed d): what the delays deliver, (K, k, m) by u.
        shift = np.exp(-1j * w[:, np.newaxis, np.newaxis] * T[:, np.newaxis])
        delivered = np.linalg.solve(np.eye(k) - shift * G_ed, shift * G_eu)
        return (G_yu + G_yd @ delivered).astype(complex)


def minimal_realization(system: StateSpace) -> tuple[StateSpace, ComplexArray]:
    """Removes the modes that do not show in G(s).

    First what the input does not reach, then what the output does not see, by the
    Krylov spaces of (A, B) and (A^T, C^T) with orthonormal bases. A feedback around
    the system leaves the removed modes where they are.

    Source: R. E. Kalman, "Mathematical description of linear dynamical systems",
    SIAM J. Control 1 (1963); the staircase form is that of P. Van Dooren, "The
    generalized eigenstructure problem in linear system theory", IEEE Trans. Autom.
    Control 26 (1981).

    Returns:
        The minimal system, in coordinates without a meaning of their own, and the
        eigenvalues of the removed modes.
    """
    scale = _balance(system)
    A = system.A * scale / scale[:, np.newaxis]
    B = system.B / scale[:, np.newaxis]
    C = system.C * scale
    # What the input reaches.
    V, hidden = _reachable(A, B)
    A = V.T @ A @ V
    B = V.T @ B
    C = C @ V
    # What the output sees: the reachable space of the dual system.
    W, unseen = _reachable(A.T, C.T)
    minimal = StateSpace(A=W.T @ A @ W, B=W.T @ B, C=C @ W, D=system.D)
    return minimal, np.concatenate([hidden, unseen])


def _reachable(A: Array, B: Array) -> tuple[Array, ComplexArray]:
    """Returns a basis of the reachable space and the eigenvalues outside of it."""
    n = len(A)
    V = np.zeros((n, 0))
    block = B
    size = np.linalg.norm(B)
    while block.shape[1] and V.shape[1] < n:
        for _ in range(2):  # Twice, for orthogonality to rounding.
            block = block - V @ (V.T @ block)
        U, sigma, _ = np.linalg.svd(block, full_matrices=False)
        new = U[:, sigma > _TOLERANCE * size]
        V = np.hstack([V, new])
        block = A @ new
        size = np.linalg.norm(A)
    complete, _, _ = np.linalg.svd(V, full_matrices=True)
    rest = complete[:, V.shape[1] :]
    return V, np.linalg.eigvals(rest.T @ A @ rest).astype(complex)


def _balance(system: StateSpace) -> Array:
    """Returns scales of the states that make their rows and columns alike.

    Those are of [A, B; C, 0] without the diagonal. Entries that may be rounding errors
    do not count.

    Source: B. N. Parlett and C. Reinsch, "Balancing a matrix for calculation of
    eigenvalues and eigenvectors", Numer. Math. 13 (1969).
    """
    n = system.num_states
    blocks = [[system.A, system.B], [system.C, np.zeros_like(system.D)]]
    matrix = np.abs(np.block(blocks))
    np.fill_diagonal(matrix[:n, :n], 0.0)
    matrix[matrix < 1e-13 * matrix.max(initial=0.0)] = 0.0
    scale = np.ones(n)
    for _ in range(20):
        for i in range(n):
            column = matrix[:, i].sum()
            row = matrix[i].sum()
            if column > 0 and row > 0:
                # A power of two, so that no digit is lost.
                factor = 2.0 ** np.round(0.5 * np.log2(row / column))
                matrix[:, i] *= factor
                matrix[i] /= factor
                scale[i] *= factor
    return scale
