"""The same motion with other forces and masses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scaled_forces import ScaleForces

from teleop_drake.model.blocks.robots.slider import SliderConfig
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import (
    ARCHITECTURES,
    LoadScenario,
    ScenarioError,
)
from teleop_drake.model.tasks.metrics import RunMetrics

# Fast enough that what is learned matters: with one rate for all three laws the tool
# does not even come back from the bone.
FAST = {
    "surgeon.velocity": [0.05],
    "surgeon.contact_force": [0.2],
    "duration": 3.0,
    "simulator.accuracy": 1e-10,
}


def Collision(scenario, *names):
    collision = RunMetrics(simulate(scenario, engine="compiled"))["collision"]
    return [collision[name] for name in names]


def test_a_slider_ten_times_as_heavy_moves_alike():
    scenario = LoadScenario("one_dof", FAST)
    names = "rebound_velocity", "settling_time"
    assert_allclose(
        Collision(ScaleForces(scenario, 10), *names),
        Collision(scenario, *names),
        rtol=1e-5,
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", ARCHITECTURES)
def test_without_forgetting_it_is_exact(kind):
    changes = {**FAST, "controller.leakage": 0.0, "controller.supervision": 0.0}
    scenario = LoadScenario("one_dof", {**changes, "controller.kind": kind})
    names = "time", "velocity", "rebound_velocity", "peak_force"
    one, ten = (Collision(x, *names) for x in (scenario, ScaleForces(scenario, 10)))
    assert_allclose(ten, np.multiply(one, [1, 1, 1, 10]), rtol=1e-7)


@pytest.mark.parametrize("name", ["needle_insertion", "wall_sliding"])
def test_the_pumas_tasks_are_the_light_arms_ten_times_as_heavy(name):
    puma = LoadScenario(f"puma560_{name}")
    scaled = ScaleForces(LoadScenario(name), 10, robot=puma.robot)
    for key in ("surgeon", "haptic_device"):
        assert str(getattr(scaled, key)) == str(getattr(puma, key))
    for key in ("Lambda", "G1", "G2", "P", "beta1", "beta2", "beta3"):
        value = getattr(puma.controller, key)
        assert getattr(scaled.controller, key) == pytest.approx(value, rel=1e-12)


def test_what_cannot_be_scaled_is_refused():
    with pytest.raises(
        ScenarioError, match=r"robot\.model = 'two_link_arm': must be a"
    ):
        ScaleForces(LoadScenario("two_dof_combined"), 10)
    own = LoadScenario("one_dof", {"robot": {"model": "slider", "start": [0.0]}})
    with pytest.raises(
        ScenarioError, match=r"robot\.model = 'slider': must be a slider"
    ):
        ScaleForces(own, 10)
    heavy = SliderConfig(start=np.zeros(1), mass=5.0, damping=1.0)
    assert ScaleForces(own, 10, robot=heavy).robot.mass == 5.0
    with pytest.raises(ScenarioError, match="factor = 0: must be"):
        ScaleForces(own, 0)
