"""The robust law as a block and as a kind: what derives, and what is refused."""

import numpy as np
import pytest
from kernel_checks import CheckKernel

from teleop_drake.model.blocks.architectures.robust_backstepping import (
    RobustBackstepping,
)
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.stations import MakeArchitecture


def Load(name="two_dof_combined", **changes):
    changes = {f"controller.{key}": value for key, value in changes.items()}
    return LoadScenario(name, {"controller.kind": "robust_backstepping", **changes})


def Bounds(scenario):
    facts = scenario.Facts()
    controller = scenario.controller.Chosen()
    gains = controller.Resolve(facts, "controller")
    return controller.robust.Bounds(gains, facts, "controller.robust")


def test_bounds_derive_from_speed_and_gains():
    # |v_d| = 0.1 m/s, Lambda = P = 1, G2 = 30/s.
    assert Bounds(Load()) == pytest.approx((0.0, 0.1, 3.0, 0.1))
    assert Bounds(Load(Lambda=2.0, P=3.0)) == pytest.approx((0.0, 0.3, 1.5, 0.05))
    given = {"acceleration_bound": 0.4, "force_width": 0.7}
    assert Bounds(Load(robust=given)) == pytest.approx((0.4, 0.1, 3.0, 0.7))


def test_its_kernel_is_the_law():
    scenario = Load("one_dof", robust={"acceleration_bound": 0.4})
    law = MakeArchitecture(scenario).slave_side.GetSubsystemByName(
        "robust_backstepping"
    )
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
def test_what_is_refused(key, value, allowed):
    with pytest.raises(ScenarioError) as error:
        Load(kind="direct_force", robust={key: value})
    message = f"controller.robust.{key} = {value}: must be a finite number {allowed}"
    assert str(error.value) == message


def test_without_a_speed_the_widths_have_to_be_given():
    scenario = Load()
    scenario.surgeon.velocity = np.zeros(2)
    with pytest.raises(ScenarioError, match=r"robust.velocity_width = null: must be g"):
        Bounds(scenario)
