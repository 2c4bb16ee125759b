"""The drive: by closed forms, in the loop, and in its linear model."""

import numpy as np
import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator

from teleop_drake.model.blocks.systems.actuator import (
    Actuator,
    ActuatorConfig,
    GearFriction,
)
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.analysis.stability import AnalyzeStability


@pytest.mark.parametrize(("command", "end"), [(0.3, 0.3), (-2.0, -0.5)])
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
    assert_allclose(force, expected, atol=1e-7)


def test_its_kernels_are_the_blocks():
    config = {"bandwidth": 20.0, "force_limit": 0.5, "coulomb_friction": 0.1}
    for given in (config, {}):
        assert CheckKernel(Actuator(ActuatorConfig(**given), num_axes=2)) == []
    with pytest.raises(ValueError, match=r"viscous = -1.0: must be a finite number >"):
        GearFriction(num_axes=1, coulomb=0.1, speed=0.1, viscous=-1.0)


def test_an_ideal_drive_leaves_the_diagram_as_it_is():
    diagram = MakeTeleoperator(LoadScenario("one_dof"))
    station = diagram.GetSubsystemByName("controller")
    assert not station.HasSubsystemNamed("actuator")
    assert not station.HasOutputPort("commanded_force")


def test_the_drive_is_inside_of_the_controller():
    diagram = MakeTeleoperator(LoadScenario("one_dof", {"actuator.bandwidth": 100.0}))
    assert len(diagram.GetSystems()) == 6
    station = diagram.GetSubsystemByName("controller")
    assert station.GetSubsystemByName("actuator").HasSubsystemNamed("force_lag")


def test_analyze_knows_the_lag():
    """Direct force on one axis by hand, as without it times w/(s + w)."""
    overrides = {"controller.kind": "direct_force", "actuator.bandwidth": 7.0}
    point = AnalyzeStability(LoadScenario("one_dof", overrides))["tissue"]
    frequencies = np.geomspace(0.05, 100, 20)
    s = 1j * frequencies
    expected = (25 * s + 50) / ((s + 25) * (0.5 * s**2 + 0.6 * s + 0.01))
    assert_allclose(
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
    assert_allclose(point.loop.frequency_response(s.imag)[:, 0, 0], expected, rtol=1e-5)


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
