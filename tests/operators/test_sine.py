"""The sine against its closed form, in the loop."""

import numpy as np
import pytest

from teleop_drake.operators.sine import SineConfig, SineOperator
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.tasks import TaskOf


def test_steps_are_short_against_the_period():
    config = SineConfig(velocity=np.array([0.1]), frequency=200.0)
    dut = config.MakeOperator(start=[0.0])
    assert dut.longest_step == config.LongestStep() < 2 * np.pi / 200 / 10
    with pytest.raises(ValueError, match="frequency = 0"):
        SineOperator(velocity=[0.1], frequency=0.0)


def test_a_mass_swings_as_its_transfer_function_says():
    """Without delay, in empty space: v/v_d = H/(m s + d + H)."""
    w = 3.0
    scenario = LoadScenario(
        "one_dof",
        {
            "surgeon.kind": "sine",
            "surgeon.frequency": w,
            "controller.kind": "direct_force",
            "environment.layers": [],
            "forward_channel.delay": 0,
            "return_channel.delay": 0,
            "duration": 12.0,
            "simulator.accuracy": 1e-7,
            "simulator.max_step_size": 0.05,
        },
    )
    recording = simulate(scenario)
    s = 1j * w
    H = (25 * s + 50) / (s * s + 25 * s)
    gain = H / (0.5 * s + 0.1 + H)
    late = recording.time > 9.0
    time = recording.time[late]
    expected = (0.001 * gain * np.exp(s * time)).imag
    v = recording["tool_velocity"][late, 0]
    np.testing.assert_allclose(v, expected, atol=2e-3 * 0.001 * abs(gain))
    # The excess over the momentary command, not over its amplitude.
    metrics = TaskOf(scenario).Metrics(recording)
    peak = 0.001 * abs(gain - 1)
    assert not recording.has_constant_command
    assert metrics["start_velocity_overshoot"] > 0.8 * peak
