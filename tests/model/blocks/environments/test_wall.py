"""Tests of the environments behind one plane."""

from dataclasses import replace

import numpy as np
import pytest
from block_checks import Block
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose

from teleop_drake.model.blocks.environments.wall import (
    FrictionWallConfig,
    HuntCrossleyConfig,
    StandardLinearSolidConfig,
)
from teleop_drake.model.blocks.robots import FactsOfRobot
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.stability import AnalyzeStability

KINDS = {
    "hunt_crossley": "stiffness: 2000, damping: 1.5",
    "friction_wall": "stiffness: 150, damping: 1, friction: 0.4",
    "standard_linear_solid": "stiffness: 40, branch_stiffness: 160",
}
"""Kinds and their fields, without where they are."""


def Refusal(kind, change):
    """Returns what is said of a scenario with a wall with a changed `field: value`."""
    fields = [*f"start: 1.0, {KINDS[kind]}".split(", "), change]
    text = ", ".join(
        f"{x}: {y}" for x, y in dict(x.split(": ") for x in fields).items()
    )
    with pytest.raises(ScenarioError) as error:
        LoadScenario("two_dof_collision", [f"environment={{kind: {kind}, {text}}}"])
    return str(error.value)


def Collision(kind, *overrides):
    """The planar arm on its way to an oblique wall."""
    wall = f"start: 0.72, direction: [4, 3], {KINDS[kind]}"
    return LoadScenario(
        "two_dof_collision",
        [
            f"environment={{kind: {kind}, {wall}}}",
            "surgeon.velocity=[0.1, 0.02]",
            "surgeon.contact_force=[0.2, 0.1]",
            *overrides,
        ],
    )


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize(
    "config",
    [
        HuntCrossleyConfig(start=-0.4, stiffness=50.0, damping=2.0),
        FrictionWallConfig(start=-0.4, stiffness=50.0, friction=0.5, creep_speed=0.1),
        StandardLinearSolidConfig(start=-0.4, stiffness=5.0, branch_stiffness=20.0),
    ],
    ids=lambda config: config.kind,
)
def test_kernel_and_surface_in_any_direction(config, n):
    config.direction = np.random.default_rng(n).normal(size=n)
    config.Check()
    block = config.MakeEnvironment(np.zeros(n))
    CheckKernel(block)
    (surface,) = block.Surfaces()
    (told,) = config.Surfaces(np.zeros(n))
    assert str(surface) == str(told) and surface.name == "contact"
    context = block.CreateDefaultContext()
    across = np.linalg.svd(surface.normal_W[np.newaxis])[2][1:].sum(axis=0)
    for depth in (-0.1, 0.1):
        p_WT = surface.point_W + depth * surface.normal_W + across
        block.GetInputPort("tool_position").FixValue(context, p_WT)
        block.GetInputPort("tool_velocity").FixValue(context, 0 * p_WT)
        F_e = block.GetOutputPort("environment_force").Eval(context)
        assert_allclose(F_e, surface.Along(F_e) * surface.normal_W)
        assert (surface.Along(F_e) > 0) == (depth > 0)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", KINDS)
def test_it_has_a_linear_model(kind):
    scenario = Collision(kind, "controller.kind=direct_force")
    points = AnalyzeStability(scenario).points
    assert [x.model.point.name for x in points] == ["empty", "contact"]
    assert points[-1].model.trim_residual < 1e-9
    assert all(point.model.by_differences == () for point in points)


NORMAL = np.array([0.8, 0.6])
ALONG = np.outer(NORMAL, NORMAL)


@pytest.mark.parametrize(
    ("config", "stiffness", "damping"),
    [
        (
            HuntCrossleyConfig(start=0.0, stiffness=2000.0, damping=1.5),
            2000 * 1.5 * 0.02**0.5 * ALONG,
            2000 * 0.02**1.5 * 1.5 * 1.5 * ALONG,
        ),
        (
            FrictionWallConfig(
                start=0.0, stiffness=150.0, friction=0.4, creep_speed=0.1
            ),
            150 * ALONG,
            150 * 0.02 * 0.4 / 0.1 * (np.eye(2) - ALONG),
        ),
        (
            StandardLinearSolidConfig(start=0.0, stiffness=5.0, branch_stiffness=20.0),
            25 * ALONG,
            0 * ALONG,
        ),
    ],
)
def test_slopes(config, stiffness, damping):
    """Of the force at rest: what it is to analyze and to the architectures."""
    config.direction = NORMAL
    K, D = config.StiffnessAndDamping(0.02 * NORMAL)
    assert_allclose(K, stiffness, rtol=1e-6, atol=1e-6)
    assert_allclose(D, damping, rtol=1e-6, atol=1e-6)


def test_equation_of_the_solid():
    config = StandardLinearSolidConfig(
        start=0.0, direction=NORMAL, stiffness=5.0, branch_stiffness=20.0
    )
    config.relaxation_time = 2.0
    motion = {"tool_position": 0.03 * NORMAL, "tool_velocity": [9.0, 9.0]}
    now = Block(config.MakeEnvironment([0, 0]), motion, [0.01])
    expected = (5 * 0.03 + 20 * (0.03 - 0.01)) * NORMAL
    assert_allclose(now["environment_force"], expected, rtol=1e-12)
    assert_allclose(now.Rate(), [(0.03 - 0.01) / 2.0], rtol=1e-12)


@pytest.mark.slow
def test_a_tool_that_rests_on_friction_creeps_in_the_linear_model():
    """With the damping mu F_n/v_s along the wall, on top of what there is without."""
    wall = "start: 1.0, stiffness: 150, creep_speed: 0.001"
    models = []
    for friction in (0.0, 0.4):
        scenario = LoadScenario(
            "two_dof_collision",
            [
                f"environment={{kind: friction_wall, {wall}, friction: {friction}}}",
                "controller.kind=direct_force",
            ],
        )
        point = OperatingPoints(scenario)[-1]
        models.append(Linearizer(scenario).Loop(point).slave.A[2:4, 2:4])
    robot = replace(scenario.robot, start=point.position).MakeRobot()
    F_n = 150 * (point.position[0] - 1.0)
    damping = 0.4 * F_n / 0.001 * np.diag([0.0, 1.0])
    expected = -np.linalg.solve(FactsOfRobot(robot).inertia, damping)
    scale = np.abs(expected).max()
    assert_allclose(models[1] - models[0], expected, atol=1e-4 * scale)


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("hunt_crossley", "direction: [0, 0]", "direction = [0.0, 0.0]: must be"),
        ("hunt_crossley", "direction: [1]", "direction = [1.0]: must be"),
        ("hunt_crossley", "start: .inf", "start = inf: must be"),
        ("hunt_crossley", "stiffness: 0", "stiffness = 0.0: must be"),
        ("hunt_crossley", "exponent: 0.5", "exponent = 0.5: must be"),
        ("hunt_crossley", "damping: -1", "damping = -1.0: must be"),
        ("hunt_crossley", "friction: 1", "friction = 1.0: must be"),
        ("friction_wall", "friction: -0.1", "friction = -0.1: must be"),
        ("friction_wall", "creep_speed: 0", "creep_speed = 0.0: must be"),
        ("standard_linear_solid", "stiffness: -1", "stiffness = -1.0: must be"),
        ("standard_linear_solid", "branch_stiffness: 0", "branch_stiffness = 0.0: mus"),
        ("standard_linear_solid", "relaxation_time: null", "relaxation_time = null: m"),
        ("standard_linear_solid", "relaxation_time: 0", "relaxation_time = 0.0: must"),
    ],
)
def test_refuses(kind, change, message):
    assert Refusal(kind, change).startswith(f"environment.{message}")


def test_refuses_a_wall_behind_the_start():
    refusal = Refusal("hunt_crossley", "start: 0.5")
    assert refusal.startswith("robot.start = [0.85, 0.0]: must be in front")
