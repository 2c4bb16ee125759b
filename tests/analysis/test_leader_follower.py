"""Two joints on a bus, against sampled-data control by hand and Colgate and Schenkel.

J. E. Colgate and G. G. Schenkel, "Passivity of a class of sampled-data systems:
application to haptic interfaces", J. Robotic Systems 14 (1997): with viscous friction
b, a force H(z) of the sampled position, held for T, is passive if and only if

    b > T/2 Re((1 - e^(-j w T)) H(e^(j w T)))/(1 - cos w T)    for 0 <= w <= pi/T.

For H = K + B (z - 1)/(T z) that is b > K T/2 + |B|. Two equal joints that move against
each other are one joint with the springs K and H = K/z: b > 3 K T/2.
"""

import re

import numpy as np
import pytest
from documentation import ROOT
from grids import Slow
from scipy.optimize import brentq
from scipy.signal import cont2discrete

from teleop_drake.analysis.stability import AnalyzeStability
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate

M, b, K, v_d = 0.02, 0.2, 100.0, 0.5


def bus(T, *, M=M, K=K, hand=1.0):
    """The map from one cycle to the next, of [x_m, v_m, x_s, v_s, the hand's two, both
    positions of the cycle before], and what v_d adds."""
    A, B = np.zeros((6, 6)), np.zeros((6, 3))
    A[0, 1] = A[2, 3] = A[4, 5] = 1
    A[1, :2] = A[3, 2:4] = -K / M, -b / M
    # The hand: (2 s + 10)/(s^2 + 20 s), fed by v_d - v_m.
    A[1, 4:] = 10 * hand / M, 2 * hand / M
    A[5, 1], A[5, 5], B[5, 2] = -1, -20, 1
    B[1, 0] = B[3, 1] = K / M
    A, B, *_ = cont2discrete((A, B, np.eye(6), np.zeros((6, 3))), T, "zoh")
    cycle = np.zeros((8, 8))
    cycle[:6, :6], cycle[:6, 6:] = A, B[:, :2]
    cycle[6, 2] = cycle[7, 0] = 1
    return cycle, np.append(B[:, 2], [0, 0])


def wall(T, B, *, m, k_e, b=0.1, K=K):
    """The same of [x, v, the position before], on a spring k_e of its own, with F_0."""
    A = np.array([[0, 1], [-k_e / m, -b / m]])
    G = np.array([[0], [1 / m]])
    A, G, *_ = cont2discrete((A, G, np.eye(2), np.zeros((2, 1))), T, "zoh")
    cycle = np.zeros((3, 3))
    cycle[:2, :2] = A - G @ [[K + B / T, 0]]
    cycle[:2, 2] = G[:, 0] * B / T
    cycle[2, 0] = 1
    return cycle, np.append(G, 0)


def radius(cycle):
    """The largest |z| but for a neutral z = 1, where the pair as a whole stands."""
    z = np.linalg.eigvals(cycle)
    return np.abs(z[np.abs(z - 1) > 1e-6]).max()


def longest_cycle(**pair):
    return brentq(lambda T: radius(bus(T, **pair)[0]) - 1, 1e-4, 0.02)


def on_bus(T, **overrides):
    keys = ("delay", "forward_channel.sample_period", "return_channel.sample_period")
    return LoadScenario("leader_follower", {**dict.fromkeys(keys, T), **overrides})


def assert_same(recording, cycle, by_input, u, states):
    """The recording at the cycles is what the map says."""
    T, x, rows = recording.scenario.forward_channel.sample_period, 0 * by_input, []
    times = np.arange(0, recording.time[-1], T)
    for _ in times:
        rows.append(x)
        x = cycle @ x + by_input * u
    for name, i in states.items():
        expected = np.array(rows)[:, i]
        found = recording.Interpolate(name, times)[:, 0]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * scale)


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
    """The round trip is two cycles and two halves; Colgate and Schenkel are below."""
    exact = longest_cycle(K=stiffness)
    key = "controller.proportional_damping.stiffness"
    (point,) = AnalyzeStability(on_bus(1e-3, **{key: stiffness})).points
    assert point.margin.delay / 3 == pytest.approx(exact, rel=5e-3)
    assert 2 * b / (3 * stiffness) < exact
    heavy = longest_cycle(K=stiffness, M=100 * M, hand=0)
    assert 2 * b / (3 * stiffness) == pytest.approx(heavy, rel=2e-3)


@pytest.mark.parametrize(("B", "above"), [(0.0, 1.02), (0.05, 1.5)])
def test_colgate_and_schenkel_where_the_host_closes_the_loop(B, above):
    """Stable with every mass and spring below the bound, and not with all above."""
    bound = 2 * (0.1 - B) / K

    def worst(T):
        return max(
            radius(wall(T, B, m=m, k_e=m * (share * np.pi / T) ** 2)[0])
            for m in np.geomspace(1e-5, 1, 12)
            for share in np.linspace(0, 1, 21)
        )

    assert worst(0.98 * bound) < 1 < worst(above * bound)


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_the_encoder_samples_as_theirs_does(share):
    """A leader that is held fast is a wall to the follower."""
    B, k_e = 0.05, 50.0
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


def test_the_page_says_these_numbers():
    page = (ROOT / "teleop_drake/docs/leader_follower.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| ([\d.]+) \| ([\d.]+) \|$", page, re.MULTILINE)
    assert len(rows) == 3 and len(page.split()) <= 350
    for stiffness, friction, *cycles in [(float(K), b, *x) for K, *x in rows]:
        simple = 2e3 * friction / (3 * stiffness)
        exact = 1e3 * longest_cycle(K=stiffness)
        assert [float(x) for x in cycles] == pytest.approx([simple, exact], rel=6e-3)
