"""Tests of numerics.root_error against perturbed matrices."""

import numpy as np
import pytest

from teleop_drake.numerics.root_error import root_error, unresolved_radius


def jordan(size):
    return np.eye(size, k=1)


def block(first, second):
    n, m = len(first), len(second)
    return np.block([[first, np.zeros((n, m))], [np.zeros((m, n)), second]])


@pytest.mark.parametrize(
    ("size", "eps"), [(1, 1e-7), (2, 1e-7), (2, 1e-12), (3, 1e-7), (3, 1e-12)]
)
def test_defective_root_is_known_to_a_root_of_the_error(size, eps):
    A = block(jordan(size), np.diag([-1.0, -20.0]))
    radius = unresolved_radius(A, np.full_like(A, eps), np.zeros_like(A))
    assert eps ** (1 / size) <= radius <= 5 * eps ** (1 / size)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_no_perturbation_within_the_error_leaves_the_circle(size):
    rng = np.random.default_rng(size)
    basis = rng.normal(size=(size + 2, size + 2))
    A = basis @ block(jordan(size), np.diag([0.5, -20.0])) @ np.linalg.inv(basis)
    error = 1e-6 * np.abs(A)
    radius = unresolved_radius(A, error, np.zeros_like(A))
    assert radius < 0.5
    for _ in range(200):
        noisy = A + error * rng.uniform(-1, 1, A.shape)
        sizes = np.sort(np.abs(np.linalg.eigvals(noisy)))
        assert sizes[size - 1] < radius < sizes[size]


def test_slow_root_that_is_known_is_told_from_zero():
    A = np.diag([0.0, 1e-4, -1.0, -20.0])
    radius = unresolved_radius(A, np.full_like(A, 1e-6), np.zeros_like(A))
    assert 1e-6 < radius < 1e-4
    A = np.diag([1e-4, -1.0, -20.0])
    assert unresolved_radius(A, np.full_like(A, 1e-9), np.zeros_like(A)) == 0


def test_units_do_not_matter():
    scale = np.array([1e-3, 1.0, 1e4, 7.0])
    A = block(jordan(2), np.array([[-1.0, 3.0], [0.1, -20.0]]))
    error, drift = 1e-8 * (np.abs(A) + 1), 1e-4 * A.T
    units = scale / scale[:, None]
    radius = unresolved_radius(A, error, drift)
    assert radius > 0
    assert unresolved_radius(A * units, error * units, drift * units) == pytest.approx(
        radius, rel=1e-9
    )


@pytest.mark.parametrize("speed", [1e-3, 1e-2, 0.1])
def test_drift_hides_what_is_slower_than_the_motion(speed):
    """d2x/dt2 + a v dx/dt + b(v t) v^2 x = 0: a motion of its own time v t."""
    A = np.array([[0.0, 1.0, 0.0], [-2 * speed**2, 0.5 * speed, 0.0], [0, 0, -20.0]])
    drift = np.zeros_like(A)
    drift[1, 0] = 10 * speed**3
    radius = unresolved_radius(A, 1e-14 * np.abs(A), drift)
    assert speed * np.sqrt(2) < radius < 5 * speed
    # Without the drift the roots are what they are.
    assert unresolved_radius(A, 1e-14 * np.abs(A), 0 * drift) < 1e-6


def test_root_error_is_the_shift_of_a_root():
    rng = np.random.default_rng(3)
    A, change = rng.normal(size=(2, 5, 5))
    roots = np.linalg.eigvals(A)
    s = roots[np.argmax(roots.real)]
    matrix = s * np.eye(5) - A
    h = 1e-6
    moved = np.linalg.eigvals(A + h * change)
    shift = np.abs(moved - s).min()
    zero = np.zeros((5, 5))
    assert root_error(matrix, np.eye(5), zero, h * change) == pytest.approx(
        shift, rel=1e-4
    )
    bound = root_error(matrix, np.eye(5), h * np.abs(change), zero)
    assert shift <= bound * (1 + 1e-4)


def test_double_root_has_no_first_order():
    zero = np.zeros((2, 2))
    assert root_error(-jordan(2), np.eye(2), zero + 1e-9, zero) == np.inf
