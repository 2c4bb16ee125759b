"""The passivity observer and controller at the master by itself."""

import numpy as np
from blocks import Block, Feedthrough

from teleop_drake.architectures.time_domain_passivity import PassivityMaster

SCALE, HORIZON = 0.01, 0.05


def Make():
    return PassivityMaster(
        num_axes=2, horizon=HORIZON, maximum_mobility=4.0, energy_scale=SCALE
    )


def At(F_h, v, E_received, energies):
    """The block with [E_in; E_out] in J."""
    packet = np.concatenate([[0.7, 0.8], v, E_received])
    inputs = {"haptic_force": F_h, "velocity_command": [9, 9], "return_packet": packet}
    return Block(Make(), inputs, np.array(energies) / SCALE)


def test_what_can_be_paid_for_passes():
    now = At([1.0, -2.0], [0.1, 0.2], [0.5, 0.5], [0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(now["master_budget"], [0.2, 0.1])
    np.testing.assert_array_equal(now["injected_mobility"], [0.0, 0.0])
    np.testing.assert_array_equal(now["felt_velocity"], [0.1, 0.2])
    np.testing.assert_array_equal(now["felt_position"], [0.7, 0.8])
    np.testing.assert_allclose(now["forward_packet"], [1.0, -2.0, 0.1, 0.2])
    power = np.array([0.1, -0.4])
    np.testing.assert_allclose(now["master_power"], power)
    np.testing.assert_allclose(now.Rate() * SCALE, [0.1, 0.0, 0.0, 0.4])


def test_what_cannot_is_brought_down_to_the_budget():
    now = At([1.0, -2.0], [-1.0, 1.0], [0.01, 0.0], [0.0, 0.0, 0.0, 0.0])
    # 1 W would leave where 0.01 J / 0.05 s may; nothing may on the other axis.
    np.testing.assert_allclose(now["master_power"], [-0.01 / HORIZON, 0.0], atol=1e-15)
    np.testing.assert_allclose(now["injected_mobility"], [0.8, 0.5])
    np.testing.assert_allclose(now["felt_velocity"], [-0.2, 0.0], atol=1e-15)


def test_the_mobility_has_a_maximum():
    now = At([0.01, 0.01], [-1.0, -1.0], [0.0, 0.0], [0.0] * 4)
    np.testing.assert_array_equal(now["injected_mobility"], [4.0, 4.0])


def test_feedthrough():
    both = {"haptic_force", "return_packet"}
    assert Feedthrough(Make()) == {
        "felt_position": {"return_packet"},
        "felt_velocity": both,
        "forward_packet": {"haptic_force"},
        "master_budget": {"return_packet"},
        "master_power": both,
        "injected_mobility": both,
    }
