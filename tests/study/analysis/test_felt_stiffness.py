"""The stiffness of the bone as the hand feels it: closed forms and a second method."""

import numpy as np
import pytest
from grids import Slow
from phasors import FeltImpedance

from teleop_drake.model.scenario import ARCHITECTURES, LoadScenario
from teleop_drake.model.stations import MakeArchitecture, ResolveController
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.transparency import FeltStiffness

BONE = 150.0
# Of the slider.
MASS = 0.5
DAMPING = 0.1
RESISTANCE = 0.92  # b of H(s) = 2/s + 0.92 + ...

# The shares of the round trip are not equal, because only their sum has an effect.
SHARES = (0.3, 0.7)

PREDICTOR = "smith_predictor"
OMEGA = np.array([0.3, 1.0, 20.0])


def Scenario(kind, round_trip, name="one_dof", **overrides):
    delays = {
        f"{way}_channel.delay": share * round_trip
        for way, share in zip(("forward", "return"), SHARES, strict=True)
    }
    return LoadScenario(name, {"controller.kind": kind, **delays, **overrides})


def OnBone(scenario, *frequencies):
    return FeltStiffness(scenario, OperatingPoints(scenario)[-1], frequencies)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("round_trip", Slow([0.2, 0.0]))
@pytest.mark.parametrize(
    ("kind", "name"),
    [*((kind, "one_dof") for kind in ARCHITECTURES), (PREDICTOR, "two_dof_collision")],
)
def test_slow_motions(kind, name, round_trip):
    """The springs in series with the bone, from the equations of each architecture."""
    scenario = Scenario(kind, round_trip, name)
    series = 1 / BONE
    if kind == "wave_variables":
        series += round_trip / (2 * RESISTANCE)
    elif kind == "proportional_damping":
        series += 1 / ResolveController(scenario).stiffness[0, 0]
    elif kind == "smith_predictor" and name == "two_dof_collision" and round_trip:
        # The predictor's model has neither spring nor damper and yields to any force.
        series = np.inf
    # The spring of the Smith predictor's model counts only below 0.02 rad/s.
    omega = 1e-6 if kind == "smith_predictor" and name == "one_dof" else 1e-4
    assert OnBone(scenario, omega)[0] == pytest.approx(1 / series, rel=1e-3, abs=1e-3)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("round_trip", [0.0, 1.0])
def test_direct_force_with_a_damper_and_a_predictor(round_trip, subtests):
    s = 1j * OMEGA
    z = np.exp(-s * round_trip)
    tool = z / (MASS * s**2 + DAMPING * s + BONE)
    # The damper's default is 2 N s/m.
    damped = z / (MASS * s**2 + (DAMPING + 2.0) * s + BONE)
    # The predictor's model is that of the tissue: 0.01 N/m, and 0.5 N s/m in addition
    # to the slider's damping.
    model = (1 - z) / (MASS * s**2 + (DAMPING + 0.5) * s + 0.01)
    for kind, expected in (
        ("direct_force", tool),
        ("damped_force", damped),
        ("time_domain_passivity", tool),
        ("smith_predictor", tool + model),
    ):
        with subtests.test(kind=kind):
            stiffness = OnBone(Scenario(kind, round_trip), *OMEGA)
            assert stiffness == pytest.approx((1 / expected).real, rel=1e-6)


def Tool(s, damping=DAMPING):
    """Returns F/x of the slider on the bone at s in rad/s."""
    return MASS * s**2 + damping * s + BONE


def Adaptive(s):
    """Returns F_h/x of the thesis's law without adaptation, (4.2), (4.23) and (4.32).

    F_c' = alpha' - Psi P s - G2 z with alpha' = -Psi^-1 G1 Psi (F_c - F_e). This rate
    of alpha lacks that of F_e, whose estimate W3 Phi is 0. v_d is 0.
    """
    Psi = 4.3
    Lambda = 1.0
    G1 = 2.0
    G2 = 20.0
    P = 1.0
    F_e = BONE  # Of x = 1.
    F_c = Tool(s)
    gain = Psi * P + G2 * G1 / Psi
    error = -((s + G1 + G2) * F_c - (G1 + G2) * F_e) / gain
    return F_e - (error - s) / Lambda


def Waves(s, T):
    """Returns F_h/x of the line in test_the_wave_line_is_a_transmission_line."""
    load = Tool(s) / s
    tangent = np.tanh(s * T / 2)
    line = (load + RESISTANCE * tangent) / (RESISTANCE + load * tangent)
    return s * RESISTANCE * (line + 1)


@pytest.mark.parametrize(
    ("kind", "adaptation_rate", "expected"),
    [
        ("direct_force", 0.1, [147.0, 73.9, 20.6]),
        ("damped_force", 0.1, [146.0, 65.5, 6.84]),
        ("adaptive_backstepping", 0.0, [144.0, 22.6, -53.0]),
        ("adaptive_backstepping", 0.1, [144.0, 22.7, -52.8]),
        ("wave_variables", 0.1, [8.63, 7.79, 6.90]),
    ],
)
def test_the_bone_feels_soft_to_a_fast_hand(kind, adaptation_rate, expected):
    """At 1, 5 and 7 rad/s with 0.1 s each way; closed forms without adaptation."""
    omega = np.array([1.0, 5.0, 7.0])
    T = 0.2
    s = 1j * omega
    late = np.exp(s * T)
    closed = {
        "direct_force": Tool(s) * late,
        "damped_force": Tool(s, DAMPING + 2.0) * late,
        "adaptive_backstepping": Adaptive(s) * late,
        "wave_variables": Waves(s, T),
    }[kind].real
    rate = {"controller.adaptation_rate": adaptation_rate}
    stiffness = OnBone(Scenario(kind, T, **rate), *omega)
    assert stiffness == pytest.approx(expected, rel=5e-3)
    learns = kind == "adaptive_backstepping" and adaptation_rate > 0
    assert stiffness == pytest.approx(
        closed, rel=0 if learns else 1e-6, abs=0.2 * learns
    )
    if kind == "direct_force":
        plain = (BONE - MASS * omega**2) * np.cos(omega * T)
        plain -= DAMPING * omega * np.sin(omega * T)
        assert stiffness == pytest.approx(plain, rel=1e-6)


@pytest.mark.parametrize("round_trip", [0.0, 0.2])
def test_it_does_not_depend_on_what_the_damper_acts_against(round_trip):
    """The operator commands no other velocity while the hand moves."""
    against = {"controller.damped_force.against": "command"}
    command = OnBone(Scenario("damped_force", round_trip, **against), *OMEGA)
    ground = OnBone(Scenario("damped_force", round_trip), *OMEGA)
    assert command == pytest.approx(ground, rel=1e-9)


@pytest.mark.parametrize("round_trip", [0.0, 0.2])
def test_the_wave_line_is_a_transmission_line(round_trip):
    s = 1j * OMEGA
    b = RESISTANCE
    load = MASS * s + DAMPING + BONE / s
    tangent = np.tanh(s * round_trip / 2)
    line = b * (load + b * tangent) / (b + load * tangent)
    scenario = Scenario("wave_variables", round_trip)
    # The line has a parallel damper D = b.
    assert OnBone(scenario, *OMEGA) == pytest.approx((s * (line + b)).real, rel=1e-6)


@pytest.mark.parametrize(
    "kind", ["wave_variables", "proportional_damping", "four_channel"]
)
def test_the_blocks_alone_say_the_same(kind):
    """A second method: phasors through the blocks, with closed forms of the rest."""
    scenario = Scenario(kind, 1.0)
    sides = MakeArchitecture(scenario)
    expected = []
    for s in 1j * OMEGA:
        impedance = FeltImpedance(
            sides.master_side,
            sides.slave_side,
            s,
            delays=(scenario.forward_channel.delay, scenario.return_channel.delay),
            robot=MASS * s + DAMPING,
            environment=BONE / s,
        )
        expected.append((s * impedance).real)
    assert OnBone(scenario, *OMEGA) == pytest.approx(expected, rel=1e-6)
