"""The two-link arm of the thesis's Appendix A in closed form, written by hand."""

import numpy as np

m1 = m2 = 0.5
L1 = L3 = 0.75
L2 = L4 = 0.375
I1 = I2 = 0.0234
g = 9.81


def M(q):
    """(A.1), (A.2)"""
    d22 = m2 * L4**2 + I2
    d12 = m2 * L1 * L4 * np.cos(q[1]) + d22
    d11 = m1 * L2**2 + m2 * (L1**2 + L4**2 + 2 * L1 * L4 * np.cos(q[1])) + I1 + I2
    return np.array([[d11, d12], [d12, d22]])


def C(q, qdot):
    """(A.3), (A.4) with c21 = +m2 L1 L4 sin(q2) q1'"""
    h = m2 * L1 * L4 * np.sin(q[1])
    return np.array([[-h * qdot[1], -h * (qdot[0] + qdot[1])], [h * qdot[0], 0.0]])


def C_as_printed(q, qdot):
    """(A.3), (A.4) to the letter"""
    h = m2 * L1 * L4 * np.sin(q[1])
    c21 = -h * qdot[0] + m2 * L4**2 + I2
    return np.array([[-h * qdot[1], -h * (qdot[0] + qdot[1])], [c21, 0.0]])


def G(q):
    """(A.5), (A.6): gravity along -y of the arm's own plane"""
    g2 = m2 * L4 * g * np.cos(q[0] + q[1])
    g1 = m1 * L2 * g * np.cos(q[0]) + m2 * g * L1 * np.cos(q[0]) + g2
    return np.array([g1, g2])


def J(q):
    """(A.7), (A.8)"""
    s1 = np.sin(q[0])
    c1 = np.cos(q[0])
    s12 = np.sin(q[0] + q[1])
    c12 = np.cos(q[0] + q[1])
    return np.array([[-L1 * s1 - L3 * s12, -L3 * s12], [L1 * c1 + L3 * c12, L3 * c12]])


def joints(p, sign=1):
    """(A.14); `sign` is that of q2."""
    x, y = p
    c2 = (x * x + y * y - L1**2 - L3**2) / (2 * L1 * L3)
    q2 = sign * np.arccos(c2)
    outer = np.arctan2(L3 * np.sin(q2), L1 + L3 * np.cos(q2))
    return np.array([np.arctan2(y, x) - outer, q2])


def p_WT(q):
    """(A.13)"""
    angles = np.array([q[0], q[0] + q[1]])
    return np.array([[L1, L3] @ np.cos(angles), [L1, L3] @ np.sin(angles)])
