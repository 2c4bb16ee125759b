"""Tests of analysis.transparency against closed forms and phasors of the blocks."""

import json

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose
from phasors import TerminatedPort
from scattering import delay_two_port, scattering_norm

from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.transparency import (
    AnalyzeTransparency,
    EnvironmentImpedance,
    TransmittedImpedance,
)
from teleop_drake.study.figures.analysis import PlotTransparency

W = np.geomspace(0.1, 100, 40)
ROBOT = 0.5j * W + 0.1
LAYERS = [(0, 0.01, 0.5), (1, 0.0, 0.0), (2, 150.0, 0.0)]


def Analyze(name, kind, point=0, forward=0.07, back=0.13, **overrides):
    scenario = LoadScenario(
        name,
        {
            "controller.kind": kind,
            "forward_channel.delay": forward,
            "return_channel.delay": back,
        }
        | overrides,
    )
    return scenario, AnalyzeTransparency(
        scenario,
        OperatingPoints(scenario)[point],
        frequencies=W,
    )


@pytest.mark.parametrize(("point", "k", "d"), LAYERS)
def test_transmitted_impedance_of_direct_force(point, k, d):
    """Z_to = (m j w + c + Z_e) e^(j w T), which includes the robot's impedance."""
    _, result = Analyze("one_dof", "direct_force", point)
    Z_e = d + k / (1j * W)
    assert_allclose(result.environment[:, 0, 0], Z_e)
    Z_to = result.transmitted[:, 0, 0]
    assert_allclose(Z_to, (ROBOT + Z_e) * np.exp(0.2j * W), rtol=1e-8)
    assert_allclose(result.undelayed[:, 0, 0], ROBOT + Z_e, rtol=1e-8)
    # The channels as a two-port give the same impedance.
    felt = TerminatedPort(
        delay_two_port(W, forward_delay=0.07, return_delay=0.13), ROBOT + Z_e
    )
    assert_allclose(Z_to, 1 / felt, rtol=1e-8)


def test_llewellyn_of_direct_force():
    """y11 = z/Z, y12 = -z_r/Z, y21 = -z_f/Z, y22 = 1/Z with the impedance of the robot.

    z_f, z_r and z are the delays of the channels and of the round trip.
    """
    scenario, result = Analyze("one_dof", "direct_force")
    model = Linearizer(scenario, at_ports=True).TwoPort(result.point)
    y = model.Admittance(W, forward_delay=0.07, return_delay=0.13)
    z_f = np.exp(-0.07j * W)
    z_r = np.exp(-0.13j * W)
    expected = np.array([[z_f * z_r, -z_r], [-z_f, np.ones(len(W))]]) / ROBOT
    assert_allclose(y, np.moveaxis(expected, -1, 0), rtol=1e-8)
    felt = expected[0, 0].real
    product = expected[0, 1] * expected[1, 0]
    eta = (2 * felt * expected[1, 1].real - product.real) / np.abs(product)
    assert_allclose(result.llewellyn[:, 0], np.where(felt < 0, -np.inf, eta), rtol=1e-7)
    record = result.ToRecord()
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["absolutely_stable"] is False
    assert record["least_llewellyn"] == [None]


def test_an_exact_predictor_lets_the_model_be_felt():
    """Z_to = m j w + c + Z_e with any delay: the operator feels only the model."""
    _, result = Analyze("one_dof", "smith_predictor", 0, 0.3, 0.5)
    assert_allclose(
        result.transmitted[:, 0, 0], ROBOT + 0.5 + 0.01 / (1j * W), rtol=1e-8
    )


def test_an_ideal_four_channel_loop_adds_a_mass_without_delay():
    """Z_to = M s + Z_e if the robot and the handle have the same mass M.

    The sum of the equations of master and slave is M s (V_m + V_s) = 2 (F_h - F_e),
    their difference is (M s + 2 B + 2 C) (V_m - V_s) = 0.
    """
    _, result = Analyze("one_dof", "four_channel")
    expected = result.environment[:, 0, 0] + 0.5j * W
    assert_allclose(result.undelayed[:, 0, 0], expected, rtol=1e-7)
    assert np.abs(result.transmitted - result.environment).max() > 0.5


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", Slow(["one_dof", "two_dof_combined"]))
@pytest.mark.parametrize(
    ("kind", "is_stable"),
    [
        ("wave_variables", True),
        ("proportional_damping", True),
        ("direct_force", False),
        ("four_channel", False),
        ("smith_predictor", False),
        ("adaptive_backstepping", False),
    ],
)
def test_absolute_stability(name, kind, is_stable):
    """Waves and P+d (4 B_m B_s = 2 T^2 K^2) are passive, the others are not."""
    for point in (0, 2):
        _, result = Analyze(name, kind, point)
        assert result.ToRecord()["absolutely_stable"] is is_stable
        assert result.llewellyn.shape == (len(W), result.environment.shape[1])


@pytest.mark.parametrize(("share", "is_stable"), [(0.99, True), (1.01, False)])
def test_proportional_damping_is_passive_as_published(share, is_stable):
    """The condition is 4 B_m B_s > (T_f + T_r)^2 K^2, with the robot's damping in B_s.

    E. Nuno, L. Basanez and R. Ortega, Automatica 47 (2011). It is sharp here.
    """
    B_m = 0.92
    B_s = 0.7
    c = 0.1
    T = 0.2
    K = share * np.sqrt(4 * B_m * (B_s + c)) / T
    scenario = LoadScenario(
        "one_dof",
        {
            "controller.kind": "proportional_damping",
            "forward_channel.delay": 0.05,
            "return_channel.delay": 0.15,
            "controller.proportional_damping.stiffness": float(K),
            "controller.proportional_damping.master_damping": B_m,
            "controller.proportional_damping.slave_damping": B_s,
        },
    )
    result = AnalyzeTransparency(
        scenario,
        OperatingPoints(scenario)[1],
        frequencies=np.geomspace(0.01, 10, 300),
    )
    assert result.ToRecord()["absolutely_stable"] is is_stable


def test_wave_variables_on_the_arm_are_passive():
    """y + y^H >= 0 for all axes, and the scattering norm of each axis is at most 1."""
    scenario, result = Analyze("two_dof_combined", "wave_variables", 2)
    model = Linearizer(scenario, at_ports=True).TwoPort(result.point)
    y = model.Admittance(W, forward_delay=0.07, return_delay=0.13)
    least = np.linalg.eigvalsh(y + np.conj(np.swapaxes(y, 1, 2)))[:, 0]
    assert least.min() > -1e-9
    for axis in (0, 1):
        assert scattering_norm(y[:, axis::2, axis::2]).max() < 1 + 1e-9


def test_the_arm_is_felt_by_direct_force():
    scenario, result = Analyze("two_dof_combined", "direct_force", 1)
    assert result.transmitted.shape == (40, 2, 2)
    assert np.all(result.environment == 0)
    # At high frequencies the felt impedance is that of the tool's inertia.
    model = Linearizer(scenario, at_ports=True).TwoPort(result.point)
    inertia = -np.linalg.inv(model.system.B[2:4, 2:4])
    assert_allclose(result.undelayed[-1] / (1j * W[-1]), inertia, rtol=1e-2)


def test_no_layer():
    scenario = LoadScenario("one_dof", {"environment.layers": []})
    (point,) = OperatingPoints(scenario)
    assert np.all(EnvironmentImpedance(scenario, point, W) == 0)
    y = np.tile(np.array([[2.0, 0.0], [0.0, 1.0]]), (40, 1, 1))
    load = np.ones((40, 1, 1))
    assert_allclose(TransmittedImpedance(y, load), 0.5 * load)


def test_figure():
    _, result = Analyze("two_dof_combined", "wave_variables")
    figure = PlotTransparency([result, result])
    top, _, bottom, _ = figure.axes
    assert len(top.lines) == 5 and len(bottom.lines) == 3
    assert top.get_ylabel() == "|impedance| [N s/m]"
    assert_allclose(top.lines[2].get_ydata(), np.abs(result.transmitted[:, 0, 0]))
    with pytest.raises(ValueError, match=r"points = \[\]"):
        PlotTransparency([])
