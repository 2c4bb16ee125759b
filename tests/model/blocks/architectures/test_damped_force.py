"""Direct force with a local damper; test_agreement has its runs."""

import appendix_a as arm
import numpy as np
import pytest
from block_checks import AssertFeedthroughIsReal, Block, RandomInputs
from numpy.testing import assert_allclose
from runs import Run
from scipy.optimize import brentq

from teleop_drake.model.blocks.architectures.damped_force import (
    DampedForce,
    DampedForceConfig,
)
from teleop_drake.model.blocks.architectures.local_damper import AGAINST
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.analysis.stability import AnalyzeStability

DAMPER = "controller.damped_force"


@pytest.mark.parametrize("against", AGAINST)
def test_the_force_acts_as_it_arrives_less_that_of_the_damper(against):
    B = np.array([[3.0, 0.5], [0.5, 2.0]])
    slave = DampedForceConfig(damping=B, against=against).MakeArchitecture(
        LoadScenario("two_dof_combined").Facts(), "controller.damped_force"
    )
    assert slave.master_side is None
    inputs = RandomInputs(slave.slave_side, 1)
    now = Block(slave.slave_side, inputs)
    F_h, v_d = np.split(inputs["forward_packet"], 2)
    reference = v_d if against == "command" else 0.0
    braking = B @ (inputs["tool_velocity"] - reference)
    assert_allclose(now["damping_force"], braking)
    assert_allclose(now["control_force"], F_h - braking)
    AssertFeedthroughIsReal(DampedForce(num_axes=2, damping=B, against=against))


@pytest.mark.parametrize("delays", [(0.1, 0.1), (0.05, 0.3)])
@pytest.mark.parametrize("against", AGAINST)
def test_arrival_is_that_of_the_closed_form(against, delays):
    """The tool follows the command at a distance of (F_h/K - v_d T_r).

    H(s) = 2/s + ... integrates v_d - v(t - T_r) until its force is that of the
    dampers at v_d. At the bone what happened at the puncture has died out.
    """
    K = 2.0
    rail = 0.1
    B = 2.0
    overrides = {
        "controller.kind": "damped_force",
        f"{DAMPER}.damping": B,
        f"{DAMPER}.against": against,
        "forward_channel.delay": delays[0],
        "return_channel.delay": delays[1],
    }
    recording = simulate(LoadScenario("one_dof", overrides))
    felt = rail + (B if against == "ground" else 0.0)
    expected = 15.0 + felt / K - delays[1]
    assert recording.EventTimes("contact")[0] == pytest.approx(expected, abs=2e-3)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", ["one_dof", "two_dof_collision"])
def test_against_the_command_it_is_the_thesis_law_with_z_0(name):
    """With B Lambda = 1 and B = Psi^-1 G1, to three digits; z goes by 1/G2."""
    b = 2.0
    psi = 5.0
    follows = f"{DAMPER}.against=command"
    ours = Run(name, "damped_force", f"{DAMPER}.damping={b}", follows)
    thesis = (
        f"controller.initial_psi={psi}",
        f"controller.G1={psi * b}",
        f"controller.Lambda={1 / b}",
        "controller.adaptation_rate=0",
    )
    times = np.linspace(0.0, ours.time[-1], 2001)
    for signal in ("tool_position", "tool_velocity", "environment_force"):
        errors = []
        for G2 in (500, 2000):
            theirs = Run(name, "adaptive_backstepping", *thesis, f"controller.G2={G2}")
            reference = theirs.Interpolate(signal, times)
            error = ours.Interpolate(signal, times) - reference
            errors.append(np.sqrt(np.mean(error**2)) / np.ptp(reference))
        assert errors[1] < 1e-3, signal
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05), signal


@pytest.mark.mostly_slow
@pytest.mark.parametrize("against", AGAINST)
@pytest.mark.parametrize(
    ("layer", "position", "velocity", "stiffness", "margin"),
    [
        ("free", (0.925, 0.0), (0.1, 0.0), 0.0, 1.900),
        ("bone", (1.0041253, 0.0), (0.0, 0.0), 150.0, 1.988),
    ],
)
def test_delay_margins_of_case_2(against, layer, position, velocity, stiffness, margin):
    """By the default's damping; v_d is no part of the loop."""
    scenario = LoadScenario(
        "two_dof_collision",
        {"controller.kind": "damped_force", f"{DAMPER}.against": against},
    )
    B = ResolveController(scenario).damping[0, 0]
    point = AnalyzeStability(scenario)[layer].ToRecord()
    expected = ArmMargin(np.array(position), np.array(velocity), stiffness, B)
    assert expected == pytest.approx(margin, abs=1e-3)
    assert point["delay_margin"] == pytest.approx(expected, rel=1e-5)


def ArmMargin(position, velocity, stiffness, damping):
    """The delay margin of the arm under direct force and a damper, on paper.

    The arm of Appendix A in task space, with differences in the place of derivatives.
    """
    h = 1e-5

    def Acceleration(p, v, F):
        q = arm.joints(p)
        qdot = np.linalg.solve(arm.J(q), v)
        J_dot = (arm.J(q + h * qdot) - arm.J(q - h * qdot)) / (2 * h)
        torque = arm.J(q).T @ F - arm.C(q, qdot) @ qdot
        return arm.J(q) @ np.linalg.solve(arm.M(q), torque) + J_dot @ qdot

    def Slope(Function):
        columns = [(Function(h * e) - Function(-h * e)) / (2 * h) for e in np.eye(2)]
        return np.stack(columns, axis=1)

    mobility = Slope(lambda F: Acceleration(position, velocity, F))
    force = -np.linalg.solve(mobility, Acceleration(position, velocity, np.zeros(2)))
    by_place = Slope(lambda x: Acceleration(position + x, velocity, force))
    by_speed = Slope(lambda x: Acceleration(position, velocity + x, force))
    bone = np.diag([stiffness, 0.0])

    def Eigenloci(w):
        s = 1j * w
        braking = mobility @ (damping * np.eye(2) + bone / s)
        A = s * np.eye(2) - by_speed - by_place / s + braking
        H = (25 * s + 50) / (s * s + 25 * s)
        loci = np.linalg.eigvals(H * np.linalg.solve(A, mobility))
        return loci[np.argsort(np.abs(loci))]

    def Excess(w, i):
        return np.abs(Eigenloci(w)[i]) - 1

    frequencies = np.geomspace(0.3, 10, 400)
    margins = []
    for i in range(2):
        values = [Excess(w, i) for w in frequencies]
        for j in np.flatnonzero(np.diff(np.sign(values))):
            w = brentq(Excess, frequencies[j], frequencies[j + 1], args=(i,))
            margins.append(np.angle(-Eigenloci(w)[i]) % (2 * np.pi) / w)
    return min(margins)


@pytest.mark.parametrize("name", ["one_dof", "two_dof_combined", "puma560_insertion"])
def test_the_default_just_keeps_the_tool_from_oscillating(name):
    """Roots of M s^2 + B s + K, the tool on the haptic device's spring."""
    scenario = LoadScenario(name, {"controller.kind": "damped_force"})
    B = ResolveController(scenario).damping
    M = scenario.Facts().inertia
    device = scenario.haptic_device
    K = device.numerator[-1] / device.denominator[-2]  # H(s) = K/s + ...
    n = len(M)
    A = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-K * np.linalg.inv(M), -np.linalg.solve(M, B)]]
    )
    # A double root moves by the square root of what rounding makes of it.
    assert np.abs(np.linalg.eigvals(A).imag).max() < 1e-6
    A[n:, n:] *= 0.99
    assert np.abs(np.linalg.eigvals(A).imag).max() > 0.1
    if name == "one_dof":
        assert B.item() == pytest.approx(2.0)


@pytest.mark.parametrize("kind", ["time_domain_passivity", "smith_predictor"])
def test_others_that_stand_on_the_damper_come_to_rest(kind):
    """As soon as it does alone; without it they do not."""
    settled = []
    for damper in (f"{kind}.local_damping=0", f"{kind}.local_damping=2"):
        overrides = [f"controller.{damper}", "duration=5.0", "simulator.accuracy=1e-7"]
        scenario = LoadScenario(
            "two_dof_combined", [f"controller.kind={kind}", *overrides]
        )
        metrics = RunMetrics(simulate(scenario, engine="auto"))
        settled.append(metrics["collision"]["settling_time"])
    assert settled == [None, pytest.approx(0.5887, rel=5e-3)]
