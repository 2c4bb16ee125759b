"""The classic results against their closed forms, and the page that reports them."""

import math
import re

import numpy as np
import pytest
from classics import (
    felt_stiffness,
    four_channels,
    move_and_wait,
    passive_wall,
    proportional_damping,
    sampled_wall,
    wave_line,
)
from classics.__main__ import STUDIES, PictureOf, Render
from documentation import ROOT, CheckPicture
from grids import Slow
from numpy.testing import assert_allclose
from scattering import delay_two_port, scattering_norm
from scipy.optimize import brentq, fsolve
from scipy.signal import cont2discrete

PAGE = (ROOT / "teleop_drake/docs/classics.md").read_text(encoding="utf-8")
PROSE = " ".join(PAGE.split())
W = np.geomspace(0.1, 20, 30)


def AssertRow(*cells):
    """A row of a table is on the page."""
    assert f"| {' | '.join(cells)} |" in PAGE


def AssertTold(*phrases):
    """Phrases are on the page, whatever its lines are."""
    for phrase in phrases:
        assert phrase in PROSE


def OfSamples(m, b, T):
    """The exact map of [x, v] of a tool from one sample to the next: A x + G F."""
    A = np.array([[0, 1], [0, -b / m]])
    B = np.array([[0], [1 / m]])
    A, G, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), T, "zoh")
    return A, G[:, 0]


# A sampled wall.


@pytest.mark.parametrize(
    ("stiffness", "damping"),
    [(0.5, 0.45), (0.5, -0.45), (0.95, 0.0), (0.1, 0.85), (0.0, -0.95), (0.0, 0.95)],
)
def test_a_wall_shakes_beyond_the_published_condition(stiffness, damping):
    """At 1.1 times both, b > K T/2 + |B| does not hold; K counts in units of 2 b/T."""
    b = sampled_wall.FRICTION
    T = sampled_wall.PERIOD
    for share in (1.0, 1.12):
        K = share * stiffness * 2 * b / T
        B = share * damping * b
        assert sampled_wall.IsPassive(K, B) == (b > K * T / 2 + abs(B)) == (share == 1)


@pytest.mark.parametrize("T", sampled_wall.PERIODS)
def test_the_stiffest_wall(T):
    b = sampled_wall.FRICTION
    assert sampled_wall.LargestStiffness(T) == pytest.approx(2 * b / T, rel=1e-3)


@pytest.mark.parametrize("wiring", sampled_wall.WIRINGS)
def test_the_friction_of_each_wiring(wiring):
    share = sampled_wall.WIRINGS[wiring][2]
    found = sampled_wall.LeastFriction(wiring)
    assert found == pytest.approx(share, rel=1e-3)
    AssertRow(wiring, f"{share:g}", f"{found:.3f}")


def test_a_sampled_loop_is_the_exact_map_of_its_samples():
    K = 900.0
    B = 0.3
    T = 1e-3
    b = 1.0
    A, G = OfSamples(1.0, b, T)
    loop = sampled_wall.MakeSampledLoop(K=K, B=B, T=T, b=b)
    recording = sampled_wall.simulate(loop, duration=0.2)
    x = np.array([0.0, 1.0])
    last = 0.0
    expected = []
    for _ in range(200):
        expected.append(x[0])
        force = -K * x[0] - B * (x[0] - last) / T
        last = x[0]
        x = A @ x + G * force
    found = recording.Interpolate("position", T * np.arange(200))[:, 0]
    assert_allclose(found, expected, atol=1e-7)


# Raw lines and waves.


def test_the_norm_of_a_raw_line():
    T = wave_line.ROUND_TRIP / 2
    raw = delay_two_port(W, forward_delay=T, return_delay=T)
    expected = np.abs(np.tan(W * T)) + np.abs(1 / np.cos(W * T))
    assert_allclose(scattering_norm(raw), expected, rtol=1e-9)


@pytest.mark.parametrize("damper", wave_line.DAMPERS)
def test_reflections(damper):
    b = wave_line.IMPEDANCE
    reflection = wave_line.Reflection(damper)
    assert reflection == pytest.approx((b - damper) / (b + damper), abs=1e-12)
    rest = wave_line.RestTime(damper)
    rests = "never" if rest is None else f"{rest:.2f}"
    AssertRow(f"{damper:g}", f"{reflection + 0.0:.3g}", rests)


@pytest.mark.slow
def test_an_open_end_never_rests():
    recording = wave_line.Reflecting(0.0, duration=40.0)
    force = recording["environment_force"][:, 0]
    # The amplitude beats, so that rounding moves it at any one time by some per cent.
    swings = [
        np.ptp(force[(recording.time > at) & (recording.time < at + 2)])
        for at in range(8, 40, 2)
    ]
    assert min(swings) > 0.5
    AssertTold("still swings by more than 0.5 N")


def test_lines_on_a_wall():
    raw, waves, damped = (wave_line.OnWall(x) for x in wave_line.LINES_TO_WALL)
    made = [1e6 * wave_line.EnergyMade(x) for x in (raw, waves, damped)]
    assert (raw.termination, waves.termination) == ("diverged", "completed")
    assert made[1] < 1e-6
    assert len(damped.EventTimes("release")) == 1
    AssertTold(
        f"generates {made[0]:.3g} µJ",
        f"diverges after {raw.time[-1]:.2f} s",
        f"still generates {made[2]:.3g} µJ",
        f"waves leave it {len(waves.EventTimes('release'))} times",
    )


def test_the_mass_of_a_line():
    expected = wave_line.IMPEDANCE * wave_line.ROUND_TRIP / 2
    found = wave_line.FeltMass()
    assert found == pytest.approx(expected, rel=1e-3)
    AssertTold(f"mass b T/2 = {expected:.3f} kg", f"linear model has {found:.4f} kg")


# Transparency.


def OnPaper(name, Z_m, Z_s, C_m, C_s, C1, C4, Z_e):
    """Z_to by the formula of the study."""
    C = {"C2": 1.0, "C3": 1.0, "C5": 0.0, "C6": 0.0}
    C |= {
        "position-force": {"C3": 0.0},
        "position-position": {"C2": 0.0, "C3": 0.0},
    }.get(name, {})
    C |= {key: x for key, x in four_channels.SETTINGS[name].items() if key in C}
    N = Z_s + C_s + (1 + C["C5"]) * Z_e
    back = C["C2"] * Z_e + C4
    return ((Z_m + C_m) * N + C1 * back) / ((1 + C["C6"]) * N - C["C3"] * back)


@pytest.mark.parametrize("name", four_channels.SETTINGS)
def test_the_felt_impedance(name):
    s = 1j * W
    w_c = four_channels.BANDWIDTH
    m = 0.5
    c = 0.1
    Z = m * s + c
    C = 2 * m * w_c + m * w_c**2 / s
    # The models in C1 and C4 are the dampings; only four channels know the tool's.
    B_s = 0.0 if name.startswith("position") else c
    C1 = B_s + C
    C_m = C
    C4 = -(c + C)
    if name == "position-force":
        C_m = C4 = 0 * s
    felt, Z_e = four_channels.Felt(name, W)
    assert_allclose(Z_e, 150 / s)
    expected = OnPaper(name, Z, Z, C_m, C, C1, C4, Z_e)
    assert_allclose(felt, expected, rtol=1e-6)


@pytest.mark.parametrize("name", four_channels.TRANSPARENT)
def test_with_accelerations_three_channels_are_transparent(name):
    Z_m, Z_s, C_m, C_s, Z_e = np.random.default_rng(1).normal(size=(5, 2)) @ [1, 1j]
    found = OnPaper(name, Z_m, Z_s, C_m, C_s, Z_s + C_s, -(Z_m + C_m), Z_e)
    assert found == pytest.approx(Z_e)


@pytest.mark.parametrize("name", Slow([*four_channels.SETTINGS], but=[1]))
def test_the_table_of_transparency(name):
    stable = four_channels.StableUpTo(name)
    cells = [
        "any" if np.isinf(stable[x]) else f"{stable[x]:.3g}"
        for x in four_channels.LAYERS
    ]
    AssertRow(name, f"{four_channels.Error(name, [1.0])[0]:.3g}", *cells)


@pytest.mark.slow
def test_margins_of_three_against_four():
    four = four_channels.StableUpTo("four channels")
    for name in ("position-position", *four_channels.TRANSPARENT[1:]):
        other = four_channels.StableUpTo(name)
        assert all(abs(other[x] / four[x] - 1) < 0.04 for x in four_channels.LAYERS)
    for name in four_channels.TRANSPARENT[1:]:
        ratio = four_channels.Error(name, [1.0]) / four_channels.Error(
            "four channels", [1.0]
        )
        assert ratio == pytest.approx(2, rel=0.15)


@pytest.mark.slow
def test_margins_at_a_lower_bandwidth(monkeypatch):
    monkeypatch.setattr(four_channels, "BANDWIDTH", 25.0)
    four, forward, back = map(four_channels.StableUpTo, four_channels.TRANSPARENT)
    assert forward["bone"] == 0
    (at_twice,) = re.findall(r"\| four channels \| \S+ \| \S+ \| (\S+) ", PAGE)
    assert four["free"] == pytest.approx(2 * float(at_twice), rel=0.05)
    AssertTold(
        f"{four['bone']:.3g} s with four channels, {back['bone']:.3g} s without the "
        "force back, and none without the force forward"
    )
    notebook = (ROOT / "notebooks/10_classic_results.ipynb").read_text("utf-8")
    assert f"four are stable up to {four['bone']:.3g} s" in notebook


# Passivity control.


def ByHand(largest_damping):
    """Positions and energies at the samples: the exact map, and the law on paper."""
    m = passive_wall.MASS
    b = passive_wall.FRICTION
    T = passive_wall.PERIOD
    A, G = OfSamples(m, b, T)
    x = np.array([passive_wall.START, 0.0])
    last = None
    force = 0
    energy = 0
    rows = []
    for _ in range(round(passive_wall.DURATION / T)):
        step = 0.0 if last is None else x[0] - last
        energy += force * step
        force = passive_wall.STIFFNESS * max(x[0], 0)
        if energy < 0 and step:
            force += min(-energy / step, largest_damping * step / T, key=abs)
        rows.append((x[0], energy))
        last = x[0]
        x = A @ x + G * (passive_wall.PUSH - force)
    return np.array(rows)


@pytest.mark.parametrize("largest_damping", [0.0, passive_wall.LARGEST_DAMPING])
def test_passivity_control_by_hand(largest_damping):
    expected = ByHand(largest_damping)
    recording = passive_wall.Contact(largest_damping)
    times = passive_wall.PERIOD * np.arange(len(expected))
    position = recording.Interpolate("position", times)[:, 0]
    energy = recording.Interpolate("energy", times + passive_wall.PERIOD / 2)[:, 0]
    assert_allclose(position, expected[:, 0], atol=1e-6)
    assert_allclose(energy, expected[:, 1], atol=1e-6)


def test_what_a_held_force_gives_in_the_first_contact():
    """A held spring is one with the damper -K T/2: that much work in half a swing."""
    K = passive_wall.STIFFNESS
    T = passive_wall.PERIOD
    m = passive_wall.MASS
    square = 2 * passive_wall.PUSH / m * -passive_wall.START
    expected = -K * T / 2 * square * math.pi / 2 * math.sqrt(m / K)
    run = passive_wall.Contact(0.0)
    assert run.Interpolate("energy", [0.2])[0, 0] == pytest.approx(expected, rel=0.25)


def test_the_observed_energy_on_the_page():
    free = passive_wall.Contact(0.0)
    kept = passive_wall.Contact(passive_wall.LARGEST_DAMPING)
    sums = [1e3 * x for x in passive_wall.SumsOfSamples(free)]
    assert min(sums) > 0
    steps = np.abs(np.diff(ByHand(passive_wall.LARGEST_DAMPING)[:, 0]))
    assert -kept["energy"].min() < np.max(kept["force"]) * steps.max()
    assert kept["energy"][-1, 0] == pytest.approx(0, abs=1e-9)
    assert kept["position"].min() >= passive_wall.START
    AssertTold(
        f"absorbed {1e3 * free['energy'][-1, 0]:.3g} mJ after 2 s",
        f"up to {-1e3 * free['position'].min():.3g} mm",
        f"falls to {1e3 * kept['energy'].min():.3g} mJ",
        f"finds {sums[0]:.3g} mJ here",
        f"and {sums[1]:.3g} mJ with differences",
    )


# P+d.


@pytest.mark.parametrize("margin", proportional_damping.MARGINS)
def test_the_bound_of_proportional_damping(margin):
    found = proportional_damping.Llewellyn(margin, W)
    on_paper = proportional_damping.LlewellynOnPaper(margin, W)
    assert_allclose(found, on_paper, rtol=1e-6)
    # mu (w T)^2/2 + cos w T is least where mu w T = sin w T.
    B = proportional_damping.BRAKE
    c = proportional_damping.FRICTION
    mu = margin * (B + c) / B
    x = 0.0 if mu >= 1 else brentq(lambda x: mu * x - math.sin(x), 0.1, 3)
    least = mu * x**2 / 2 + math.cos(x)
    w = np.linspace(0.05, 12, 600)
    assert proportional_damping.Llewellyn(margin, w).min() == pytest.approx(
        least, abs=1e-4
    )
    K = proportional_damping.Stiffness(margin)
    AssertRow(f"{margin:g}", f"{K:.2f}", f"{least:.3f}")


@pytest.mark.parametrize(
    ("margin", "mass"),
    Slow([(0.95, 2.0), (1.05, 2.0), (0.8, 0.5), (1.05, 10.0)], but=[0, 1]),
)
def test_free_bodies_on_the_spring(margin, mass):
    """The root of (M s^2 + B s + K)^2 = K^2 e^(-s T): nothing else holds them."""
    B = proportional_damping.BRAKE
    T = proportional_damping.ROUND_TRIP
    K = proportional_damping.Stiffness(margin)

    def Residual(parts):
        s = complex(*parts)
        value = (mass * s**2 + B * s + K) ** 2 - K**2 * np.exp(-s * T)
        return [value.real, value.imag]

    guess = [0.0, math.sqrt(2 * K / mass)]
    expected = fsolve(Residual, guess)[0]
    found = proportional_damping.GrowthOfBodies(margin, mass)
    assert found == pytest.approx(expected, abs=1e-6)
    assert (found > 0) == (margin < 1)
    if (margin, mass) == (0.95, 2.0):
        AssertTold(f"with {found:.5f}/s")


# Move and wait.


def PathOfMove(tau, y):
    """The share of a move of least jerk that is done, less y."""
    return tau**3 * (10 - 15 * tau + 6 * tau**2) - y


def TimeOnPaper(round_trip, tolerance):
    """When the tool is seen at the goal, and the number of moves: see the operator."""
    share = move_and_wait.SHARE
    reaction = 0.2
    shortest = 0.3
    rest_speed = 0.1 * tolerance * move_and_wait.WAY / reaction
    begin = 0.0
    remaining = move_and_wait.WAY
    count = 0
    while True:
        d = share * remaining
        count = count + 1
        duration = max(1.875 * d / move_and_wait.SPEED, shortest)
        after = remaining - tolerance * move_and_wait.WAY
        if after <= d:
            tau = brentq(PathOfMove, 0, 1, (after / d,))
            return begin + tau * duration + round_trip, count
        q = math.sqrt(rest_speed * duration / (30 * d))
        tau = (1 + math.sqrt(1 - 4 * q)) / 2
        begin += round_trip + tau * duration + reaction
        remaining -= d


@pytest.mark.parametrize("tolerance", move_and_wait.TOLERANCES)
def test_completion_times_of_move_and_wait(tolerance):
    cells = []
    for trip in (0.0, 3.0):
        expected, count = TimeOnPaper(trip, tolerance)
        found = move_and_wait.MoveAndWaitTime(trip, tolerance)
        assert found == pytest.approx(expected, abs=2e-3)
        cells.append(f"{found:.2f}")
    moves = math.ceil(math.log(tolerance) / math.log(1 - move_and_wait.SHARE))
    slope = move_and_wait.Slope(tolerance)
    assert count == moves and slope == pytest.approx(moves, abs=1e-3)
    AssertRow(f"{100 * tolerance:g} %", f"{moves}", *cells, f"{slope:.3f}")


def test_who_does_not_wait_is_stable_up_to_a_quarter_turn():
    limit = math.pi / 2 / move_and_wait.CROSSOVER
    swings = []
    for trip in (0.97 * limit, 1.03 * limit):
        loop = move_and_wait.MakeContinuous(trip)
        recording = move_and_wait.simulate(loop, duration=20.0)
        position = recording["seen_position"][:, 0]
        early = np.ptp(position[(recording.time > 5) & (recording.time < 8)])
        swings.append(np.ptp(position[recording.time > 17]) / early)
    assert swings[0] < 1 < swings[1]
    without = move_and_wait.ContinuousTime(0.0, 0.02)
    # 0.1 e^(-w t) = 0.002.
    assert without == pytest.approx(math.log(50) / move_and_wait.CROSSOVER, rel=1e-3)
    assert np.isinf(move_and_wait.ContinuousTime(0.5, 0.02))
    AssertTold(f"after {without:.2f} s without delay", f"pi/6 = {limit:.3f} s")


# Felt stiffness.


@pytest.mark.parametrize("trip", [0.05, 0.2, 1.0, 2.0])
def test_felt_stiffness(trip):
    direct = felt_stiffness.Felt("direct_force", trip)
    on_paper = felt_stiffness.DirectOnPaper(trip)
    assert direct == pytest.approx(on_paper, rel=1e-8)
    # The whole line: b (Z_L + b tanh(s T/2))/(b + Z_L tanh(s T/2)) with s = j.
    b = felt_stiffness.IMPEDANCE
    load = 0.5j + 0.1 + 150 / 1j
    tanh = 1j * math.tan(trip / 2)
    line = b * (load + b * tanh) / (b + load * tanh)
    waves = felt_stiffness.Felt("wave_variables", trip)
    assert waves == pytest.approx(-line.imag, rel=1e-6)
    series = felt_stiffness.WavesOnPaper(trip)
    cells = [f"{x:.4g}" if x > 100 else f"{x:.3g}" for x in (direct, on_paper)]
    AssertRow(f"{trip:g}", *cells, f"{waves:.3g}", f"{series:.3g}")


# The page.


@pytest.mark.slow
@pytest.mark.parametrize("study", Slow(STUDIES, but=[6]))
def test_figures_are_those_of_the_studies(study, tmp_path):
    assert PictureOf(study).stat().st_size <= 60_000
    assert f"({PictureOf(study).name})" in PAGE
    Render(study).save(tmp_path / "now.png")
    CheckPicture(PictureOf(study), tmp_path / "now.png")
