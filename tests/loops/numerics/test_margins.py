"""What would stabilise an unstable loop, against closed forms and collocation."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.loops.numerics.delayed_loop import changed, margins_of
from teleop_drake.loops.numerics.margins import Margins
from teleop_drake.loops.numerics.state_space import StateSpace, state_space


def late_loop(A, B, C, delay, D=0.0):
    """Returns L of the plant C (s - A)^-1 B + D, whose input is late."""
    n = len(A)
    matrix = np.zeros((n + 2, n + 2))
    matrix[:n, :n] = A
    matrix[:n, n + 1] = np.ravel(B)
    matrix[n, :n] = np.ravel(C)
    matrix[n, n + 1] = D
    matrix[n + 1, n] = 1.0
    return StateSpace(matrix=matrix, num_states=n, delays=(delay,))


def growth(loop, gain=1.0, delay=0.0):
    """Returns the real part of the rightmost root, 1/s."""
    return characteristic_roots(changed(loop, gain=gain, delay=delay))[0].real


def assert_bounds(loop, windows, name):
    """Asserts that the loop is stable inside of each window, and not outside."""
    for window in windows:
        for end in window:
            if end == 0 or math.isinf(end):
                continue
            step = 0.01 * abs(end) * (1 if end == window[0] else -1)
            assert growth(loop, **{name: end + step}) < 0
            assert growth(loop, **{name: end - step}) > 0


@pytest.mark.parametrize("k", [0.6, 30.0])
def test_an_unstable_plant_needs_a_gain_between_two(k):
    """x' = x - k x(t - T): between k = 1 and k^2 = 1 + w^2, tan(w T) = w."""
    T = 0.3
    loop = late_loop([[1.0]], [1.0], [k], T)
    w = brentq(lambda w: math.tan(w * T) - w, 1.0, 1.5 / T)
    margins = margins_of(loop)
    ((low, high),) = margins.stable_gains
    assert k * low == pytest.approx(1.0, rel=1e-6)
    assert k * high == pytest.approx(math.hypot(1.0, w), rel=1e-8)
    assert_bounds(loop, margins.stable_gains, "gain")
    # More delay never helps here.
    assert not margins.is_stable and margins.stable_delays == ()
    assert margins.remedy == f"stable with {low:.4g} to {high:.4g} times the gain"


def test_a_loop_with_the_wrong_sign_says_so():
    """x' = 2 x(t - T) is stable for gains from -pi/(4 T) to 0."""
    loop = late_loop([[0.0]], [1.0], [-2.0], 0.3)
    margins = margins_of(loop)
    limit = math.pi / 4 / 0.3
    assert margins.stable_gains == ((pytest.approx(-limit, rel=1e-9), 0.0),)
    assert_bounds(loop, margins.stable_gains, "gain")
    words = f"stable with the sign reversed and less than {limit:.4g} times the gain"
    assert str(margins) == f"unstable; {words}"


@pytest.mark.mostly_slow
@pytest.mark.parametrize("inner", [0.0, 0.1])
def test_delays_stabilise_an_oscillator(inner):
    """x'' - a x' + x = k x(t - T), with |L| = 1 where (1 - w^2)^2 + a^2 w^2 = k^2.

    The pair of roots leaves the right side at the lower w and returns at the upper one.
    """
    a = 0.05
    k = 0.3
    A = [[0.0, 1.0], [-1.0, a]]
    loop = late_loop(A, [0.0, 1.0], [-k, 0.0], inner)
    if inner == 0:
        loop = state_space(A, [[0.0], [1.0]], [[-k, 0.0]], [[0.0]])
    squares = np.sort(np.roots([1.0, a**2 - 2.0, 1.0 - k**2]))
    w = np.sqrt(squares.real)
    # e^(-j w T) = (1 - w^2 - j a w)/k at total delays T + 2 pi i/w.
    first = -np.angle((1 - w**2 - 1j * a * w) / k) % (2 * np.pi) / w
    expected = []
    for i in range(20):
        leaves, returns = first + 2 * np.pi * i / w
        if leaves < returns and (not expected or leaves > expected[-1][1]):
            expected.append((leaves - inner, returns - inner))
    margins = margins_of(loop)
    assert len(expected) > 1
    assert_allclose(margins.stable_delays, expected, rtol=1e-8)
    assert_bounds(loop, margins.stable_delays[:1], "delay")


def test_nothing_helps_a_hidden_unstable_mode_or_two_unstable_poles():
    for A, C in (
        (np.diag([1.0, -1.0]), [0.0, 1.0]),
        ([[1.0, 1.0], [0.0, 1.0]], [1.0, 0.0]),
    ):
        margins = margins_of(state_space(A, [[0.0], [1.0]], [C], [[0.0]]))
        assert not margins.is_stable
        assert margins.remedy.startswith("no gain up to 100 times")


@pytest.mark.mostly_slow
@pytest.mark.parametrize("D", [0.5, 1.5])
def test_a_neutral_loop_is_told_apart(D):
    """1/(s + 1) + D behind 0.3 s: the fast roots tend to Re s = ln(D)/T."""
    loop = late_loop([[-1.0]], [1.0], [1.0], 0.3, D)
    margins = margins_of(loop)
    # The signal passes the delay of the loop and the additional one.
    assert margins.gain_at_once == pytest.approx(math.sqrt(D))
    assert margins.is_stable == (D < 1)
    assert f"without dynamics, by a gain of {math.sqrt(D):.3g}" in str(margins)
    roots = characteristic_roots(changed(loop), count=30)
    fast = roots[np.abs(roots) > 50.0].real
    assert len(fast) > 10
    assert fast == pytest.approx(np.full(len(fast), math.log(D) / 0.3), abs=0.05)
    if D > 1:
        ((low, high),) = margins.stable_gains
        assert low == 0.0 and high < 1 / D
        assert growth(loop, 0.99 * high) < 0
        assert margins.stable_delays == ()
    retarded = margins_of(late_loop([[-1.0]], [1.0], [1.0], 0.3))
    assert retarded.gain_at_once == 0.0 and "neutral" not in str(retarded)


def test_margins_in_words():
    margins = Margins(
        is_stable=True, delay=0.25, frequency=3.0, phase=0.5, gain=(0.0, 4.0)
    )
    assert str(margins) == (
        "stable up to 0.25 s of additional delay (3 rad/s) and 28.65 degrees of phase, "
        "with less than 4 times the gain"
    )
