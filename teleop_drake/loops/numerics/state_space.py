"""Linear time-invariant systems with delays as matrices, and minimal realisations.

    dx/dt = A x + B u,    y = C x + D u                                          (1)

The last k outputs may be fed back to the last k inputs, each through a delay:
u_i(t) = y_i(t - T_i). The other inputs and outputs are called open. G(s) is the
transfer function from the open inputs to the open outputs.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array, ComplexArray, Flags
from teleop_drake.loops.framework.validation import CheckNumber, Refuse

# The default tolerance of minimal_realization(). It is well above the error of blocks
# whose slopes are finite differences, about 1e-10.
_TOLERANCE = 1e-7

# The number of matrix entries that a frequency response holds at the same time.
_CHUNK = 1_000_000

# The relative distance from a pole at which a response is evaluated in its place.
_BESIDE = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class StateSpace:
    """A linear system (1) with n states, p outputs and m inputs.

    Attributes:
        matrix: [A, B; C, D] (n + p, n + m), copied and made read-only.
        num_states: Number n of states.
        delays: The delays T_i >= 0 in s of the last k outputs (k).

    Raises:
        ValueError: If an entry is not finite or a delay is negative.
    """

    matrix: Array
    num_states: int
    delays: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=float)
        if matrix.ndim != 2 or not np.isfinite(matrix).all():
            Refuse("matrix", matrix, "a finite matrix")
        matrix.setflags(write=False)
        object.__setattr__(self, "matrix", matrix)
        for delay in self.delays:
            CheckNumber("delay", delay, "s", minimum=0)

    @property
    def A(self) -> Array:
        """The matrix from states to rates (n, n)."""
        return self.matrix[: self.num_states, : self.num_states]

    @property
    def B(self) -> Array:
        """The matrix from inputs to rates (n, m)."""
        return self.matrix[: self.num_states, self.num_states :]

    @property
    def C(self) -> Array:
        """The matrix from states to outputs (p, n)."""
        return self.matrix[self.num_states :, : self.num_states]

    @property
    def D(self) -> Array:
        """The matrix from inputs to outputs, the direct feedthrough (p, m)."""
        return self.matrix[self.num_states :, self.num_states :]

    @property
    def num_open(self) -> tuple[int, int]:
        """The number of open outputs and the number of open inputs."""
        p, m = self.D.shape
        k = len(self.delays)
        return p - k, m - k

    @property
    def opened(self) -> Self:
        """The system cut open at its delays, so that all its signals are open."""
        return replace(self, delays=())

    def __neg__(self) -> Self:
        """Returns the system with the transfer function -G(s)."""
        matrix = self.matrix.copy()
        matrix[self.num_states :][: self.num_open[0]] *= -1
        return replace(self, matrix=matrix)

    def fed_back(self, delay: float) -> Self:
        """Returns the loop that the feedback u(t) = -y(t - T) closes.

        Its characteristic equation is det(I + G(s) e^(-s T)) = 0.

        Args:
            delay: T in s, the same for all signals.
        """
        return replace(-self, delays=(delay,) * len(self.D))

    def behind(self, delay: float) -> "StateSpace":
        """Returns this system without delays behind a delay, G(s) e^(-s T).

        Args:
            delay: T in s, > 0, the same for all signals.
        """
        p, m = self.D.shape
        matrix = np.zeros((len(self.matrix) + m, self.num_states + 2 * m))
        x = self.num_states
        matrix[: x + p, :x] = self.matrix[:, :x]
        # The system receives the outputs of the delays, which receive the input.
        matrix[: x + p, x + m :] = self.matrix[:, x:]
        matrix[x + p :, x : x + m] = np.eye(m)
        return StateSpace(matrix=matrix, num_states=x, delays=(delay,) * m)

    def frequency_response(self, frequencies: ArrayLike) -> ComplexArray:
        """Returns G(j w) between the open signals (K, p - k, m - k).

        On a pole the entries in which it appears are infinite.

        Args:
            frequencies: w in rad/s (K).
        """
        s = 1j * np.asarray(frequencies, dtype=float).reshape(-1)
        try:
            return self.response_at(s)
        except np.linalg.LinAlgError:
            pass
        near, is_pole = self._beside_poles(s, _BESIDE)
        nearer, _ = self._beside_poles(s, _BESIDE / 2)
        response = self.response_at(nearer)
        # Towards a pole an entry in which it appears doubles at least.
        grows = np.abs(response) > 1.5 * np.abs(self.response_at(near))
        response[grows & is_pole[:, np.newaxis, np.newaxis]] = np.inf
        return response

    def finite_response(self, frequencies: ArrayLike) -> ComplexArray:
        """Returns G(j w) as frequency_response() does, on a pole just beside it."""
        s = 1j * np.asarray(frequencies, dtype=float).reshape(-1)
        try:
            return self.response_at(s)
        except np.linalg.LinAlgError:
            return self.response_at(self._beside_poles(s, _BESIDE)[0])

    def response_at(self, s: ComplexArray) -> ComplexArray:
        """Returns G(s) (K, p - k, m - k); raises LinAlgError if an s is a pole.

        Args:
            s: Points of the complex plane in 1/s (K).
        """
        y, u = (self.num_states + np.arange(count) for count in self.num_open)
        # M(s) z = by_u u, where z contains the states and the inputs of the delays.
        by_u = np.delete(self.matrix[:, u], y, axis=0)[np.newaxis]
        seen = np.delete(self.matrix[y], u, axis=1)
        direct = self.matrix[np.ix_(y, u)]
        response = np.empty((len(s), *direct.shape), dtype=complex)
        # In chunks, because M(s) of all points may not fit into the memory.
        step = max(1, _CHUNK // (self.matrix.size + 1))
        for k in range(0, len(s), step):
            chunk = slice(k, k + step)
            z = np.linalg.solve(self.characteristic_matrix(s[chunk]), by_u)
            response[chunk] = (seen * self._lags(s[chunk])) @ z + direct
        return response

    def _beside_poles(
        self, s: ComplexArray, distance: float
    ) -> tuple[ComplexArray, Flags]:
        """Returns points moved upwards from poles, and which of the points are poles.

        Args:
            s: Points in 1/s (K).
            distance: The distance from a pole, relative to the pole or, at 0, to A.
        """
        is_pole = np.linalg.slogdet(self.characteristic_matrix(s))[0] == 0
        unit = float(np.linalg.norm(self.A)) or 1.0
        size = np.where(s == 0, unit, np.abs(s))
        return s + 1j * distance * size * is_pole, is_pole

    def characteristic_matrix(self, s: ArrayLike) -> ComplexArray:
        """Returns M(s) of the states and the delayed signals (..., n + k, n + k).

            M(s) = [s I - A, -B e^(-s T); -C, I - D e^(-s T)]

        with the diagonal matrix e^(-s T). The roots of det M(s) = 0 are the
        characteristic roots of the system with its open inputs at 0.

        Args:
            s: Points of the complex plane in 1/s (...,).
        """
        y, u = (self.num_states + np.arange(count) for count in self.num_open)
        closed = np.delete(np.delete(self.matrix, y, axis=0), u, axis=1)
        points = np.asarray(s, dtype=complex)[..., np.newaxis]
        matrix = np.empty((*points.shape[:-1], *closed.shape), dtype=complex)
        matrix[...] = -closed
        if self.delays:
            matrix *= self._lags(s)
        states = np.arange(self.num_states)
        signals = np.arange(self.num_states, len(closed))
        matrix[..., states, states] += points
        matrix[..., signals, signals] += 1.0
        return matrix

    def _times(self) -> Array:
        """Returns the delays in s of states, which are 0, and of signals (n + k)."""
        return np.concatenate([np.zeros(self.num_states), self.delays])

    def _lags(self, s: ArrayLike) -> ComplexArray:
        """Returns e^(-s T) for each of the delays of _times() (..., 1, n + k)."""
        return np.exp(-np.asarray(s)[..., np.newaxis, np.newaxis] * self._times())

    def newton_step(self, s: complex) -> complex:
        """Returns the step of Newton's method from s towards a root, in 1/s.

        It is 0 on a root, and infinite where the method fails: M(s) overflows or the
        derivative of its determinant vanishes.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            matrix = self.characteristic_matrix(s)
        if not np.isfinite(matrix).all():
            return complex(np.inf)
        times = self._times()
        is_state = np.diag(np.arange(len(times)) < self.num_states)
        # slope is dM/ds. The columns of the delayed signals are those of I - M times T.
        slope = is_state + times * (np.eye(len(times)) - matrix)
        try:
            # trace is (det M)'/det M.
            trace = np.trace(np.linalg.solve(matrix, slope))
        except np.linalg.LinAlgError:
            return 0j
        if trace == 0:
            return complex(np.inf)
        return complex(-1 / trace)

    def part(
        self, states: ArrayLike, inputs: ArrayLike, outputs: ArrayLike
    ) -> "StateSpace":
        """Returns the subsystem of some states, inputs and outputs, without delays.

        Args:
            states: Indices of the states.
            inputs: Indices of the inputs.
            outputs: Indices of the outputs.
        """
        x = np.asarray(states, dtype=int)
        rows = np.append(x, self.num_states + np.asarray(outputs, dtype=int))
        columns = np.append(x, self.num_states + np.asarray(inputs, dtype=int))
        matrix = self.matrix[np.ix_(rows, columns)]
        return StateSpace(matrix=matrix, num_states=len(x))

    def closed(self, signals: ArrayLike) -> Self:
        """Returns the system with some open outputs fed back to open inputs.

        The connected outputs and inputs are removed.

        Args:
            signals: Indices of the outputs, which are also those of the inputs.

        Raises:
            ValueError: If the loop is not well posed.
        """
        i = self.num_states + np.asarray(signals, dtype=int)
        matrix = close_loops(self.matrix, i)
        return replace(self, matrix=np.delete(np.delete(matrix, i, axis=0), i, axis=1))


def close_loops(matrix: Array, signals: ArrayLike) -> Array:
    """Returns a matrix after some of its outputs are fed back to its inputs.

    Args:
        matrix: The matrix from inputs (columns) to outputs (rows).
        signals: The indices of the rows, which are also those of the columns.

    Raises:
        ValueError: If the loop is not well posed.
    """
    i = np.asarray(signals, dtype=int)
    around = np.eye(len(i)) - matrix[np.ix_(i, i)]
    if len(i) and np.linalg.cond(around) > 1e12:
        allowed = "such that I - D of the closed signals is not singular"
        Refuse("D", matrix[np.ix_(i, i)], allowed)
    return matrix + matrix[:, i] @ np.linalg.solve(around, matrix[i])


def strong_parts(matrix: Array) -> list[Flags]:
    """Returns the strongly connected parts of a square matrix's graph, as masks.

    Entry (i, j) tells whether node j acts on node i. A node that does not act on itself
    is in no part.
    """
    from scipy.sparse.csgraph import connected_components

    acts = matrix != 0
    _, labels = connected_components(acts, connection="strong")
    parts = [labels == label for label in dict.fromkeys(labels.tolist())]
    return [part for part in parts if part.sum() > 1 or acts.diagonal()[part].any()]


def state_space(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike) -> StateSpace:
    """Returns the system of four matrices, without delays."""
    blocks = [np.asarray(x, dtype=float) for x in (A, B, C, D)]
    matrix = np.block([blocks[:2], blocks[2:]])
    return StateSpace(matrix=matrix, num_states=len(blocks[0]))


def minimal_realization(
    system: StateSpace, tolerance: float = _TOLERANCE
) -> tuple[StateSpace, ComplexArray]:
    """Removes the modes that do not appear in G(s).

    The uncontrollable modes are removed first, then the unobservable ones, by means of
    orthonormal bases of the Krylov spaces of (A, B) and (A^T, C^T). Feedback around the
    system does not change the removed modes.

    Source: R. E. Kalman, "Mathematical description of linear dynamical systems",
    SIAM J. Control 1 (1963); the staircase form is that of P. Van Dooren, "The
    generalized eigenstructure problem in linear system theory", IEEE Trans. Autom.
    Control 26 (1981).

    Args:
        system: The system, without delays.
        tolerance: The coupling, relative to the norm of A in balanced coordinates,
            below which a direction counts as uncontrollable or unobservable.

    Returns:
        The minimal system, whose states have no physical meaning, and the eigenvalues
        of the removed modes.
    """
    scale = _balance(system)
    balanced = _in_coordinates(system, np.diag(scale), np.diag(1 / scale))
    # The controllable subspace.
    V, hidden = _reachable(balanced.A, balanced.B, tolerance)
    reached = _in_coordinates(balanced, V, V.T)
    # The observable part is the controllable subspace of the dual system.
    W, unseen = _reachable(reached.A.T, reached.C.T, tolerance)
    minimal = _in_coordinates(reached, W, W.T)
    return minimal, np.concatenate([hidden, unseen])


def _in_coordinates(system: StateSpace, basis: Array, inverse: Array) -> StateSpace:
    """Returns a system in the states z, with x = basis z and z = inverse x."""
    return state_space(
        inverse @ system.A @ basis, inverse @ system.B, system.C @ basis, system.D
    )


def _reachable(A: Array, B: Array, tolerance: float) -> tuple[Array, ComplexArray]:
    """Returns a basis of the controllable subspace and the uncontrollable modes.

    The basis is orthonormal. It is extended by A times its newest vectors until these
    add no new direction.
    """
    n = len(A)
    V = np.zeros((n, 0))
    block = B
    size = np.linalg.norm(B)
    while block.shape[1] and V.shape[1] < n:
        for _ in range(2):  # Twice, for orthogonality to rounding.
            block = block - V @ (V.T @ block)
        U, sigma, _ = np.linalg.svd(block, full_matrices=False)
        new = U[:, sigma > tolerance * size]
        V = np.hstack([V, new])
        block = A @ new
        size = np.linalg.norm(A)
    complete, _ = np.linalg.qr(V, mode="complete")
    rest = complete[:, V.shape[1] :]
    return V, np.linalg.eigvals(rest.T @ A @ rest).astype(complex)


def _balance(system: StateSpace) -> Array:
    """Returns scales of the states that balance their rows and columns (n).

    For each state they make the sums of magnitudes of its row and its column in
    [A, B; C, 0] nearly equal. The diagonal and entries that may be rounding errors are
    left out.

    Source: B. N. Parlett and C. Reinsch, "Balancing a matrix for calculation of
    eigenvalues and eigenvectors", Numer. Math. 13 (1969).
    """
    n = system.num_states
    matrix = np.abs(system.matrix)
    matrix[n:, n:] = 0.0
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
