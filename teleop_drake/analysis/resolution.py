"""How well the roots of the linearised loop are known.

The entries of the linear models have two errors: that of the differences which they
come from, and that of the instant, because the operating point moves on while a mode
goes through its motion and while its signals are under way. From both follows below
which size a root is not told from a neutral one, and by how much any other root may be
off (numerics.root_error).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_drake.analysis.linear_models import LoopModel
from teleop_drake.numerics.root_error import root_error, unresolved_radius
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.validation import Refuse

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# An error that is estimated from one difference of two numbers may be so many times
# as large.
_DOUBT = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _ClosedLoop:
    """The closed loop at one value of s: its roots are those of det(s I - A) = 0."""

    A: ComplexArray
    error: Array
    drift: ComplexArray


def UnresolvedRadius(model: LoopModel) -> float:
    """Returns the size in 1/s below which a root is not told from a neutral one.

    It holds for the modes of both ends and for the loop that is closed without delay.

    Args:
        model: The loop at an operating point.

    Raises:
        ValueError: If the loop is not well posed without delay.
    """
    ends, error, drift = _Ends(model)
    closed = _Close(model, 1.0)
    return max(
        unresolved_radius(ends.A, error.A, drift.A),
        unresolved_radius(closed.A.real, closed.error, closed.drift.real),
    )


def RootError(model: LoopModel, root: complex, delay: float) -> float:
    """Returns by how much a characteristic root may be off, in 1/s.

    To first order in the errors, and infinite for a root that is not simple.

    Args:
        model: The loop at an operating point.
        root: A root s of the loop with the delay.
        delay: Round-trip delay in s.

    Raises:
        ValueError: If the loop is not well posed.
    """
    z = np.exp(-root * delay)
    closed = _Close(model, z)
    # F = s I - A(e^(-s T)); dA/ds = -T dA/d(log z).
    step = 1e-6
    ahead, behind = _Close(model, z * np.exp(step)), _Close(model, z * np.exp(-step))
    eye = np.eye(len(closed.A))
    slope = eye + delay * (ahead.A - behind.A) / (2 * step)
    # What arrives now was sent by the model of a delay ago.
    drift = closed.drift * (1 / max(abs(root), 1e-300) + delay)
    return root_error(root * eye - closed.A, slope, closed.error, drift)


def _Ends(model: LoopModel) -> tuple[StateSpace, StateSpace, StateSpace]:
    """Returns slave and master side by side, their error and their drift."""
    ends = StateSpace.block_diagonal(model.slave, model.master)
    error = StateSpace.block_diagonal(model.slave_error, model.master_error)

    def Bound(matrix: Array, estimate: Array) -> Array:
        rounding = ends.num_states * np.finfo(float).eps * np.abs(matrix)
        bound: Array = _DOUBT * estimate + rounding
        return bound

    bound = StateSpace(
        A=Bound(ends.A, error.A),
        B=Bound(ends.B, error.B),
        C=Bound(ends.C, error.C),
        D=Bound(ends.D, error.D),
    )
    drift = StateSpace.block_diagonal(model.slave_drift, model.master_drift)
    return ends, bound, drift


def _Close(model: LoopModel, z: complex) -> _ClosedLoop:
    """Closes the loop, with z = e^(-s T) in the forward channel and delays inside."""
    ends, error, drift = _Ends(model)
    connect = _Connections(model, z)
    # y = C x + D P y, dx/dt = A x + B P y.
    try:
        inverse = np.linalg.inv(np.eye(len(ends.D)) - ends.D @ connect)
    except np.linalg.LinAlgError:
        Refuse("loop", "of singular feedthrough", "a well-posed one")
    inputs = (connect @ inverse @ ends.C).astype(complex)
    outputs = (ends.B @ connect @ inverse).astype(complex)

    def Perturb(
        change: StateSpace, inputs: ComplexArray, outputs: ComplexArray
    ) -> ComplexArray:
        """Returns the change of the closed A with that of the ends, to first order."""
        by_input = change.A + change.B @ inputs
        by_output = change.C + change.D @ inputs
        result: ComplexArray = by_input + outputs @ by_output
        return result

    bound = Perturb(error, np.abs(inputs) + 0j, np.abs(outputs) + 0j).real
    return _ClosedLoop(
        A=(ends.A + ends.B @ inputs).astype(complex),
        error=bound,
        drift=Perturb(drift, inputs, outputs),
    )


def _Connections(model: LoopModel, z: complex) -> ComplexArray:
    """Returns P in u = P y, of [slave, master], each [packet, delays inside]."""
    num_sent, num_returned = model.packet_sizes
    num_slave = len(model.slave.D) - num_returned
    num_master = len(model.master.D) - num_sent
    inputs = np.cumsum([0, num_sent, num_slave, num_returned, num_master])
    outputs = np.cumsum([0, num_returned, num_slave, num_sent, num_master])
    P = np.zeros((inputs[-1], outputs[-1]), dtype=complex)
    for i, j, gain in ((0, 2, z), (1, 1, z), (2, 0, 1.0), (3, 3, z)):
        rows, columns = slice(*inputs[i : i + 2]), slice(*outputs[j : j + 2])
        P[rows, columns] = gain * np.eye(inputs[i + 1] - inputs[i])
    return P
