"""The tool in task space (2.6) to (2.13): the same power at the tool and the joints."""

import numpy as np
import pytest

from teleop_drake.laws.task_space import joint_torques, tool_kinematics


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("nv", [1, 2, 6])
def test_power_at_the_joints_is_power_at_the_tool(n, nv):
    random = np.random.default_rng(n + 10 * nv)
    J, p, q, qdot = (random.normal(size=size) for size in ((3, nv), 3, nv + 1, nv))
    kinematics = tool_kinematics(n, p, J, np.concatenate([q, qdot]))
    np.testing.assert_array_equal(kinematics[:n], p[:n])
    v = kinematics[n : 2 * n]
    np.testing.assert_allclose(v, (J @ qdot)[:n], rtol=1e-12)
    np.testing.assert_array_equal(kinematics[2 * n :].reshape(n, nv), J[:n])
    F_c, F_e = random.normal(size=(2, n))
    tau, tau_e = joint_torques(F_c, F_e, kinematics).reshape(2, nv)
    assert tau @ qdot == pytest.approx(F_c @ v)
    assert tau_e @ qdot == pytest.approx(-F_e @ v)
