"""Jacobi's method against LAPACK's singular values."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.loops.numerics.jacobi import singular_values


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6])
def test_singular_values(n):
    A = np.random.default_rng(n).normal(size=(n, n))
    U, sigma, Vt = singular_values(A)
    expected = np.linalg.svd(A, compute_uv=False)
    assert_allclose(-np.sort(-sigma), expected, atol=1e-12)
    assert_allclose(U.T @ U, np.eye(n), atol=1e-12)
    assert_allclose(U * sigma @ Vt, A, atol=1e-12)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("c", [0.0, 1e-300, 1e-160, 1e-20])
def test_almost_diagonal_matrices(c):
    U, sigma, Vt = singular_values(np.array([[1.0, c], [c, 2.0]]))
    assert_array_equal(sigma, [1.0, 2.0])
    assert_allclose(Vt, [[1.0, -c], [c, 1.0]], atol=1e-149)
    assert_allclose(U, [[1.0, c], [-c, 1.0]], atol=1e-149)


@pytest.mark.filterwarnings("error")
def test_a_matrix_of_zeros():
    _, sigma, Vt = singular_values(np.zeros((2, 2)))
    assert_array_equal(sigma, np.zeros(2))
    assert_array_equal(Vt, np.eye(2))


def test_what_is_no_number_stays_so():
    _, sigma, _ = singular_values(np.array([[1.0, np.nan], [np.nan, 2.0]]))
    assert np.isnan(sigma).all()


def test_left_vectors_of_a_singular_matrix_are_undetermined():
    U, sigma, _ = singular_values(np.array([[3.0, 0.0], [4.0, 0.0]]))
    assert_allclose(sigma, [5.0, 0.0])
    assert_allclose(U[:, 0], [0.6, 0.8])
    assert np.isnan(U[:, 1]).all()
