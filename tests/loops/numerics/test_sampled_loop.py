"""Sampled loops against recurrences that are derived by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.loops.numerics.sample_schedule import Clock, common_period
from teleop_drake.loops.numerics.sampled_loop import ContinuousDelayLoop, SampledLoop
from teleop_drake.loops.numerics.sampled_margins import (
    sampled_margins,
    sampled_response,
)

H = 0.1
K = 3.0


def check_roots(loop, expected):
    """Checks the roots of a loop; further roots at 0 are those of histories."""
    found = sorted(loop.roots(), key=abs, reverse=True)
    expected = sorted(np.roots(expected), key=abs, reverse=True)
    assert_allclose(
        np.sort_complex(found[: len(expected)]), np.sort_complex(expected), atol=1e-12
    )
    assert np.abs(found[len(expected) :]).max(initial=0.0) < 1e-6


def test_a_hold_before_an_integrator():
    """x' = q, q = -K x(k h): z = 1 - K h."""
    loop = SampledLoop(
        matrix=np.array([[0.0, 1.0], [-K, 0.0]]), num_states=1, clocks=(Clock(H),)
    )
    check_roots(loop, [1, K * H - 1])


@pytest.mark.parametrize("share", [0.0, 0.37, 0.999])
def test_a_held_signal_that_arrives_late(share):
    """x' = q(t - T): z^2 = z - K ((h - T) z + T)."""
    late = share * H
    # The rows and columns are those of x, q and the delay.
    matrix = np.array([[0, 0, 1], [-K, 0, 0], [0, 1, 0]], float)
    loop = SampledLoop(matrix=matrix, num_states=1, clocks=(Clock(H),), delays=(late,))
    check_roots(loop, [1, K * (H - late) - 1, K * late])


def test_a_measurement_that_arrives_late():
    """q_k = -K (x_k-1 + (h - T) q_k-1); the copy x(t - T) adds no root."""
    late = 0.4 * H
    matrix = np.array([[0, 1, 0], [0, 0, -K], [1, 0, 0]], float)
    loop = SampledLoop(matrix=matrix, num_states=1, clocks=(Clock(H),), delays=(late,))
    # The state is [x_k, x_k-1, q_k-1].
    step = np.array([[1 + 0, -H * K, -H * K * (H - late)], [1, 0, 0], [0, 0, 0]])
    step[2] = [0, -K, -K * (H - late)]
    check_roots(loop, np.poly(step))


def test_a_measurement_that_arrives_with_an_update_is_seen_by_it():
    """q_k = -K q'_k-1 with a delay of h, where q' samples x: z^2 - z + K h = 0."""
    matrix = np.zeros((4, 4))
    matrix[0, 1] = 1.0  # x' = q
    matrix[1, 3] = -K  # q+ = -K d
    matrix[2, 0] = 1.0  # q'+ = x
    matrix[3, 2] = 1.0  # e = q'
    clocks = (Clock(H), Clock(H))
    loop = SampledLoop(matrix=matrix, num_states=1, clocks=clocks, delays=(H,))
    check_roots(loop, [1, -1, K * H])


def test_two_rates():
    """A hold of h reads a sample of 2 h, which is taken with every second update."""
    matrix = np.array([[0, 1, 0], [0, 0, -K], [1, 0, 0]], float)
    clocks = (Clock(H), Clock(2 * H))
    loop = SampledLoop(matrix=matrix, num_states=1, clocks=clocks)
    check_roots(loop, np.poly(np.array([[1 - H * K, -H * K], [1, 0]])))


def test_updates_with_an_offset():
    """The sample is taken at 0.3 h and used at h: q_k = -K (x_k-1 + 0.3 h q_k-1)."""
    matrix = np.array([[0, 1, 0], [0, 0, -K], [1, 0, 0]], float)
    clocks = (Clock(H), Clock(H, 0.3 * H))
    loop = SampledLoop(matrix=matrix, num_states=1, clocks=clocks)
    step = np.array([[1, H], [-K, -K * 0.3 * H]])
    check_roots(loop, np.poly(step))


def third_order(late=0.0):
    """Returns 2/(s (s + 1)(s + 2)) behind a hold of 0.05 s, cut at the hold's input."""
    A, B, C, _ = signal.tf2ss([2.0], [1.0, 3.0, 2.0, 0.0])
    # The rows and columns are those of x, q, the delay and the port.
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = A
    matrix[:3, 3:4] = B
    matrix[3, 5] = 1.0
    matrix[4, :3] = -C[0]
    matrix[5, 4] = 1.0
    return SampledLoop(
        matrix=matrix, num_states=3, clocks=(Clock(0.05),), delays=(late,)
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize(("late", "gain"), [(0.0, 2.792786), (0.37 * 0.05, 2.658288)])
def test_margins_of_a_loop_of_third_order(late, gain):
    margins = sampled_margins(third_order(late))
    assert margins.is_stable
    assert margins.gain == (0.0, pytest.approx(gain, abs=1e-6))
    if late == 0:
        plant = [2.0], [1.0, 3.0, 2.0, 0.0]
        numerator, denominator, _ = signal.cont2discrete(plant, 0.05)
        z = np.exp(0.05j * margins.gain_frequencies[1])
        L = np.polyval(numerator.ravel(), z) / np.polyval(denominator, z)
        assert gain * L == pytest.approx(-1.0, abs=1e-5)
    # A delay before the hold and one behind the plant add up.
    assert margins.delay + late == pytest.approx(14.69307 * 0.05, abs=1e-6)


def test_the_response_is_that_of_the_discretised_plant():
    w = np.array([0.5, 3.0, 20.0, np.pi / 0.05])
    plant = signal.tf2ss([2.0], [1.0, 3.0, 2.0, 0.0])
    A, B, C, _, _ = signal.cont2discrete(plant, 0.05)
    z = np.exp(1j * 0.05 * w)
    expected = [-(C @ np.linalg.solve(x * np.eye(3) - A, B))[0, 0] for x in z]
    found = sampled_response(third_order(), [0], w)[:, 0, 0]
    assert_allclose(found, expected, atol=1e-12)
    # The magnitude is 1 where the phase margin is measured.
    margins = sampled_margins(third_order())
    assert np.degrees(margins.phase) == pytest.approx(31.5416, abs=1e-4)


def test_an_unstable_loop_has_no_margins():
    loop = third_order()
    matrix = loop.matrix.copy()
    matrix[3, 5] = 3.0
    strong = SampledLoop(
        matrix=matrix, num_states=3, clocks=loop.clocks, delays=loop.delays
    )
    margins = sampled_margins(strong)
    assert not margins.is_stable
    assert margins.gain == (1.0, 1.0)
    ((low, high),) = margins.stable_gains
    assert (low, 3.0 * high) == (0.0, pytest.approx(2.792786, abs=1e-6))
    assert margins.stable_delays == ()
    assert sampled_margins(strong, remedies=False).stable_gains == ()


def test_a_delay_in_a_loop_without_a_hold_is_refused():
    matrix = np.array([[0, 1, -1], [0, 0, 0], [1, 0, 0]], float)
    loop = SampledLoop(matrix=matrix, num_states=1, clocks=(Clock(H),), delays=(0.02,))
    with pytest.raises(ContinuousDelayLoop, match=r"delays = 0.02 \(s\): must not be"):
        loop.roots()


@pytest.mark.parametrize(
    ("periods", "common"), [((0.1,), 0.1), ((0.02, 0.03), 0.06), ((0.1, 0.25), 0.5)]
)
def test_a_common_period(periods, common):
    clocks = [Clock(period) for period in periods]
    assert common_period(clocks) == pytest.approx(common, rel=1e-12)


@pytest.mark.parametrize("other", [np.sqrt(2) / 10, 0.1 * 1001 / 1000])
def test_periods_without_a_common_one_are_refused(other):
    with pytest.raises(ScenarioError, match=r"periods = .*: must be"):
        common_period([Clock(0.1), Clock(other)])
