"""Blocks with a plant inside have the slopes of what they compute."""

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff

from teleop_drake.laws.gaussian_network import GaussianNetwork
from teleop_drake.laws.task_space import PostureGains
from teleop_drake.laws.tracking import TrackingGains
from teleop_drake.numerics.differences import differentiate
from teleop_drake.robots import Puma560Config
from teleop_drake.systems.gravity_compensation import GravityCompensation
from teleop_drake.systems.network_tracking_controller import NetworkTrackingController
from teleop_drake.systems.posture_hold import PostureHold

PUMA = Puma560Config(start=[0.6, -0.15, 0.4])
POSTURE = PUMA.JointPositions(np.array(PUMA.start))


def Hold(keeps_orientation):
    return PostureHold(
        plant=PUMA.LoadPlant(),
        num_axes=3,
        tool_name="tool",
        joint_positions=POSTURE,
        gains=PostureGains(frequency=10.0, damping_ratio=1.0, near=1e-3, damping=0.1),
        keeps_orientation=keeps_orientation,
    )


def Tracking():
    network = GaussianNetwork(lower=[-1] * 3, upper=[1] * 3, count=[2] * 3, width=1.0)
    gains = TrackingGains(Lambda=20 * np.eye(3), G1=np.eye(3), beta=5.0, nu=0.1)
    plant = PUMA.LoadPlant([0, 0, -9.81])
    return NetworkTrackingController(gains=gains, network=network, plant=plant)


@pytest.mark.parametrize(
    "block",
    [
        lambda: GravityCompensation(model=PUMA.LoadPlant([0, 0, -9.81])),
        lambda: Hold(True),
        lambda: Hold(False),
        Tracking,
    ],
    ids=["gravity", "orientation", "posture", "tracking"],
)
def test_slopes_are_those_of_the_block(block):
    block = block()
    ports = [block.get_input_port(i) for i in range(block.num_input_ports())]
    sizes = [block.num_continuous_states(), *(port.size() for port in ports)]
    x = 0.1 * np.random.default_rng(0).normal(size=sum(sizes))
    for port, end in zip(ports, np.cumsum(sizes)[1:], strict=True):
        if port.get_name() in ("plant_state", "joint_position"):
            x[end - port.size() : end][:6] += POSTURE

    def Evaluate(system, x):
        context = system.CreateDefaultContext()
        state, *values = np.split(x, np.cumsum(sizes)[:-1])
        for i, value in enumerate(values):
            system.get_input_port(i).FixValue(context, value)
        seen = [
            system.get_output_port(i).Eval(context)
            for i in range(system.num_output_ports())
        ]
        if len(state):
            context.SetContinuousState(state)
            seen.append(system.EvalTimeDerivatives(context).CopyToVector())
        return np.concatenate(seen)

    expected = differentiate(lambda x: Evaluate(block, x), x, np.full(len(x), 0.01))
    dual = Evaluate(block.ToAutoDiffXd(), InitializeAutoDiff(x).ravel())
    scale = np.abs(expected).max()
    np.testing.assert_allclose(ExtractGradient(dual), expected, atol=1e-7 * scale)
