"""Tests of numerics.characteristic_roots."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import lambertw

from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.loops.numerics.state_space import state_space


def roots_of(A, B, C, D, delay, **count):
    """Returns the roots of a loop whose signals all have the same delay."""
    loop = replace(state_space(A, B, C, D), delays=(delay,) * len(D))
    return characteristic_roots(loop, **count)


@pytest.mark.parametrize("delay", [0.05, 0.5, math.pi / 2, 3.0])
@pytest.mark.parametrize("a", [-1.0, 0.7])
def test_lambert_w(a, delay):
    """dx/dt = a x(t - T): s = W_k(a T)/T.

    R. M. Corless et al., "On the Lambert W function", Adv. Comput. Math. 5 (1996).
    """
    roots = roots_of([[0.0]], [[a]], [[1.0]], [[0.0]], delay=delay, count=6)
    expected = np.array([lambertw(a * delay, k) / delay for k in range(-6, 7)])
    expected = expected[np.argsort(-expected.real)][: len(roots)]
    assert len(roots) >= 5
    assert_allclose(
        np.sort_complex(np.round(roots, 9)), np.sort_complex(np.round(expected, 9))
    )


def test_roots_of_a_coupled_system():
    """Every root that is found satisfies the equation to rounding."""
    random = np.random.default_rng(1)
    A = random.normal(size=(4, 4))
    B = random.normal(size=(4, 2))
    C = random.normal(size=(2, 4))
    D = 0.2 * random.normal(size=(2, 2))
    delay = 0.8
    roots = roots_of(A, B, C, D, delay=delay, count=10)
    assert len(roots) >= 10
    for s in roots:
        z = np.exp(-s * delay)
        closed = A + B @ np.linalg.solve(np.eye(2) - D * z, C) * z
        assert np.min(np.abs(np.linalg.eigvals(closed) - s)) < 1e-9 * max(1, abs(s))
    assert np.all(np.diff(roots.real) <= 1e-9)


def test_neutral_equation():
    """The equation u(t) = d u(t - T): e^(s T) = d, s = (log d + 2 pi j k)/T."""
    d = 0.3
    delay = 2.0
    empty = np.zeros((0, 0))
    roots = roots_of(
        empty, np.zeros((0, 1)), np.zeros((1, 0)), [[d]], delay=delay, count=5
    )
    # All roots lie on one vertical line, so that their order is arbitrary.
    assert len(roots) >= 5
    assert len(np.unique(roots.imag.round(6))) == len(roots)
    assert_allclose(np.exp(roots * delay), d, rtol=1e-9)


def test_fast_root_behind_slow_ones():
    """The faster one of two independent loops has the rightmost root.

    It is a resonance at 120 rad/s whose damping is weaker than its delayed feedback. It
    turns by more than a hundred radians within the delay.
    """
    delay = 1.0
    fast = 120.0
    A = np.array([[-1.0, 0, 0], [0, 0, 1], [0, -(fast**2), -0.1]])
    B = np.array([[1.0, 0], [0, 0], [0, 1.0]])
    C = np.array([[-1.0, 0, 0], [0, 0, 5.0]])
    roots = roots_of(A, B, C, np.zeros((2, 2)), delay=delay, count=2)
    s = roots[0]
    assert abs(s.imag) > 100
    residual = s**2 + 0.1 * s + fast**2 - 5 * s * np.exp(-s * delay)
    assert abs(residual) < 1e-8 * fast**2
    assert 0 < s.real < 2.5


def test_without_delay_they_are_eigenvalues():
    A = [[0, 1], [-2, -3]]
    B = [[0], [1]]
    C = [[1, 0]]
    roots = roots_of(A, B, C, [[0.5]], delay=0.0)
    expected = np.roots([1, 3, 2 - 1 / (1 - 0.5)])
    assert_allclose(np.sort(roots.real), np.sort(expected), rtol=1e-12)


def test_pair_is_not_torn_apart():
    roots = roots_of([[0.0]], [[-1.0]], [[1.0]], [[0.0]], delay=1.0, count=1)
    assert len(roots) == 2
    assert roots[0] == pytest.approx(np.conj(roots[1]))


@pytest.mark.parametrize("delay", [-0.1, math.nan, math.inf])
def test_bad_delay(delay):
    with pytest.raises(ValueError, match="delay = "):
        roots_of([[0.0]], [[1.0]], [[1.0]], [[0.0]], delay=delay)
