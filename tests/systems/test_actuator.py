"""The drive: by closed forms, in the loop, and in its linear model."""

import numpy as np
import pytest
from drive_bandwidth import PICTURE, Main, Measure
from matplotlib.image import imread
from pydrake.systems.analysis import Simulator

from teleop_drake.analysis.stability import AnalyzeStability
from teleop_drake.compiler.check import CheckKernel
from teleop_drake.scenario import CONTROLLERS, LoadScenario, ScenarioError
from teleop_drake.systems.actuator import Actuator, ActuatorConfig
from teleop_drake.teleoperator import MakeTeleoperator


@pytest.mark.parametrize(("command", "end"), [(0.3, 0.3), (2.0, 0.5), (-2.0, -0.5)])
def test_step_response(command, end):
    """F_m = F_l (1 - exp(-w t)) with the limited command F_l, and friction."""
    config = ActuatorConfig(bandwidth=20.0, force_limit=0.5, viscous_friction=0.1)
    drive = Actuator(config, num_axes=2)
    simulator = Simulator(drive)
    context = simulator.get_mutable_context()
    drive.GetInputPort("commanded_force").FixValue(context, [command, 0.0])
    drive.GetInputPort("tool_velocity").FixValue(context, [1.0, 2.0])
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    simulator.AdvanceTo(0.07)
    force = drive.get_output_port().Eval(context)
    expected = [end * (1 - np.exp(-1.4)) - 0.1, -0.2]
    np.testing.assert_allclose(force, expected, atol=1e-7)


@pytest.mark.parametrize(
    "config",
    [
        {"bandwidth": 20.0, "force_limit": 0.5, "coulomb_friction": 0.1},
        {"viscous_friction": 0.1},
        {},
    ],
)
def test_its_kernels_are_the_blocks(config):
    assert CheckKernel(Actuator(ActuatorConfig(**config), num_axes=2)) == []


def test_an_ideal_drive_leaves_the_diagram_as_it_is():
    diagram = MakeTeleoperator(LoadScenario("one_dof"))
    station = diagram.GetSubsystemByName("controller")
    assert not station.HasSubsystemNamed("actuator")
    assert not station.HasOutputPort("commanded_force")


def test_figure_2_1_stays():
    scenario = LoadScenario("one_dof", {"actuator.bandwidth": 100.0})
    diagram = MakeTeleoperator(scenario)
    names = [system.get_name() for system in diagram.GetSystems()]
    assert sorted(names) == [
        "controller",
        "environment",
        "forward_channel",
        "master",
        "return_channel",
        "robot",
    ]
    station = diagram.GetSubsystemByName("controller")
    assert station.GetSubsystemByName("actuator").HasSubsystemNamed("force_lag")


def test_analyze_knows_the_lag():
    """Direct force on one axis by hand, as without it times w/(s + w)."""
    overrides = {"controller.kind": "direct_force", "actuator.bandwidth": 7.0}
    point = AnalyzeStability(LoadScenario("one_dof", overrides))["tissue"]
    frequencies = np.geomspace(0.05, 100, 20)
    s = 1j * frequencies
    expected = (25 * s + 50) / ((s + 25) * (0.5 * s**2 + 0.6 * s + 0.01))
    np.testing.assert_allclose(
        point.loop.frequency_response(frequencies)[:, 0, 0],
        expected * 7 / (s + 7),
        rtol=1e-7,
    )


def test_analyze_knows_the_slope_of_friction():
    """At 1 mm/s it is F_C v_s^2/(v^2 + v_s^2)^(3/2) + B more than the robot's."""
    overrides = {
        "controller.kind": "direct_force",
        "actuator.coulomb_friction": 2e-3,
        "actuator.viscous_friction": 0.3,
        "actuator.friction_speed": 1e-3,
    }
    point = AnalyzeStability(LoadScenario("one_dof", overrides))["tissue"]
    slope = 0.6 + 0.3 + 2.0 / 2**1.5
    s = 1j * np.geomspace(0.05, 100, 20)
    expected = (25 * s + 50) / ((s + 25) * (0.5 * s**2 + slope * s + 0.01))
    np.testing.assert_allclose(
        point.loop.frequency_response(s.imag)[:, 0, 0], expected, rtol=1e-5
    )


def test_which_drives_let_case_ii_come_to_rest():
    """As the page on robots says."""
    case, (direct, adaptive) = "two_dof_collision", CONTROLLERS
    rests = {w: Measure(case, adaptive, w)["collision.settling_time"] for w in (30, 20)}
    assert rests[30] is not None and rests[20] is None
    lost = {w: Measure(case, direct, w)["diverged_at"] for w in (100, 30)}
    assert lost[100] is None and lost[30] is not None


@pytest.mark.parametrize(
    ("field", "allowed"),
    [
        ("bandwidth", "> 0 (rad/s)"),
        ("force_limit", "> 0 (N)"),
        ("coulomb_friction", ">= 0 (N)"),
        ("friction_speed", "> 0 (m/s)"),
        ("viscous_friction", ">= 0 (N s/m)"),
    ],
)
def test_what_is_refused(field, allowed):
    with pytest.raises(ScenarioError) as error:
        LoadScenario("one_dof", {f"actuator.{field}": -1.0})
    expected = f"actuator.{field} = -1.0: must be a finite number {allowed}"
    assert str(error.value) == expected


@pytest.mark.slow
def test_the_committed_picture_is_that_of_the_runs(tmp_path):
    """Pixel by pixel but for the rendering of fonts, which may differ."""
    Main(tmp_path / "now.png")
    committed, now = imread(PICTURE), imread(tmp_path / "now.png")
    assert now.shape == committed.shape
    assert np.mean(np.abs(now - committed)) < 0.002
