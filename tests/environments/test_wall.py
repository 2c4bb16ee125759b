"""Tests of the environments behind one plane."""

import numpy as np
import pytest
from walls import KINDS, Refusal

from teleop_drake.analysis.stability import AnalyzeStability
from teleop_drake.compiler.check import CheckKernel
from teleop_drake.environments import (
    FrictionWallConfig,
    HuntCrossleyConfig,
    StandardLinearSolidConfig,
)
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.tasks.metrics import RunMetrics


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
    (surface,), (told,) = block.Surfaces(), config.Surfaces(np.zeros(n))
    assert surface.ToRecord() == told.ToRecord() and surface.name == "contact"
    context = block.CreateDefaultContext()
    across = np.linalg.svd(surface.normal_W[np.newaxis])[2][1:].sum(axis=0)
    for depth in (-0.1, 0.1):
        p_WT = surface.point_W + depth * surface.normal_W + across
        block.GetInputPort("tool_position").FixValue(context, p_WT)
        block.GetInputPort("tool_velocity").FixValue(context, 0 * p_WT)
        F_e = block.GetOutputPort("environment_force").Eval(context)
        np.testing.assert_allclose(F_e, surface.Along(F_e) * surface.normal_W)
        assert (surface.Along(F_e) > 0) == (depth > 0)


@pytest.mark.parametrize("kind", KINDS)
def test_both_engines_run_into_it(kind):
    scenario = Collision(
        kind, "duration=2.2", "controller.kind=direct_force", "simulator.accuracy=1e-9"
    )
    runs = [simulate(scenario, engine=engine) for engine in ("drake", "compiled")]
    drake, compiled = map(RunMetrics, runs)
    assert drake["collision"]["peak_force"] > 0.1
    for key in ("time", "velocity", "peak_force", "rebound_velocity"):
        expected = pytest.approx(drake["collision"][key], rel=1e-6)
        assert compiled["collision"][key] == expected
    (surface,) = runs[0].surfaces
    (contact, *_) = runs[0].EventTimes("contact")
    p_WT = runs[0].Interpolate("tool_position", np.array([contact]))
    assert surface.Depth(p_WT) == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_it_has_a_linear_model(kind):
    scenario = Collision(kind, "controller.kind=direct_force")
    points = AnalyzeStability(scenario).points
    assert [x.model.point.name for x in points] == ["empty", "contact"]
    assert points[-1].model.trim_residual < 1e-9
    assert all(point.model.by_differences == () for point in points)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("direction: [0, 0]", "environment.direction = [0.0, 0.0]: must be"),
        ("direction: [1]", "environment.direction = [1.0]: must be"),
        ("start: .inf", "environment.start = inf: must be"),
        ("start: 0.5", "robot.start = [0.85, 0.0]: must be in front"),
    ],
)
def test_refuses(change, message):
    assert Refusal("hunt_crossley", change).startswith(message)
