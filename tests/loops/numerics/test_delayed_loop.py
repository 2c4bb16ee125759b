"""Margins of random loops with delays, checked by collocation on both sides."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.loops.numerics.delayed_loop import margins_of
from teleop_drake.loops.numerics.state_space import state_space

DELAYS = (0.3, 0.7)


def random_system(seed, gain):
    """Returns a system with one signal at the cut and two delayed signals."""
    random = np.random.default_rng(seed)
    A = random.normal(size=(4, 4))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(4)
    B = gain * random.normal(size=(4, 3))
    C = random.normal(size=(3, 4))
    D = np.zeros((3, 3))
    D[0, 1] = 0.3
    return replace(state_space(A, B, C, D), delays=DELAYS)


def rightmost_root(system, more_delay=0.0, gain=1.0):
    """Returns the largest real part of all roots with a delay and a gain at the cut."""
    gains = [gain, 1.0, 1.0]
    matrix = system.matrix * ([1.0] * system.num_states + gains)
    loop = replace(system, matrix=matrix)
    if more_delay == 0:
        loop = loop.closed([0])
    else:
        loop = replace(loop, delays=(more_delay, *DELAYS))
    return characteristic_roots(loop, count=2)[0].real


@pytest.mark.mostly_slow
@pytest.mark.parametrize("seed", range(12))
def test_a_root_passes_the_axis_at_the_margins(seed):
    system = random_system(seed, gain=0.6)
    margins = margins_of(-system)
    assert margins.is_stable == (rightmost_root(system) < 0)
    if not margins.is_stable:
        assert (margins.delay, margins.phase, margins.gain) == (0.0, 0.0, (1.0, 1.0))
        for gain in np.geomspace(0.011, 93.0, 12):
            inside = [low < gain < high for low, high in margins.stable_gains]
            assert any(inside) == (rightmost_root(system, gain=gain) < 0)
        for delay in np.linspace(0.1, 3.0, 8):
            inside = [low < delay < high for low, high in margins.stable_delays]
            assert any(inside) == (rightmost_root(system, delay) < 0)
        return
    for delay in np.linspace(0.02, min(0.98 * margins.delay, 10.0), 5):
        assert rightmost_root(system, delay) < 0
    if margins.delay < math.inf:
        assert rightmost_root(system, 1.02 * margins.delay) > 0
    low, high = margins.gain
    for gain in (max(1.02 * low, 0.01), min(0.98 * high, 100.0)):
        assert rightmost_root(system, gain=gain) < 0
    for gain in (0.98 * low, 1.02 * high):
        if 0 < gain < math.inf:
            assert rightmost_root(system, gain=gain) > 0


def test_the_random_loops_are_of_all_sorts():
    found = [
        margins_of(-random_system(seed, gain=0.6), remedies=False) for seed in range(12)
    ]
    assert any(not margins.is_stable for margins in found)
    assert any(0 < margins.delay < math.inf for margins in found)
    assert any(margins.delay == math.inf for margins in found)


def test_two_delays_of_collocation_satisfy_the_equation():
    """s = -a e^(-s T1) - b e^(-s T2)."""
    a = 1.3
    b = 0.9
    loop = state_space(
        A=[[0.0]],
        B=[[-a, -b]],
        C=[[1.0], [1.0]],
        D=np.zeros((2, 2)),
    )
    loop = replace(loop, delays=DELAYS)
    roots = characteristic_roots(loop, count=6)
    assert len(roots) >= 6
    s = roots[:, np.newaxis]
    rest = s + np.exp(-s * np.array(DELAYS)) @ [[a], [b]]
    assert_allclose(np.abs(rest), 0, atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 1e-3])
@pytest.mark.parametrize("seed", range(10))
def test_the_margins_of_axes_that_a_rotation_couples(seed, scale):
    """L = M/(s (s + 1) (s + 2)), where M has the eigenvalues a + j b and a - j b.

    Both have the same magnitude, with rounding errors that grow as the coordinates of
    the axes differ in scale. Each obeys an equation of its own.
    """
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.3, 2.0), rng.uniform(0.1, 0.6)
    basis = np.linalg.qr(rng.normal(size=(2, 2)))[0] @ np.diag([1.0, scale])
    basis = basis @ np.linalg.qr(rng.normal(size=(2, 2)))[0]
    M = basis @ np.array([[a, b], [-b, a]]) @ np.linalg.inv(basis)
    axis = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -2.0, -3.0]])
    A = np.kron(np.eye(2), axis)
    B = np.kron(np.eye(2), [[0.0], [0.0], [1.0]])
    C = np.kron(M, [[1.0, 0.0, 0.0]])
    margins = margins_of(state_space(A, B, C, np.zeros((2, 2))))
    # k (a - j b) = -j w (1 + j w) (2 + j w) at the smallest gain.
    w = (math.sqrt(9 * b**2 + 8 * a**2) - 3 * b) / (2 * a)
    assert_allclose(margins.gain, [0.0, 3 * w**2 / a], rtol=1e-6)
    # w^2 (1 + w^2) (4 + w^2) = a^2 + b^2 where both cross.
    squares = np.roots([1.0, 5.0, 4.0, -(a**2) - b**2])
    w = math.sqrt(squares[np.isreal(squares)].real.max())
    locus = (a - 1j * b) / (1j * w * (1 + 1j * w) * (2 + 1j * w))
    assert margins.delay == pytest.approx((np.angle(locus) + math.pi) / w, rel=1e-6)
