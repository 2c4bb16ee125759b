"""The loop as one system: L, between the delay's two ends."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_drake.linear_model.models import LoopModel
from teleop_drake.numerics.state_space import StateSpace

Array = NDArray[np.float64]

# Entries of B, C and D smaller than this, relative to the largest, are zero.
_NEGLIGIBLE = 1e-9


def CutLoop(model: LoopModel) -> StateSpace:
    """Returns L, such that the loop has the roots of det(I + L(s) e^(-s T)).

    The loop is cut where fewer signals cross: among the entries of the return packet
    that the master listens to, or those of the forward packet that depend on them and
    act on the slave. Delays inside of the stations are cut in any case.

    Args:
        model: The loop at an operating point; delays inside of it, if any, are T.

    Returns:
        L, not minimal: its states are those of the slave and of the master.
    """
    num_sent, num_returned = model.packet_sizes
    M = _Split(model.master, num_returned, num_sent)
    S = _Split(model.slave, num_sent, num_returned)
    heard = _Nonzero(np.vstack([M.B1, M.D11, M.D21]), axis=0)
    sent = np.intersect1d(
        _Nonzero(np.hstack([M.C1, M.D11, M.D12]), axis=1),
        _Nonzero(np.vstack([S.B1, S.D11, S.D21]), axis=0),
    )
    if len(heard) <= len(sent):
        # From the return packet received to the one sent: first the master.
        first, second, ports = M, S, heard
    else:
        first, second, ports = S, M, sent
    # Inputs: packet, inner of the first, inner of the second; outputs: packet of the
    # second, the inner ones.
    n, p, q = len(first.A), first.B2.shape[1], second.B2.shape[1]
    A = np.block(
        [[second.A, second.B1 @ first.C1], [np.zeros((n, len(second.A))), first.A]]
    )
    B = np.block(
        [
            [second.B1 @ first.D11, second.B1 @ first.D12, second.B2],
            [first.B1, first.B2, np.zeros((n, q))],
        ]
    )
    C = np.block(
        [
            [second.C1, second.D11 @ first.C1],
            [np.zeros((p, len(second.A))), first.C2],
            [second.C2, second.D21 @ first.C1],
        ]
    )
    D = np.block(
        [
            [second.D11 @ first.D11, second.D11 @ first.D12, second.D12],
            [first.D21, first.D22, np.zeros((p, q))],
            [second.D21 @ first.D11, second.D21 @ first.D12, second.D22],
        ]
    )
    size = len(second.D11)
    ports = np.concatenate([ports, np.arange(size, size + p + q)])
    loop = StateSpace(A=A, B=B[:, ports], C=-C[ports], D=-D[np.ix_(ports, ports)])
    return _MergeInputs(loop)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Side:
    """A side of the loop: packet (1) and delays inside (2) apart."""

    A: Array
    B1: Array
    B2: Array
    C1: Array
    C2: Array
    D11: Array
    D12: Array
    D21: Array
    D22: Array


def _Split(side: StateSpace, num_inputs: int, num_outputs: int) -> _Side:
    m, p = num_inputs, num_outputs
    return _Side(
        A=side.A,
        B1=side.B[:, :m],
        B2=side.B[:, m:],
        C1=side.C[:p],
        C2=side.C[p:],
        D11=side.D[:p, :m],
        D12=side.D[:p, m:],
        D21=side.D[p:, :m],
        D22=side.D[p:, m:],
    )


def _MergeInputs(loop: StateSpace) -> StateSpace:
    """Returns a loop with the same det(I + L z), with the fewest signals.

    Inputs that always act together, as v_ret and -v_model(t - T) of a predictor do, or
    position, velocity and force on the handle of four channels, are one:
    det(I + P V^T z) = det(I + V^T P z).
    """
    stacked = np.vstack([loop.B, loop.D])
    _, sigma, Vt = np.linalg.svd(stacked, full_matrices=False)
    V = Vt[sigma > _NEGLIGIBLE * sigma.max(initial=1e-300)].T
    if V.shape[0] == V.shape[1]:
        return loop
    return StateSpace(A=loop.A, B=loop.B @ V, C=V.T @ loop.C, D=V.T @ loop.D @ V)


def _Nonzero(matrix: Array, axis: int) -> NDArray[np.int_]:
    """Returns which columns (axis 0) or rows (axis 1) are not zero."""
    size = np.abs(matrix).max(axis=axis, initial=0.0)
    return np.flatnonzero(size > _NEGLIGIBLE * np.abs(matrix).max(initial=1e-300))
