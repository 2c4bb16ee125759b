"""The robust law as a block and as a kind: what derives, and what is refused."""

import numpy as np
import pytest
from documentation import TEXT
from grids import Slow

from teleop_drake.architectures.robust_backstepping import RobustBackstepping
from teleop_drake.compiler.check import CheckKernel
from teleop_drake.scenario import LoadScenario, ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.stations import MakeControlLaw
from teleop_drake.tasks.metrics import RunMetrics


def Load(name="two_dof_combined", **changes):
    changes = {f"controller.{key}": value for key, value in changes.items()}
    return LoadScenario(name, {"controller.kind": "robust_backstepping", **changes})


def Bounds(scenario):
    facts, controller = scenario.Facts(), scenario.controller.Chosen()
    gains = controller.Resolve(facts, "controller")
    return controller.robust.Bounds(gains, facts, "controller.robust")


def test_bounds_derive_from_speed_and_gains():
    # |v_d| = 0.1 m/s, Lambda = P = 1, G2 = 30/s.
    assert Bounds(Load()) == pytest.approx((0.0, 0.1, 3.0, 0.1))
    assert Bounds(Load(Lambda=2.0, P=3.0)) == pytest.approx((0.0, 0.3, 1.5, 0.05))
    given = {"acceleration_bound": 0.4, "force_width": 0.7}
    assert Bounds(Load(robust=given)) == pytest.approx((0.4, 0.1, 3.0, 0.7))


SETTLES = [
    ("as in the thesis", {}),
    ("bone of 1500 N/m", {"environment.layers.bone.stiffness": 1500.0}),
    ("0.5 s each way", {"forward_channel.delay": 0.5, "return_channel.delay": 0.5}),
    ("`adaptation_rate` 1", {"controller.adaptation_rate": 1.0}),
    ("`adaptation_rate` 10", {"controller.adaptation_rate": 10.0}),
    ("`G2` 45", {"controller.G2": 45.0}),
    ("`robust.acceleration_bound` 0.4", {"controller.robust.acceleration_bound": 0.4}),
    ("`robust.force_rate_bound` 19", {"controller.robust.force_rate_bound": 19.0}),
]


@pytest.mark.parametrize(("name", "overrides"), Slow(SETTLES))
def test_table_of_the_documentation(name, overrides):
    """When the tool is at rest on the bone."""
    cells = []
    for task in ("two_dof_collision", "two_dof_combined"):
        for kind in ("adaptive_backstepping", "robust_backstepping"):
            scenario = LoadScenario(task, {"controller.kind": kind, **overrides})
            collision = RunMetrics(simulate(scenario, engine="auto"))["collision"]
            time = collision["settling_time"]
            cells.append("-" if time is None else f"{time:.3g}")
    assert f"| {name} | {' | '.join(cells)} |" in TEXT


@pytest.mark.parametrize("name", ["one_dof", "two_dof_combined"])
def test_its_kernel_is_the_law(name):
    law = MakeControlLaw(Load(name, robust={"acceleration_bound": 0.4}))
    assert isinstance(law, RobustBackstepping)
    assert CheckKernel(law, num_states=3) == []


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("acceleration_bound", -1.0, ">= 0 (m/s^2)"),
        ("velocity_width", 0.0, "> 0 (m/s)"),
        ("force_rate_bound", float("nan"), ">= 0 (N/s)"),
        ("force_width", -0.1, "> 0 (N)"),
    ],
)
@pytest.mark.parametrize("kind", ["robust_backstepping", "direct_force"])
def test_what_is_refused(key, value, allowed, kind):
    with pytest.raises(ScenarioError) as error:
        Load(kind=kind, robust={key: value})
    message = f"controller.robust.{key} = {value}: must be a finite number {allowed}"
    assert str(error.value) == message


def test_without_a_speed_the_widths_have_to_be_given():
    scenario = Load()
    scenario.surgeon.velocity = np.zeros(2)
    with pytest.raises(ScenarioError, match=r"robust.velocity_width = null: must be g"):
        Bounds(scenario)
