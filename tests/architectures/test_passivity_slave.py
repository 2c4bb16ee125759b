"""The passivity observer and controller at the slave by itself."""

import numpy as np
from blocks import Block, Feedthrough

from teleop_drake.architectures.time_domain_passivity import PassivitySlave

E_0, HORIZON = 0.02, 0.05


def Make(**damper):
    return PassivitySlave(
        num_axes=2, horizon=HORIZON, maximum_damping=4.0, initial_energy=E_0, **damper
    )


def At(F_hd, v, E_received, energies):
    """The block with [E_in; E_out] in J."""
    inputs = {
        "forward_packet": np.concatenate([F_hd, E_received]),
        "tool_position": [0.7, 0.8],
        "tool_velocity": v,
        "environment_force": [9, 9],
    }
    return Block(Make(), inputs, np.array(energies) / E_0)


def test_what_can_be_paid_for_passes():
    now = At([1.0, -2.0], [0.1, 0.2], [0.5, 0.5], [0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(now["slave_budget"], [0.22, 0.12])
    np.testing.assert_array_equal(now["injected_damping"], [0.0, 0.0])
    np.testing.assert_array_equal(now["control_force"], [1.0, -2.0])
    np.testing.assert_allclose(now["return_packet"], [0.7, 0.8, 0.1, 0.2, 0.1, 0.2])
    np.testing.assert_allclose(now["slave_power"], [0.1, -0.4])
    np.testing.assert_allclose(now.Rate() * E_0, [0.0, 0.4, 0.1, 0.0])


def test_what_cannot_is_brought_down_to_the_budget():
    now = At([2.0, 2.0], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0, 0.0, E_0])
    np.testing.assert_allclose(now["slave_power"], [E_0 / HORIZON, 0.0], atol=1e-15)
    np.testing.assert_allclose(now["injected_damping"], [1.6, 2.0])
    np.testing.assert_allclose(now["control_force"], [0.4, 0.0], atol=1e-15)


def test_the_damping_has_a_maximum():
    now = At([1.0, 1.0], [0.01, 0.01], [0.0, 0.0], [0.0, 0.0, E_0, E_0])
    np.testing.assert_array_equal(now["injected_damping"], [4.0, 4.0])


def test_a_local_damper_is_behind_the_port():
    """The energy that it takes has left the channel."""
    damper = np.array([[3.0, 0.5], [0.5, 2.0]])
    v = np.array([0.1, 0.2])
    inputs = {
        "forward_packet": [1.0, -2.0, 0.5, 0.5],
        "tool_position": [0.7, 0.8],
        "tool_velocity": v,
        "environment_force": [9, 9],
    }
    state = np.array([0.1, 0.2, 0.3, 0.4]) / E_0
    bare, damped = (
        Block(Make(**x), inputs, state) for x in ({}, {"local_damping": damper})
    )
    np.testing.assert_allclose(
        damped["control_force"], bare["control_force"] - damper @ v
    )
    np.testing.assert_array_equal(damped["slave_power"], bare["slave_power"])
    np.testing.assert_array_equal(damped.Rate(), bare.Rate())


def test_feedthrough_and_start():
    both = {"forward_packet", "tool_velocity"}
    assert Feedthrough(Make()) == {
        "control_force": both,
        "return_packet": {"tool_position", "tool_velocity"},
        "slave_budget": {"forward_packet"},
        "slave_power": both,
        "injected_damping": both,
    }
    now = At([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0] * 4)
    np.testing.assert_allclose(now["slave_budget"], [E_0, E_0])
