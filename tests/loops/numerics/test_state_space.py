"""Tests of teleop_drake.loops.numerics.state_space."""

import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.loops.numerics.state_space import minimal_realization, state_space


def System(A, B, C, D=None):
    B = np.atleast_2d(B)
    C = np.atleast_2d(C)
    D = np.zeros((len(C), B.shape[1])) if D is None else D
    return state_space(A=np.atleast_2d(A), B=B, C=C, D=D)


def test_frequency_response_of_a_known_filter():
    # 1/(s^2 + 0.2 s + 1) + 3
    system = System([[0, 1], [-1, -0.2]], [[0], [1]], [[1, 0]], [[3.0]])
    w = np.array([0.0, 0.5, 1.0, 20.0])
    s = 1j * w
    assert_allclose(
        system.frequency_response(w)[:, 0, 0], 1 / (s**2 + 0.2 * s + 1) + 3, rtol=1e-13
    )


def test_on_a_pole_the_entries_in_which_it_appears_are_infinite():
    """The outputs of x'' + x = u are x and, with 1/(s + 1) of u, another one."""
    A = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    system = System(A, [[0.0], [1.0], [1.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    w = np.array([0.5, 1.0, 2.0])
    response = system.frequency_response(w)[:, :, 0]
    assert_allclose(response[:, 1], 1 / (1j * w + 1), rtol=1e-7)
    assert np.isinf(response[1, 0])
    assert_allclose(response[[0, 2], 0], 1 / (1 - w[[0, 2]] ** 2))
    beside = system.finite_response(w)[:, :, 0]
    assert np.isfinite(beside).all()
    assert_allclose(beside[[0, 2]], response[[0, 2]])


@pytest.mark.parametrize("order", [1, 2, 3])
def test_integrators_have_an_infinite_response_at_0(order):
    B = np.eye(order)[:, -1:]
    system = System(np.eye(order, k=1), B, np.eye(order)[:1], [[5.0]])
    at_0, at_2 = system.frequency_response([0.0, 2.0])[:, 0, 0]
    assert np.isinf(at_0)
    assert at_2 == pytest.approx(5 + (2j) ** -order)


def test_the_response_of_a_large_system_takes_little_memory():
    """80 lags at 1500 frequencies: their matrices together would take 154 MB."""
    num = 80
    A = -np.diag(np.arange(1.0, num + 1))
    system = System(A, np.ones((num, 1)), np.ones((1, num)))
    w = np.geomspace(0.1, 1e3, 1500)
    tracemalloc.start()
    try:
        response = system.frequency_response(w)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 6e7
    expected = (1 / (1j * w[:, np.newaxis] - A.diagonal())).sum(axis=1)
    assert_allclose(response[:, 0, 0], expected, rtol=1e-12)


def test_what_is_no_number_is_refused():
    with pytest.raises(ValueError, match=r"matrix = .*: must be a finite"):
        System([[np.nan]], [[1.0]], [[1.0]])


def test_cancelled_integrator_is_found():
    """(25 s + 50)/(s (s + 25)) times s/(m s^2 + c s + k), in both orders."""
    H = System([[0, 1], [0, -25]], [[0], [1]], [[50, 25]])
    S = System([[0, 1], [-300, -0.2]], [[0], [2]], [[0, 1]])
    for first, second in ((H, S), (S, H)):
        cascade = System(
            np.block([[second.A, second.B @ first.C], [np.zeros((2, 2)), first.A]]),
            np.vstack([np.zeros((2, 1)), first.B]),
            np.hstack([second.C, np.zeros((1, 2))]),
        )
        minimal, hidden = minimal_realization(cascade)
        assert_allclose(hidden, [0.0], atol=1e-10)
        assert_allclose(
            np.sort_complex(np.linalg.eigvals(minimal.A)),
            np.sort_complex(
                np.concatenate([np.roots([1, 0.2, 300]), [-25.0]]).astype(complex)
            ),
            rtol=1e-9,
        )


def test_hidden_modes_in_badly_scaled_and_mixed_coordinates():
    """Hidden modes are found in any units and coordinates of the state."""
    random = np.random.default_rng(3)
    A = np.diag([-1.0, -2.0, 0.5, -7.0, 0.0])
    # The modes 0.5 and 0 are uncontrollable, and -7 is unobservable.
    B = np.array([[1.0], [1.0], [0.0], [1.0], [0.0]])
    C = np.array([[1.0, 1.0, 1.0, 0.0, 1.0]])
    scale = np.diag([1e-4, 1e3, 1.0, 1e2, 1e-2])
    T = scale @ np.linalg.qr(random.normal(size=(5, 5)))[0]
    system = System(T @ A @ np.linalg.inv(T), T @ B, C @ np.linalg.inv(T))
    minimal, hidden = minimal_realization(system)
    assert_allclose(np.sort(hidden.real), [-7.0, 0.0, 0.5], atol=1e-6)
    assert_allclose(np.sort(np.linalg.eigvals(minimal.A)), [-2.0, -1.0], rtol=1e-6)


def test_system_without_input_hides_everything():
    system = System([[-1.0]], np.zeros((1, 1)), [[1.0]])
    minimal, hidden = minimal_realization(system)
    assert minimal.num_states == 0
    assert_allclose(hidden, [-1.0])


def test_matrices_are_copies_and_read_only():
    A = np.array([[-1.0]])
    system = System(A, [[1.0]], [[1.0]])
    A[0, 0] = 5.0
    assert system.A[0, 0] == -1.0
    with pytest.raises(ValueError, match="read-only"):
        system.A[0, 0] = 2.0
