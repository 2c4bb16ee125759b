"""The tableau."""

import numpy as np
from scipy.integrate import RK45

from teleop_drake.engine.dormand_prince import NUM_STAGES, A, C, E, P


def test_the_tableau_is_that_of_scipy():
    """Whose import takes longer than a run."""
    assert A.shape == (NUM_STAGES, NUM_STAGES - 1)
    stages = np.column_stack((RK45.A, np.zeros(NUM_STAGES - 1)))
    np.testing.assert_allclose(A, [*stages, RK45.B], rtol=1e-15)
    np.testing.assert_allclose(C, [*RK45.C, 1], rtol=1e-15)
    np.testing.assert_allclose(E, RK45.E, rtol=1e-15)
    np.testing.assert_allclose(P, RK45.P, rtol=1e-15)
