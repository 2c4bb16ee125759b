"""The haptic device: its step response, its sign and its ports."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from teleop_drake.systems.haptic_device import HapticDevice

THESIS = {"numerator": [25, 50], "denominator": [1, 25, 0]}


def _step_response(t: float) -> float:
    """(25 s + 50)/(s^2 (s + 25)) in the time domain."""
    return 0.92 + 2.0 * t - 0.92 * np.exp(-25.0 * t)


def _make_simulator(
    device: HapticDevice, command: list[float], felt: list[float]
) -> Simulator:
    simulator = Simulator(device)
    context = simulator.get_mutable_context()
    device.GetInputPort("velocity_command").FixValue(context, command)
    device.GetInputPort("felt_velocity").FixValue(context, felt)
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    simulator.Initialize()
    return simulator


def _haptic_force(device: HapticDevice, simulator: Simulator) -> np.ndarray:
    return device.GetOutputPort("haptic_force").Eval(simulator.get_context())


def test_step_response_of_two_axes():
    device = HapticDevice(**THESIS, num_axes=2)
    # The error is v_d - v: 0.3 - 0.1 along x, 0 - 0.5 along y.
    simulator = _make_simulator(device, [0.3, 0.0], [0.1, 0.5])
    np.testing.assert_array_equal(_haptic_force(device, simulator), [0.0, 0.0])
    for t in (0.01, 0.05, 0.2, 1.0):
        simulator.AdvanceTo(t)
        np.testing.assert_allclose(
            _haptic_force(device, simulator),
            np.array([0.2, -0.5]) * _step_response(t),
            rtol=1e-7,
        )


def test_clone_of_the_context_continues_identically():
    device = HapticDevice(**THESIS, num_axes=1)
    simulator = _make_simulator(device, [1.0], [0.0])
    simulator.AdvanceTo(0.1)
    clone = Simulator(device, simulator.get_context().Clone())
    simulator = Simulator(device, simulator.get_context().Clone())
    for each in (simulator, clone):
        each.AdvanceTo(0.3)
    assert _haptic_force(device, simulator) == _haptic_force(device, clone)


@pytest.mark.parametrize(
    ("numerator", "feedthrough"), [([25, 50], False), ([1, 25, 50], True)]
)
def test_direct_feedthrough(numerator, feedthrough):
    device = HapticDevice(numerator=numerator, denominator=[1, 25, 0], num_axes=2)
    assert [device.HasDirectFeedthrough(i, 0) for i in (0, 1)] == [feedthrough] * 2


@pytest.mark.parametrize("num_axes", [1, 2, 6])
def test_ports_and_names(num_axes):
    device = HapticDevice(**THESIS, num_axes=num_axes)
    assert device.get_name() == "haptic_device"
    assert device.num_input_ports() == 2
    assert device.num_output_ports() == 1
    for port in (
        device.GetInputPort("velocity_command"),
        device.GetInputPort("felt_velocity"),
        device.GetOutputPort("haptic_force"),
    ):
        assert port.size() == num_axes
    assert device.num_continuous_states() == 2 * num_axes


def test_evaluation_stays_out_of_python():
    for system in HapticDevice(**THESIS, num_axes=1).GetSystems():
        assert type(system).__module__.startswith("pydrake.")


def test_bad_arguments():
    with pytest.raises(ValueError, match="is proper"):
        HapticDevice(numerator=[1, 0, 0], denominator=[1, 1], num_axes=1)
    with pytest.raises(ValueError, match="num_axes = 0: must be a finite number >= 1"):
        HapticDevice(**THESIS, num_axes=0)
