"""Two joints on a bus against exact sampled-data models and published conditions.

J. E. Colgate and G. G. Schenkel, "Passivity of a class of sampled-data systems:
application to haptic interfaces", J. Robotic Systems 14 (1997): with viscous friction
b, a force H(z) of the sampled position, held for T, is passive if and only if

    b > T/2 Re((1 - e^(-j w T)) H(e^(j w T)))/(1 - cos w T)    for 0 <= w <= pi/T.

For one joint on a fixed wall, H = K + B (z - 1)/(T z) gives b > K T/2 + |B|. Two equal
joints that move against each other are equivalent to one joint. If the drive of each
joint closes its own loop, its springs are K and H = K/z, which gives b > 3 K T/2. If a
host ties both joints, its spring is 2 H, which gives b > K T + 2 |B|. If the force acts
one cycle late, the term of the spring is three times as large: 3 K T/2 on the wall,
3 K T for the tied pair.
"""

import re

import numpy as np
import pytest
from documentation import ROOT
from grids import Slow
from numpy.testing import assert_allclose
from pydrake.systems.primitives import AffineSystem, MatrixGain, ZeroOrderHold
from scipy.optimize import brentq
from scipy.signal import cont2discrete
from wired import InSeries, Wired

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.analysis.stability import AnalyzeStability

M = 0.02
b = 0.2
K = 100.0
v_d = 0.5


def bus(T, *, M=M, K=K, hand=1.0):
    """Returns the map of the state from one cycle to the next, and its column of v_d.

    The state is [x_m, v_m, x_s, v_s, two states of the hand, both positions of the
    cycle before].
    """
    A = np.zeros((6, 6))
    B = np.zeros((6, 3))
    A[0, 1] = A[2, 3] = A[4, 5] = 1
    A[1, :2] = A[3, 2:4] = -K / M, -b / M
    # The hand is (2 s + 10)/(s^2 + 20 s) with the input v_d - v_m.
    A[1, 4:] = 10 * hand / M, 2 * hand / M
    A[5, 1] = -1
    A[5, 5] = -20
    B[5, 2] = 1
    B[1, 0] = B[3, 1] = K / M
    A, B, *_ = cont2discrete((A, B, np.eye(6), np.zeros((6, 3))), T, "zoh")
    cycle = np.zeros((8, 8))
    cycle[:6, :6] = A
    cycle[:6, 6:] = B[:, :2]
    cycle[6, 2] = cycle[7, 0] = 1
    return cycle, np.append(B[:, 2], [0, 0])


def wall(T, B, *, m, k_e, b=0.1, K=K):
    """Returns the map of one joint at a fixed wall, and its column of a force.

    The state is [x, v, the position of the cycle before]. A spring k_e holds the joint.
    """
    A = np.array([[0, 1], [-k_e / m, -b / m]])
    G = np.array([[0], [1 / m]])
    A, G, *_ = cont2discrete((A, G, np.eye(2), np.zeros((2, 1))), T, "zoh")
    cycle = np.zeros((3, 3))
    cycle[:2, :2] = A - G @ [[K + B / T, 0]]
    cycle[:2, 2] = G[:, 0] * B / T
    cycle[2, 0] = 1
    return cycle, np.append(G, 0)


def host(T, *, b=b, B=0.0, K=K, m=M, k_e=0.0, late=False, tied=True):
    """Returns the map from one cycle to the next of two joints that a host drives.

    The state is [x_1, v_1, x_2, v_2, both positions of the cycle before]. If the forces
    act one cycle late, the two forces of the cycle before follow. The host ties the
    joints to each other or, if not `tied`, each joint to a fixed wall. A hand with the
    stiffness k_e holds each joint.
    """
    joint = [[0, 1], [-k_e / m, -b / m]]
    A = np.kron(np.eye(2), joint)
    G = np.kron(np.eye(2), [[0], [1 / m]])
    A, G, *_ = cont2discrete((A, G, np.eye(4), np.zeros((4, 2))), T, "zoh")
    positions = np.eye(4)[[0, 2]]
    tie = np.array([[1, -1], [-1, 1]]) if tied else np.eye(2)
    forces = np.hstack([-(K + B / T) * tie @ positions, B / T * tie])
    if not late:
        return np.block([[np.hstack([A, np.zeros((4, 2))]) + G @ forces],
                         [positions, np.zeros((2, 2))]])  # fmt: skip
    return np.block([[A, np.zeros((4, 2)), G],
                     [positions, np.zeros((2, 4))],
                     [forces, np.zeros((2, 2))]])  # fmt: skip


def radius(cycle):
    """Returns the largest |z|, without the neutral z = 1 of the pair's position."""
    z = np.linalg.eigvals(cycle)
    return np.abs(z[np.abs(z - 1) > 1e-6]).max()


def longest_cycle(**pair):
    return brentq(lambda T: radius(bus(T, **pair)[0]) - 1, 1e-4, 0.02)


def on_bus(T, **overrides):
    keys = ("delay", "forward_channel.sample_period", "return_channel.sample_period")
    return LoadScenario("leader_follower", {**dict.fromkeys(keys, T), **overrides})


def assert_same(recording, cycle, by_input, u, states):
    """Asserts that the recording equals the iterated map at all cycles."""
    T = recording.scenario.forward_channel.sample_period
    x = 0 * by_input
    rows = []
    times = np.arange(0, recording.time[-1], T)
    for _ in times:
        rows.append(x)
        x = cycle @ x + by_input * u
    for name, i in states.items():
        expected = np.array(rows)[:, i]
        found = recording.Interpolate(name, times)[:, 0]
        scale = np.abs(expected).max()
        assert_allclose(found, expected, rtol=0, atol=1e-5 * scale)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_it_shakes_beyond_the_longest_cycle(share):
    T = share * longest_cycle()
    recording = simulate(on_bus(T, duration=5.1))
    states = {"felt_velocity": 1, "tool_position": 2, "tool_velocity": 3}
    assert_same(recording, *bus(T), v_d, states)
    times = [at + np.linspace(0, 0.1) for at in (3, 4, 5)]
    swing = [np.ptp(recording.Interpolate("tool_velocity", x)) for x in times]
    assert (swing[0] > swing[1] > swing[2]) == (share < 1)
    assert (swing[0] < swing[1] < swing[2]) == (share > 1)


@pytest.mark.parametrize("stiffness", Slow([25, 100, 200], but=[0]))
def test_analyze_finds_the_longest_cycle(stiffness):
    """The delay is two cycles and two holds of half a cycle, three cycles in all.

    The condition of Colgate and Schenkel is more conservative.
    """
    exact = longest_cycle(K=stiffness)
    key = "controller.proportional_damping.stiffness"
    (point,) = AnalyzeStability(on_bus(1e-3, **{key: stiffness})).points
    assert point.margin.delay / 3 == pytest.approx(exact, rel=5e-3)
    assert 2 * b / (3 * stiffness) < exact
    heavy = longest_cycle(K=stiffness, M=100 * M, hand=0)
    assert 2 * b / (3 * stiffness) == pytest.approx(heavy, rel=2e-3)


@pytest.mark.parametrize(("B", "above"), [(0.0, 1.02), (0.05, 1.5)])
def test_colgate_and_schenkel_where_the_host_closes_the_loop(B, above):
    """Below the bound every mass and spring is stable; above it some are not."""
    bound = 2 * (0.1 - B) / K

    def worst(T):
        return max(
            radius(wall(T, B, m=m, k_e=m * (share * np.pi / T) ** 2)[0])
            for m in np.geomspace(1e-5, 1, 12)
            for share in np.linspace(0, 1, 21)
        )

    assert worst(0.98 * bound) < 1 < worst(above * bound)


WIRINGS = {
    "one joint, fixed wall": ({"tied": False}, 1 / 2),
    "two joints, tied at both ends": ({"tied": True}, 1),
    "one joint, fixed wall, a cycle of computing": (
        {"tied": False, "late": True},
        3 / 2,
    ),
    "two joints, tied at both ends, a cycle of computing": (
        {"tied": True, "late": True},
        3,
    ),
}
"""The wirings of a host, named as on the page, and b/(K T) at their condition."""


def longest_cycle_of_host(wiring, *, K=K):
    """Returns the cycle in s above which the map is unstable without a hand."""
    return brentq(lambda T: radius(host(T, K=K, **wiring)) - 1, 1e-5, 0.02)


@pytest.mark.parametrize(("wiring", "share"), WIRINGS.values(), ids=WIRINGS)
def test_the_condition_of_each_wiring_of_a_host(wiring, share):
    """The least stable friction is that of the condition, except for the inertia."""
    T = 1e-3
    least = brentq(lambda b: radius(host(T, b=b, **wiring)) - 1, 1e-3, 1.0)
    assert least == pytest.approx(share * K * T, rel=5e-3)
    assert least < share * K * T


def test_the_walls_condition_does_not_hold_for_two_tied_joints():
    assert radius(host(1e-3, b=1.05 * K * 1e-3 / 2, tied=False)) < 1
    assert radius(host(1e-3, b=1.05 * K * 1e-3 / 2, tied=True)) > 1


@pytest.mark.parametrize(
    ("B", "late", "above"), [(0.0, False, 1.02), (0.02, False, 1.5), (0.0, True, 1.02)]
)
def test_two_tied_joints_in_any_hands(B, late, above):
    """Below the bound every mass and hand is stable; above it some are not."""
    bound = (b - 2 * B) / ((3 if late else 1) * K)

    def worst(T):
        return max(
            radius(host(T, B=B, late=late, m=m, k_e=m * (share * np.pi / T) ** 2))
            for m in np.geomspace(1e-5, 1, 12)
            for share in np.linspace(0, 1, 21)
        )

    assert worst(0.98 * bound) < 1 < worst(above * bound)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_two_joints_tied_by_a_host_shake_beyond_the_longest_cycle(share):
    """A simulated Diagram of Drake's blocks is stable or unstable as the map is."""
    T = share * longest_cycle_of_host({"tied": True})
    joint = [[0, 1], [0, -b / M]]
    tie = K * np.array([[-1, 0, 1, 0], [1, 0, -1, 0]])
    joints = AffineSystem(
        A=np.kron(np.eye(2), joint),
        B=np.kron(np.eye(2), [[0], [1 / M]]),
        f0=[0, 1, 0, 0],  # A push on the first joint, m/s^2.
        C=np.eye(4),
        D=np.zeros((4, 2)),
        y0=np.zeros(4),
    )
    parts = {"joints": joints, "host": MatrixGain(tie), "hold": ZeroOrderHold(T, 2)}
    diagram = Wired(parts, InSeries(*parts, "joints"), {"motion": "joints"})
    recording = simulate(diagram, duration=3.1)

    def swing(start):
        motion = recording.Interpolate("motion", start + np.linspace(0, 0.1, 200))
        return np.ptp(motion[:, 1] - motion[:, 3])

    first = swing(2.0)
    last = swing(3.0)
    assert (last < first) == (share < 1)


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_the_encoder_samples_as_theirs_does(share):
    """A leader with a very large mass is a fixed wall to the follower."""
    B = 0.05
    k_e = 50.0
    T = share * brentq(lambda T: radius(wall(T, B, m=M, k_e=k_e)[0]) - 1, 1e-4, 0.1)
    spring = {"name": "spring", "start": -np.inf, "stiffness": k_e, "reference": 0.01}
    overrides = {
        "sensor.encoder.sample_period": T,
        "controller.proportional_damping.master_mass": 1e9,
        "controller.proportional_damping.slave_damping": B,
        "environment.layers": [spring],
        "duration": 0.5,
        "divergence_speed_ratio": 1000,
    }
    recording = simulate(on_bus(T, **overrides))
    cycle = wall(T, B, m=M, k_e=k_e)
    assert_same(recording, *cycle, k_e * 0.01, {"tool_position": 0, "tool_velocity": 1})
    parts = recording.time < 0.1, recording.time > 0.4
    swing = [np.ptp(recording["tool_velocity"][part]) for part in parts]
    assert (swing[1] > swing[0]) == (share > 1)


def page():
    return (ROOT / "teleop_drake/docs/leader_follower.md").read_text(encoding="utf-8")


def test_the_page_is_short():
    assert len(page().split()) <= 510


@pytest.mark.parametrize("stiffness", [50.0, 100.0, 200.0])
def test_the_page_says_the_cycles_of_the_bus(stiffness):
    row = rf"^\| {stiffness:g} \| ([\d.]+) \| ([\d.]+) \|$"
    (found,) = re.findall(row, page(), re.MULTILINE)
    expected = [2 * b / (3 * stiffness), longest_cycle(K=stiffness)]
    assert [float(x) for x in found] == pytest.approx(
        [1e3 * T for T in expected], rel=1e-3
    )


@pytest.mark.parametrize(
    ("name", "wiring", "share"), [(k, *v) for k, v in WIRINGS.items()]
)
def test_the_page_says_the_cycles_of_a_host(name, wiring, share):
    row = rf"^\| host: {name} \|.*\| ([\d.]+) \| ([\d.]+) \|$"
    (found,) = re.findall(row, page(), re.MULTILINE)
    expected = [b / (share * K), longest_cycle_of_host(wiring)]
    assert [float(x) for x in found] == pytest.approx(
        [1e3 * T for T in expected], rel=1e-3
    )
