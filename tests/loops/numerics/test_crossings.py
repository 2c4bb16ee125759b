"""Crossings of the unit circle that a sweep of the frequency could overlook."""

import math

import numpy as np
import pytest
from delayed_systems import Scalar
from numpy.testing import assert_allclose

from teleop_drake.loops.numerics.crossings import crossings_between, sweep_frequencies
from teleop_drake.loops.numerics.state_space import state_space


def find_crossings(loop):
    """Returns the crossings of a loop without neutral roots, by frequency."""
    found = crossings_between(loop, sweep_frequencies(loop))
    return sorted(found, key=lambda crossing: crossing.frequency)


def test_narrow_resonance_is_not_overlooked():
    """|L| exceeds 1 only in an interval of 1e-6 of its frequency."""
    zeta = 1e-7
    loop = Scalar([3e-7, 0.0], [1, 2 * zeta, 1])
    crossings = find_crossings(loop)
    # |j w g/(1 - w^2 + 2 j zeta w)| = 1: (1 - w^2)^2 = w^2 (g^2 - 4 zeta^2)
    g = math.sqrt(9e-14 - 4 * zeta**2)
    expected = [(math.sqrt(g**2 + 4) - g) / 2, (math.sqrt(g**2 + 4) + g) / 2]
    assert [c.frequency for c in crossings] == [
        pytest.approx(x, rel=1e-12) for x in expected
    ]
    assert [c.direction for c in crossings] == [-1, 1]


def test_flat_top_between_two_points_of_the_sweep():
    """|L| just exceeds 1 between two neighbouring points of the sweep."""
    a = 0.6
    # |1/(s^2 + a s + 1)| peaks at w^2 = 1 - a^2/2 with 1/(a sqrt(1 - a^2/4)).
    peak = 1 / (a * math.sqrt(1 - a**2 / 4))
    for share, num_crossings in ((1 + 1e-9, 2), (1 - 1e-9, 0)):
        crossings = find_crossings(Scalar([share / peak], [1, a, 1]))
        assert len(crossings) == num_crossings


@pytest.mark.parametrize("num_axes", [2, 4])
@pytest.mark.parametrize("seed", range(20))
def test_axes_that_a_rotation_couples_cross_at_one_frequency(seed, num_axes):
    """L = M/s, where M has pairs of eigenvalues a + j b and a - j b.

    Both have the same magnitude at all frequencies, and cross at w = |a + j b|, each at
    its own delay.
    """
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.3, 2.0, 2)
    rotation = np.kron(np.eye(num_axes // 2), [[a, b], [-b, a]])
    basis = rng.normal(size=rotation.shape)
    M = basis @ rotation @ np.linalg.inv(basis)
    nothing = np.zeros_like(M)
    found = find_crossings(state_space(nothing, np.eye(num_axes), M, nothing))
    w = math.hypot(a, b)
    assert_allclose([x.frequency for x in found], [w] * num_axes, rtol=1e-9)
    # (a +- j b)/(j w) e^(-j w T) = -1
    turns = math.pi / 2 + np.array([-1.0, 1.0]) * math.atan2(b, a)
    delays = np.repeat(turns, num_axes // 2) / w
    assert_allclose(sorted(x.delay for x in found), delays, rtol=1e-7)
