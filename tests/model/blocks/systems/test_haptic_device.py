"""The haptic device: its step response, its sign and its ports."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator

from teleop_drake.model.blocks.systems.haptic_device import HapticDevice

THESIS = {"numerator": [25, 50], "denominator": [1, 25, 0]}


def _step_response(t: float) -> float:
    """(25 s + 50)/(s^2 (s + 25)) in the time domain."""
    return 0.92 + 2.0 * t - 0.92 * np.exp(-25.0 * t)


def test_step_response_of_two_axes():
    device = HapticDevice(**THESIS, num_axes=2)
    simulator = Simulator(device)
    context = simulator.get_mutable_context()
    # The error is v_d - v: 0.3 - 0.1 along x, 0 - 0.5 along y.
    device.GetInputPort("velocity_command").FixValue(context, [0.3, 0.0])
    device.GetInputPort("felt_velocity").FixValue(context, [0.1, 0.5])
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    for t in (0.0, 0.01, 0.2, 1.0):
        simulator.AdvanceTo(t)
        force = device.GetOutputPort("haptic_force").Eval(context)
        expected = np.array([0.2, -0.5]) * _step_response(t)
        assert_allclose(force, expected, rtol=1e-7, atol=1e-15)


@pytest.mark.parametrize(
    ("numerator", "feedthrough"), [([25, 50], False), ([1, 25, 50], True)]
)
def test_direct_feedthrough(numerator, feedthrough):
    device = HapticDevice(numerator=numerator, denominator=[1, 25, 0], num_axes=2)
    assert [device.HasDirectFeedthrough(i, 0) for i in (0, 1)] == [feedthrough] * 2


def test_ports_and_names():
    device = HapticDevice(**THESIS, num_axes=6)
    assert device.get_name() == "haptic_device"
    inputs = [device.get_input_port(i) for i in range(device.num_input_ports())]
    names = {port.get_name(): port.size() for port in inputs}
    assert names == {"velocity_command": 6, "felt_velocity": 6}
    assert device.GetOutputPort("haptic_force").size() == 6
    assert device.num_continuous_states() == 12


def test_bad_arguments():
    with pytest.raises(ValueError, match="is proper"):
        HapticDevice(numerator=[1, 0, 0], denominator=[1, 1], num_axes=1)
    with pytest.raises(ValueError, match="num_axes = 0: must be a finite number >= 1"):
        HapticDevice(**THESIS, num_axes=0)
