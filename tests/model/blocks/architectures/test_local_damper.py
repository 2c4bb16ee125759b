"""The local damper, against the ground and the command, in each architecture."""

from dataclasses import replace

import numpy as np
import pytest
from block_checks import AssertFeedthroughIsReal
from grids import Slow
from numpy.testing import assert_allclose

from teleop_drake.model.blocks.architectures import ARCHITECTURE_KINDS
from teleop_drake.model.blocks.architectures.local_damper import (
    AGAINST,
    LocalDamperConfig,
)
from teleop_drake.model.laws.two_port import llewellyn
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.stations import MakeArchitecture
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoints

# H(s) = K/s + ... in N/m, friction of the slider in N s/m
K_HAND = 2.0
RAIL = 0.1
T_F = 0.05
T_R = 0.3
D = 1.5  # N s/m

# Of each kind: its settings with dampers D, and by how much the tool is behind the
# command in s, by its equations for a constant speed in free space, with the dampers'
# resistance R, which is D against the ground and 0 against the command. The handle is
# behind by F_h/(K v_d), where F_h is the operator's force.
T = T_F + T_R
SPRING = 5.0
KINDS = {
    "damped_force": ({"damping": D}, lambda R: (RAIL + R) / K_HAND - T_R),
    "wave_variables": (
        {"impedance": D},
        lambda R: (RAIL + R) / K_HAND + (T_F - T_R) / 2 + RAIL * T / (2 * D),
    ),
    "proportional_damping": (
        {"stiffness": SPRING, "master_damping": D, "slave_damping": D},
        lambda R: (RAIL + 2 * R + SPRING * T) / K_HAND + T_F + (RAIL + R) / SPRING,
    ),
    "smith_predictor": (
        {"local_damping": D, "stiffness": 0.0, "damping": RAIL + D},
        lambda R: (RAIL + R) / K_HAND + T_F,
    ),
    "four_channel": (
        {"variant": "position_force", "master_damping": D, "C_s.stiffness": SPRING},
        lambda R: R / K_HAND + T_F + RAIL / SPRING,
    ),
    "time_domain_passivity": ({"local_damping": D}, None),
}


def Scenario(kind, against, name="one_dof", **overrides):
    settings = {f"controller.{kind}.{key}": x for key, x in KINDS[kind][0].items()}
    settings |= {"controller.kind": kind, f"controller.{kind}.against": against}
    delays = {"forward_channel.delay": T_F, "return_channel.delay": T_R}
    return LoadScenario(name, settings | delays | overrides)


def test_every_kind_with_a_damper_is_here():
    damped = {
        kind.kind
        for kind in ARCHITECTURE_KINDS.kinds
        if issubclass(kind, LocalDamperConfig)
    }
    assert damped == set(KINDS)


@pytest.mark.parametrize("kind", ["wave_variables", "proportional_damping"])
def test_each_side_depends_on_what_its_equations_contain(kind):
    architecture = MakeArchitecture(Scenario(kind, "command"))
    AssertFeedthroughIsReal(architecture.master_side)
    AssertFeedthroughIsReal(architecture.slave_side)


@pytest.mark.parametrize("kind", KINDS)
def test_another_reference_is_refused(kind):
    with pytest.raises(ScenarioError, match=rf"controller.{kind}.against = 'bone'"):
        Scenario(kind, "bone")


@pytest.mark.parametrize("against", AGAINST)
@pytest.mark.parametrize(
    "kind", Slow([kind for kind in KINDS if KINDS[kind][1]], but=[1, 2])
)
def test_the_arrival_is_that_of_the_closed_form(kind, against):
    """The tool follows at a constant distance, and reaches the bone later by it.

    What is left of the start decays slowest with P+d.
    """
    layers = [
        {"name": "free", "start": 0.0},
        {"name": "bone", "start": 0.015, "stiffness": 150.0, "reference": 0.015},
    ]
    scenario = Scenario(kind, against, **{"environment.layers": layers})
    expected = 15.0 + KINDS[kind][1](D if against == "ground" else 0.0)
    (contact, *_) = simulate(scenario).EventTimes("contact")
    assert contact == pytest.approx(expected, abs=1e-2)


@pytest.mark.parametrize("kind", Slow([*KINDS], but=[1, 3]))
def test_the_two_port_does_not_know_the_reference(kind):
    """v_d comes from outside, so passivity and felt stiffness are the same.

    Only the admittance of the command, which is no port, differs.
    """
    frequencies = np.geomspace(0.1, 30.0, 7)
    found = []
    for against in AGAINST:
        scenario = Scenario(kind, against)
        point = replace(OperatingPoints(scenario)[-1], velocity=np.zeros(1))
        model = Linearizer(scenario, at_ports=True).TwoPort(point)
        found.append(model.Admittance(frequencies, forward_delay=T_F, return_delay=T_R))
    assert_allclose(found[1], found[0], rtol=1e-12)
    if kind == "wave_variables":
        assert llewellyn(found[1]).min() >= 1.0


@pytest.mark.parametrize(
    ("name", "arrival", "rest"),
    Slow(
        [
            ("two_dof_collision", 1.597, 0.480),
            ("two_dof_combined", 2.658, 0.489),
            ("one_dof", 15.08, 0.589),
        ],
        but=[0],
    ),
)
def test_waves_are_quick_with_the_damper_against_the_command(name, arrival, rest):
    """With b = 5.9 N s/m and 0.1 s each way."""
    waves = {"impedance": 5.9, "against": "command"}
    settings = {f"controller.wave_variables.{key}": x for key, x in waves.items()}
    settings |= {"controller.kind": "wave_variables", "simulator.accuracy": 1e-8}
    found = RunMetrics(simulate(LoadScenario(name, settings)))["collision"]
    assert found["time"] == pytest.approx(arrival, rel=3.5e-4)
    assert found["rest_time"] == pytest.approx(rest, abs=6e-4)
