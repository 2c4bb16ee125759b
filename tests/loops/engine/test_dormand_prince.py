"""The tableau."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.integrate import RK45

from teleop_drake.loops.engine.dormand_prince import A, C, E, P


def test_the_tableau_is_that_of_scipy():
    """Whose import takes longer than a run."""
    stages = np.pad(RK45.A, [(0, 0), (0, 2)])
    last = [*RK45.B, 0.0]
    assert_allclose(A, [*stages, last], rtol=1e-15)
    assert_allclose(C, [*RK45.C, 1], rtol=1e-15)
    assert_allclose(E, RK45.E, rtol=1e-15)
    assert_allclose(P, RK45.P, rtol=1e-15)
