"""Direct force with a local damper; test_agreement has its runs."""

import numpy as np
import pytest
from blocks import AssertFeedthroughIsReal, Block, RandomInputs

from teleop_drake.architectures.damped_force import DampedForce, DampedForceConfig
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.metrics import RunMetrics


def test_the_force_acts_as_it_arrives_less_that_of_the_damper():
    B = np.array([[3.0, 0.5], [0.5, 2.0]])
    slave = DampedForceConfig(damping=B).MakeArchitecture(
        LoadScenario("two_dof_combined").Facts(), "controller.damped_force"
    )
    assert slave.master_side is None
    inputs = RandomInputs(slave.slave_side, 1)
    now = Block(slave.slave_side, inputs)
    braking = B @ inputs["tool_velocity"]
    np.testing.assert_allclose(now["damping_force"], braking)
    np.testing.assert_allclose(
        now["control_force"], inputs["forward_packet"][:2] - braking
    )
    AssertFeedthroughIsReal(DampedForce(num_axes=2, damping=B))


@pytest.mark.parametrize("name", ["one_dof", "two_dof_combined", "puma560_insertion"])
def test_the_default_just_keeps_the_tool_from_oscillating(name):
    """Roots of M s^2 + B s + K, the tool on the haptic device's spring."""
    scenario = LoadScenario(name, {"controller.kind": "damped_force"})
    B, M = ResolveController(scenario).damping, scenario.Facts().inertia
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
