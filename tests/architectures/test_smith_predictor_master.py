"""The predictor by itself: what is felt and sent, and the model's own motion."""

import numpy as np
import pytest
from blocks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs
from pydrake.systems.analysis import Simulator

from teleop_drake.architectures.smith_predictor import SmithPredictorMaster

M, B = np.array([[2.0, 0.3], [0.3, 1.0]]), np.diag([0.4, 0.1])
K = np.array([[5.0, 1.0], [1.0, 4.0]])


def Make(delay=0.2):
    return SmithPredictorMaster(mass=M, damping=B, stiffness=K, delay=delay)


def test_equation():
    block = Make()
    inputs = RandomInputs(block, 1)
    y, v = np.array([0.1, 0.2]), np.array([0.3, -0.4])
    now = Block(block, inputs, np.concatenate([y, v]))
    force = inputs["haptic_force"] - B @ v - K @ y
    expected = np.concatenate([v, np.linalg.solve(M, force)])
    np.testing.assert_allclose(now.Rate(), expected, rtol=1e-12)
    p, v_ret = inputs["return_packet"].reshape(2, 2)
    np.testing.assert_array_equal(now["model_velocity"], v)
    np.testing.assert_array_equal(now["felt_position"], p)
    # The model has been at rest until now.
    np.testing.assert_allclose(now["felt_velocity"], v_ret + v, rtol=1e-12)
    sent = [*inputs["haptic_force"], *inputs["velocity_command"]]
    np.testing.assert_array_equal(now["forward_packet"], sent)


def test_the_model_is_taken_away_again_one_delay_later():
    """Under a constant force the model comes to rest, and nothing is left of it."""
    block = Make(delay=0.5)
    inputs = {name: np.zeros_like(x) for name, x in RandomInputs(block, 0).items()}
    inputs["haptic_force"] = [1.0, 0.0]
    now = Block(block, inputs)
    simulator = Simulator(block, now.context)
    simulator.get_mutable_integrator().set_maximum_step_size(0.01)
    velocities = []
    for time in (0.4, 0.9):
        simulator.AdvanceTo(time)
        velocities.append(now["model_velocity"].copy())
        delayed = velocities[0] if time == 0.9 else np.zeros(2)
        difference = now["model_velocity"] - delayed
        np.testing.assert_allclose(now["felt_velocity"], difference, atol=1e-6)
    assert np.abs(velocities[0]).max() > 0.05


@pytest.mark.parametrize("delay", [0.2, 0.0])
def test_feedthrough(delay):
    block = Make(delay)
    assert Feedthrough(block) == {
        "forward_packet": {"haptic_force", "velocity_command"},
        "felt_position": {"return_packet"},
        "felt_velocity": {"return_packet"},
    }
    AssertFeedthroughIsReal(block)
