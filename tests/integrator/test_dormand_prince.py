"""Tests of the tableau: the conditions of its order."""

import numpy as np
import pytest

from teleop_drake.integrator.dormand_prince import NUM_STAGES, A, C, E, P

WEIGHTS = np.append(A[-1], 0.0)


def test_stages_are_at_their_instants():
    assert A.shape == (NUM_STAGES, NUM_STAGES - 1)
    np.testing.assert_allclose(A.sum(axis=1), C, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("power", range(5))
def test_polynomials_are_integrated(power):
    """Order 5; the embedded solution has order 4."""
    moments = C.astype(float) ** power
    assert moments @ WEIGHTS == pytest.approx(1 / (power + 1), abs=1e-14)
    if power < 4:
        assert moments @ E == pytest.approx(0, abs=1e-14)
    else:
        assert abs(moments @ E) > 1e-4


@pytest.mark.parametrize("theta", [0.3, 1.0])
def test_dense_output_has_order_four(theta):
    shares = P @ theta ** np.arange(1, 5)
    for power in range(4):
        expected = theta ** (power + 1) / (power + 1)
        assert C.astype(float) ** power @ shares == pytest.approx(expected, abs=1e-13)
    if theta == 1.0:
        np.testing.assert_allclose(shares, WEIGHTS, atol=1e-13)
