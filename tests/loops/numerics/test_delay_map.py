"""The delay map of networks, against closed forms, single loops and their roots."""

import math
from dataclasses import replace

import numpy as np
import pytest

from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.loops.numerics.delay_map import delay_margins
from teleop_drake.loops.numerics.delayed_loop import gain_at_once, margins_of
from teleop_drake.loops.numerics.state_space import (
    StateSpace,
    close_loops,
    state_space,
    strong_parts,
)


def wires(*rows):
    return np.array(rows)


def network(matrix, num_states, delays=()):
    return StateSpace(matrix=matrix, num_states=num_states, delays=delays)


def test_a_branch_is_not_its_port():
    """dx/dt = w0, dv/dt = -kd w1 - kp w2; v is sent into w0 and w1, x into w2."""
    kp = 4.0
    kd = 2.0
    M = np.zeros((5, 5))
    M[0, 2] = 1.0
    M[1, 3:] = -kd, -kp
    M[2:, :2] = [0, 1], [0, 1], [1, 0]
    bundles = [wires([0]), wires([1]), wires([2]), wires([0], [1])]
    into_x, into_kd, into_kp, port = delay_margins(network(M, 2), bundles)
    # w1 late: kp - w^2 + j w kd e^(-j w T) = 0, so w^2 - kd w - kp = 0 and w T = pi/2.
    w = (kd + math.sqrt(kd**2 + 4 * kp)) / 2
    assert into_kd == pytest.approx(math.pi / 2 / w, rel=1e-9)
    # x or v -> x late: s (s + kd) + kp e^(-s T) = 0.
    w = math.sqrt((-(kd**2) + math.sqrt(kd**4 + 4 * kp**2)) / 2)
    assert into_x == pytest.approx(math.atan2(kd, w) / w, rel=1e-9)
    assert into_kp == pytest.approx(into_x, rel=1e-12)
    # Both: s^2 + (kd s + kp) e^(-s T) = 0.
    w = math.sqrt((kd**2 + math.sqrt(kd**4 + 4 * kp**2)) / 2)
    assert port == pytest.approx(math.atan2(kd * w, kp) / w, rel=1e-9)


def test_a_wire_of_two_axes_has_the_smaller_margin():
    """Two separate integrators with the gains 1 and 3, whose states share a wire."""
    M = np.zeros((4, 4))
    M[:2, 2:] = -np.diag([1.0, 3.0])
    M[2:, :2] = np.eye(2)
    both, first = delay_margins(network(M, 2), [wires([0, 1]), wires([0])])
    assert both == pytest.approx(math.pi / 6, rel=1e-9)
    assert first == pytest.approx(math.pi / 2, rel=1e-9)
    assert len(strong_parts(M)) == 2


def test_a_wire_of_coupled_axes():
    """dz/dt = -(1 + j c) z(t - T): two axes that turn. Poles meet the axis at j w."""
    c = 0.5
    M = np.zeros((4, 4))
    M[:2, 2:] = -np.array([[1.0, -c], [c, 1.0]])
    M[2:, :2] = np.eye(2)
    (margin,) = delay_margins(network(M, 2), [wires([0, 1])])
    # s + (1 + j c) e^(-s T) = 0: w = |1 + j c|, and w T = pi/2 - atan(c).
    expected = (math.pi / 2 - math.atan(c)) / math.hypot(1, c)
    assert margin == pytest.approx(expected, rel=1e-9)


def test_a_wire_outside_of_loops_is_infinite_and_an_unstable_network_has_no_margin():
    """dx/dt = a x + w0; w1 takes x to an output without effect."""
    M = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    bundles = [wires([0]), wires([1])]
    into, out = delay_margins(network(M, 1), bundles)
    assert into == pytest.approx(math.pi / 2, rel=1e-9)
    assert out == math.inf
    assert delay_margins(network(M + np.diag([2.0, 0, 0]), 1), bundles) is None
    # An unstable mode in no loop with a wire counts, too.
    alone = np.zeros((4, 4))
    alone[:3, :3] = M
    alone[3, 3] = 0.1
    alone = alone[np.ix_([3, 0, 1, 2], [3, 0, 1, 2])]
    assert delay_margins(network(alone, 2), bundles) is None


def test_a_real_root_that_passes_through_0():
    """dx/dt = x - x(t - T) has a neutral root; another one is positive for T > 1."""
    M = np.array([[1.0, -1.0], [1.0, 0.0]])
    assert delay_margins(network(M, 1), [wires([0])]) == pytest.approx([1.0], rel=1e-9)
    L = state_space([[1.0]], [[1.0]], [[1.0]], [[0.0]])
    margins = margins_of(L)
    assert margins.is_stable
    assert margins.delay == pytest.approx(1.0, rel=1e-9)
    assert margins.frequency == 0.0
    late = replace(-L, delays=(1.03,))
    assert characteristic_roots(late, count=1)[0].real > 1e-3


def random_network(seed, delays=(0.3, 0.7)):
    """Returns a random network of four states, three wires and two delays."""
    random = np.random.default_rng(seed)
    M = 0.8 * random.normal(size=(9, 9)) * (random.random((9, 9)) < 0.7)
    M[:4, :4] -= (np.linalg.eigvals(M[:4, :4]).real.max() + 0.3) * np.eye(4)
    # Each wire closes a loop around one of the first states.
    M[np.arange(3), 4 + np.arange(3)] -= 2.0
    M[4 + np.arange(3), np.arange(3)] += 1.5
    # Wires do not act on wires at once, and the last delay has feedthrough.
    M[4:, 4:] = 0.0
    M[7:, 7:] = [[0.0, 0.4], [0.5, 0.0]]
    return network(M, 4, delays)


def rightmost(net, wire, more_delay):
    """Returns the largest real part of the roots with a late wire."""
    n = net.num_states
    others = np.delete(n + np.arange(3), wire)
    matrix = close_loops(net.matrix, others)
    matrix = np.delete(np.delete(matrix, others, axis=0), others, axis=1)
    late = network(matrix, n, (more_delay, *net.delays))
    return characteristic_roots(late, count=2)[0].real


@pytest.mark.mostly_slow
@pytest.mark.parametrize("seed", range(12))
def test_random_networks_pass_the_axis_at_the_margins(seed):
    net = random_network(seed)
    margins = delay_margins(net, [wires([i]) for i in range(3)])
    if margins is None:
        assert max(rightmost(net, i, 1e-6) for i in range(3)) > 0
        return
    for i, margin in enumerate(margins):
        for delay in np.linspace(0.02, min(0.98 * margin, 3.0), 3):
            assert rightmost(net, i, delay) < 0
        if margin < math.inf:
            assert rightmost(net, i, 1.02 * margin) > 0
        # The loop that is opened at this wire, by another sweep.
        n = net.num_states
        others = np.delete(n + np.arange(3), i)
        matrix = close_loops(net.matrix, others)
        matrix = np.delete(np.delete(matrix, others, axis=0), others, axis=1)
        single = margins_of(-network(matrix, n, net.delays))
        assert margin == pytest.approx(single.delay, rel=1e-9)


@pytest.mark.slow
def test_the_random_networks_are_of_all_sorts():
    every = [
        delay_margins(random_network(seed), [wires([i]) for i in range(3)])
        for seed in range(12)
    ]
    found = [x for margins in every if margins for x in margins]
    assert sum(margins is None for margins in every) >= 1
    assert sum(0 < x < math.inf for x in found) >= 20
    assert sum(x == math.inf for x in found) >= 4


def test_many_states_of_one_equation_count_once():
    """100 equal lags 1/(s + 1), of which each has the gain 0.03: 3/(s + 1)."""
    num = 100
    M = np.zeros((num + 1, num + 1))
    M[:num, :num] = -np.eye(num)
    M[:num, num] = 1.0
    M[num, :num] = -0.03
    (margin,) = delay_margins(network(M, num), [wires([0])])
    w = math.sqrt(8)
    assert margin == pytest.approx((math.pi - math.atan(w)) / w, rel=1e-9)


def test_gains_without_dynamics():
    turn = np.array([[math.cos(0.6), -math.sin(0.6)], [math.sin(0.6), math.cos(0.6)]])
    # Both signals have one delay: the radius of the matrix. The sizes alone give 1.11.
    assert gain_at_once(0.8 * turn, (0.1, 0.1)) == pytest.approx(0.8)
    # Two delays: every phase turns this matrix to 0.6 sqrt(2) times a unitary one.
    mixed = 0.6 * np.array([[1.0, 1.0], [1.0, -1.0]])
    assert gain_at_once(mixed, (0.1, 0.2)) == pytest.approx(0.6 * math.sqrt(2))
    # A loop through both delays, and one that amplifies for some phases only: its
    # radius is 0.6 |1 - z| for a second delay that multiplies by z.
    assert gain_at_once(np.array([[0, 2.0], [0.3, 0]]), (0.1, 0.2)) < 1
    assert gain_at_once(np.array([[0.6, 0.6], [-0.6, -0.6]]), (0.1, 0.2)) == 1.2


def test_a_stable_loop_that_no_delay_leaves_stable():
    """L = 2 (s + 1)/(s + 3) is stable without delay; any delay multiplies by 2."""
    margins = margins_of(state_space([[-3.0]], [[1.0]], [[-4.0]], [[2.0]]))
    assert margins.is_stable
    assert margins.delay == 0.0


def test_a_turning_feedback_through_one_delay_is_stable():
    """y = -0.8 R y(t - 0.3) - x, dx/dt = y - x: R turns by 0.6 rad.

    The largest row of |0.8 R| is more than 1, but no signal grows.
    """
    turn = np.array([[math.cos(0.6), -math.sin(0.6)], [math.sin(0.6), math.cos(0.6)]])
    # States x (2), wires y -> x (2), delays (2).
    M = np.zeros((6, 6))
    M[:2, :2] = -np.eye(2)
    M[:2, 2:4] = np.eye(2)
    M[2:, :2] = -np.vstack([np.eye(2), np.eye(2)])
    M[2:, 4:] = -0.8 * np.vstack([turn, turn])
    margins = delay_margins(network(M, 2, (0.3, 0.3)), [wires([0, 1])])
    assert margins is not None
    late = network(M, 2, (1.0, 1.0, 0.3, 0.3))
    assert (characteristic_roots(late, count=2)[0].real < 0) == (margins[0] > 1.0)
