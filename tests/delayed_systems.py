"""Loops with a delay, cut open at the delay."""

import numpy as np

from teleop_drake.loops.numerics.state_space import state_space


def Retarded(A0, A1):
    """The loop of dx/dt = A0 x + A1 x(t - T)."""
    A0 = np.array(A0, dtype=float)
    A1 = np.array(A1, dtype=float)
    U, sigma, Vt = np.linalg.svd(A1)
    rank = int(np.sum(sigma > 1e-12))
    return state_space(
        A=A0, B=U[:, :rank] * sigma[:rank], C=-Vt[:rank], D=np.zeros((rank, rank))
    )


def Scalar(numerator, denominator):
    """L(s) = numerator/denominator in controllable canonical form."""
    den = np.array(denominator, dtype=float)
    num = np.concatenate([np.zeros(len(den) - len(numerator)), numerator]) / den[0]
    den = den / den[0]
    n = len(den) - 1
    A = np.eye(n, k=1)
    A[-1] = -den[:0:-1]
    C = (num[1:] - num[0] * den[1:])[::-1]
    return state_space(A=A, B=np.eye(n)[:, -1:], C=C[None], D=[[num[0]]])
