"""Delay margins against published examples and closed forms, with derivations."""

import math

import numpy as np
import pytest
from delayed_systems import Retarded, Scalar
from grids import Slow
from numpy.testing import assert_allclose
from scipy.linalg import eigvals

from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.loops.numerics.state_space import state_space
from teleop_drake.study.numerics import delay_margin as numerics
from teleop_drake.study.numerics.delay_margin import (
    find_crossings,
    is_delay_robust,
    neutral_root_count,
)


def delay_margin(loop):
    return numerics.delay_margin(loop, find_crossings(loop))


def stable_delays(loop, max_delay):
    return numerics.stable_delays(loop, max_delay, find_crossings(loop))


def unstable_roots(loop, max_delay):
    return numerics.unstable_roots(loop, max_delay, find_crossings(loop))


@pytest.mark.parametrize(("a", "b"), [(0.0, 1.0), (0.5, 1.0), (-0.5, 1.0), (3.0, 4.0)])
def test_first_order(a, b):
    """dx/dt = -a x - b x(t - T): j w + a = -b e^(-j w T), so w^2 = b^2 - a^2 and
    cos w T = -a/b.

    N. D. Hayes, "Roots of the transcendental equation associated with a certain
    difference-differential equation", J. London Math. Soc. s1-25 (1950).
    """
    margin = delay_margin(Retarded([[-a]], [[-b]]))
    assert margin.frequency == pytest.approx(math.sqrt(b**2 - a**2), rel=1e-12)
    assert margin.phase_margin == pytest.approx(math.acos(-a / b), rel=1e-12)
    assert margin.delay == pytest.approx(margin.phase_margin / margin.frequency)


def test_oscillator_with_delayed_positive_feedback():
    """s^2 + w0^2 = k e^(-s T): stable for
    2 pi i/sqrt(w0^2 - k) < T < (2 i + 1) pi/sqrt(w0^2 + k).

    C. Abdallah, P. Dorato, J. Benitez-Read and R. Byrne, "Delayed positive feedback
    can stabilize oscillatory systems", Proc. American Control Conference (1993). On the
    axis e^(-j w T) must be real, so it is 1 or -1. Without delay the roots are on the
    axis.
    """
    loop = Scalar([-0.1], [1, 0, 1])
    expected = []
    for i in range(20):
        begin = 2 * math.pi * i / math.sqrt(1 - 0.1)
        end = (2 * i + 1) * math.pi / math.sqrt(1 + 0.1)
        if begin < end:
            expected.append((begin, end))
    assert len(expected) == 5
    found = stable_delays(loop, 200.0)
    assert_allclose(found, expected, rtol=1e-10)


def CookeGrossman(a, c, d):
    """Returns the switches of s^2 + a s + c + d e^(-s T), in closed form.

    K. L. Cooke and Z. Grossman, "Discrete delay, distributed delay and stability
    switches", J. Math. Anal. Appl. 86 (1982): w^4 + (a^2 - 2 c) w^2 + c^2 - d^2 = 0
    has two positive roots; the larger one destabilises, the smaller one stabilises.
    """
    p = a**2 - 2 * c
    q = c**2 - d**2
    root = math.sqrt(p**2 - 4 * q)
    switches = []
    for w2, direction in (((-p + root) / 2, 1), ((-p - root) / 2, -1)):
        w = math.sqrt(w2)
        # e^(-j w T) = (w^2 - c - j a w)/d
        phase = math.atan2(a * w / d, (w2 - c) / d) % (2 * math.pi)
        switches.append((w, phase / w, direction))
    return switches


def test_windows_reopen_finitely_often():
    a = 0.2
    c = 1.0
    d = 0.6
    loop = Scalar([d], [1, a, c])
    (w1, T1, _), (w2, T2, _) = CookeGrossman(a, c, d)
    crossings = find_crossings(loop)
    assert [(x.frequency, x.delay, x.direction) for x in crossings] == [
        pytest.approx((w2, T2, -1), rel=1e-11),
        pytest.approx((w1, T1, 1), rel=1e-11),
    ]
    # A pair crosses again after 2 pi/w.
    expected = [(0.0, T1), (T2, T1 + 2 * math.pi / w1)]
    assert_allclose(stable_delays(loop, 60.0), expected, rtol=1e-10)


def test_number_of_unstable_roots_is_what_collocation_finds():
    loop = Scalar([0.6], [1, 0.2, 1.0])
    delays, counts = unstable_roots(loop, 30.0)
    assert counts.max() >= 4
    for begin, end, count in zip(delays, [*delays[1:], 30.0], counts, strict=True):
        roots = characteristic_roots(loop.fed_back((begin + end) / 2), count=12)
        assert np.sum(roots.real > 0) == count


def KroneckerFrequencies(A0, A1):
    """Returns the crossing frequencies of A0 and A1, computed without a sweep.

    J. Chen, G. Gu and C. N. Nett (1995): where j w is an eigenvalue of A0 + z A1 with
    |z| = 1, the Kronecker sum of this matrix and its conjugate is singular. This is a
    quadratic eigenvalue problem in z.
    """
    A0 = np.array(A0, dtype=float)
    A1 = np.array(A1, dtype=float)
    n = len(A0)
    identity = np.eye(n)
    Q2 = np.kron(A1, identity)
    Q1 = np.kron(A0, identity) + np.kron(identity, A0)
    Q0 = np.kron(identity, A1)
    zero = np.zeros((n * n, n * n))
    one = np.eye(n * n)
    z = eigvals(
        np.block([[zero, one], [-Q0, -Q1]]), np.block([[one, zero], [zero, Q2]])
    )
    frequencies = []
    for value in z[np.isfinite(z)]:
        if abs(abs(value) - 1) < 1e-6:
            s = np.linalg.eigvals(A0 + A1 * value)
            frequencies += [x.imag for x in s if abs(x.real) < 1e-5 and x.imag > 1e-3]
    return np.unique(np.round(frequencies, 6))


@pytest.mark.parametrize("seed", Slow(range(12), but=[0, 1]))
def test_matrix_pencil_finds_the_same_frequencies(seed):
    """Random coupled systems with 4 states and 2 delayed signals."""
    random = np.random.default_rng(seed)
    A0 = random.normal(size=(4, 4)) - 1.5 * np.eye(4)
    A1 = random.normal(size=(4, 2)) @ random.normal(size=(2, 4))
    crossings = find_crossings(Retarded(A0, A1))
    assert_allclose(
        [c.frequency for c in crossings], KroneckerFrequencies(A0, A1), rtol=1e-5
    )
    # At each crossing's delay there is a root on the axis.
    loop = Retarded(A0, A1)
    for crossing in crossings:
        roots = characteristic_roots(loop.fed_back(crossing.delay), count=40)
        assert np.min(np.abs(roots - 1j * crossing.frequency)) < 1e-6


def test_identical_axes_cross_twice():
    one = Scalar([2.0], [1, 1, 0.5])
    two = state_space(
        **{name: np.kron(np.eye(2), getattr(one, name)) for name in "ABCD"}
    )
    (crossing,) = find_crossings(one)
    for each in find_crossings(two):
        assert each.frequency == pytest.approx(crossing.frequency, rel=1e-14)
        assert each.delay == pytest.approx(crossing.delay, rel=1e-14)
        assert each.direction == crossing.direction
    assert len(find_crossings(two)) == 2
    both = stable_delays(two, 9.0), stable_delays(one, 9.0)
    assert_allclose(*both, rtol=1e-14)


def test_feedthrough():
    """L = b + c/s: roots of s (1 + b z) + c z, a neutral equation.

    Stability at any delay requires |b| < 1. |L| = 1 at w = c/sqrt(1 - b^2), where
    arg L = -atan(c/(w b)).
    """
    b = 0.5
    c = 1.0
    loop = state_space(A=[[0.0]], B=[[1.0]], C=[[c]], D=[[b]])
    assert is_delay_robust(loop)
    w = c / math.sqrt(1 - b**2)
    margin = delay_margin(loop)
    assert margin.frequency == pytest.approx(w, rel=1e-11)
    assert margin.delay == pytest.approx((math.pi - math.atan2(c, w * b)) / w, 1e-11)
    for b in (1.0, -1.2):
        loop = state_space(A=[[-1.0]], B=[[1.0]], C=[[c]], D=[[b]])
        assert not is_delay_robust(loop)
        assert stable_delays(loop, 1.0) == []


def test_neutral_root():
    """s + 1 - e^(-s T) has the root 0 at every T, and otherwise stable roots.

    There is no root with Re s > 0, where |s + 1| > 1 > |e^(-s T)|.
    """
    loop = Scalar([-1.0], [1, 1])
    assert neutral_root_count(loop) == 1
    assert find_crossings(loop) == []
    assert stable_delays(loop, 5.0) == [(0.0, 5.0)]


def test_root_that_passes_a_neutral_one():
    """s - 1 + e^(-s T) = s (1 - T + s T^2/2 - ...): at T = 1 a real root passes 0."""
    loop = Scalar([1.0], [1, -1])
    (crossing,) = find_crossings(loop)
    assert (crossing.frequency, crossing.direction) == (0.0, 1)
    assert crossing.delay == pytest.approx(1.0, rel=1e-10)
    assert delay_margin(loop) == crossing
    assert stable_delays(loop, 5.0) == [(0.0, crossing.delay)]
    for T in (0.5, 2.0):
        roots = characteristic_roots(loop.fed_back(T))
        others = roots[np.abs(roots) > 1e-9]
        assert (others.real.max() > 0) == (T > 1)


def test_roots_that_pass_two_neutral_ones():
    """Two independent loops as above, whose roots pass 0 at T = 1 and T = 1/2."""
    loop = state_space(
        A=np.diag([1.0, 2.0]), B=np.eye(2), C=np.diag([1.0, 2.0]), D=np.zeros((2, 2))
    )
    assert neutral_root_count(loop) == 2
    passages = find_crossings(loop)
    assert sorted(x.delay for x in passages) == pytest.approx([0.5, 1.0], rel=1e-9)
    assert unstable_roots(loop, 2.0)[1].tolist() == [0, 1, 2]


@pytest.mark.mostly_slow
@pytest.mark.parametrize(("c", "direction"), [(0.1, -1), (-0.1, 1)])
def test_root_that_leaves_the_neutral_one_with_the_delay(c, direction):
    """s^2 + c (1 - e^(-s T)) = s [s + c T - ...] has a double root 0 at T = 0.

    With growing T, one root stays at 0 and the other one moves to -c T.
    """
    loop = Scalar([-c], [1, 0, c])
    delays, counts = unstable_roots(loop, 0.5)
    passage = find_crossings(loop)[0]
    assert (passage.frequency, passage.delay) == (0.0, 0.0)
    assert passage.direction == direction
    assert counts[0] == (direction > 0)
    roots = characteristic_roots(loop.fed_back(0.3), count=6)
    slow = roots[(np.abs(roots) < 0.1) & (np.abs(roots) > 1e-7)]
    assert len(slow) == 1
    assert slow[0].real == pytest.approx(-0.3 * c, rel=0.05)
    assert len(delays) == len(counts)


def test_open_loop():
    loop = state_space(
        A=np.zeros((0, 0)), B=np.zeros((0, 0)), C=np.zeros((0, 0)), D=np.zeros((0, 0))
    )
    assert find_crossings(loop) == []
    assert stable_delays(loop, 1.0) == [(0.0, 1.0)]
