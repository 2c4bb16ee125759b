"""The sampled sensor: by itself, in the loop, and what of it is refused."""

import numpy as np
import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Sine, VectorLogSink

from teleop_drake.model.blocks.systems.sampled_sensor import SampledSensor
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import CheckSteps, LoadScenario, ScenarioError
from teleop_drake.study.analysis.stability import AnalyzeStability


def Samples(sensor, end):
    """What a sensor shows of sin(3 t), in the middle between samples of 10 ms."""
    builder = DiagramBuilder()
    sine = builder.AddNamedSystem("sine", Sine(1.0, 3.0, 0.0, 1))
    builder.AddNamedSystem("sensor", sensor)
    builder.Connect(sine.get_output_port(0), sensor.get_input_port())
    sinks = []
    for name in ("sample", "rate"):
        sinks.append(builder.AddNamedSystem(name, VectorLogSink(1, 0.005)))
        builder.Connect(sensor.GetOutputPort(name), sinks[-1].get_input_port())
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(end)
    logs = [sink.FindLog(simulator.get_context()).data()[0] for sink in sinks]
    return [log[1::2] for log in logs]


def test_it_holds_and_quantises_and_takes_differences():
    sensor = SampledSensor(sample_period=0.01, initial_value=[9.0], resolution=0.1)
    sample, rate = Samples(sensor, 1.0)
    t = 0.01 * np.arange(len(sample))
    expected = 0.1 * np.round(np.sin(3 * t) / 0.1)
    assert_allclose(sample, expected, atol=1e-12)
    assert_allclose(rate[1:], np.diff(expected) / 0.01, atol=1e-9)
    assert rate[0] == 0


def test_noise_is_that_of_the_seed_and_of_the_stream():
    def Noise(seed, stream):
        sensor = SampledSensor(
            sample_period=0.01,
            initial_value=[0.0],
            noise=0.2,
            seed=seed,
            stream=stream,
        )
        sample, _ = Samples(sensor, 3.0)
        return sample - np.sin(0.03 * np.arange(len(sample)))

    first = Noise(1, "force")
    assert np.std(first) == pytest.approx(0.2, rel=0.1)
    assert_array_equal(first, Noise(1, "force"))
    for other in (Noise(2, "force"), Noise(1, "encoder")):
        assert abs(np.corrcoef(first, other)[0, 1]) < 0.2


def test_its_kernel_is_the_block():
    sensor = SampledSensor(
        sample_period=0.01, initial_value=[0.0, 1.0], resolution=1e-3, noise=0.1, seed=4
    )
    assert CheckKernel(sensor, num_states=3) == []


SENSOR = {
    "sensor.encoder": {"sample_period": 0.001, "resolution": 1e-6},
    "sensor.force": {"sample_period": 0.002, "noise": 1e-4},
    "duration": 0.05,
}


def test_the_law_gets_what_is_measured():
    run = simulate(LoadScenario("one_dof", SENSOR))
    steps = run["measured_position"][-10:] / 1e-6
    assert_allclose(steps, np.round(steps), atol=1e-6)
    assert_array_equal(
        run["return_packet_sent"],
        np.hstack([run["measured_position"], run["measured_velocity"]]),
    )
    error = run["measured_force"] - run["environment_force"]
    assert 2e-5 < np.std(error) < 5e-4
    assert "commanded_force" not in run.signals


def test_a_linear_model_is_refused():
    with pytest.raises(ScenarioError) as error:
        AnalyzeStability(LoadScenario("one_dof", SENSOR))
    assert "controller.encoder_sensor = a state that is not continuous" in str(error)


@pytest.mark.parametrize(
    ("path", "value", "allowed"),
    [
        ("encoder.sample_period", 0.0, "a finite number >= 1e-06 (s)"),
        ("force.resolution", -1.0, "a finite number >= 0"),
        ("encoder.noise", 0.1, "0 without a sample_period"),
        ("seed", -1, "a whole number >= 0"),
    ],
)
def test_what_is_refused(path, value, allowed):
    with pytest.raises(ScenarioError) as error:
        LoadScenario("one_dof", {f"sensor.{path}": value})
    assert str(error.value) == f"sensor.{path} = {value}: must be {allowed}"


def test_too_many_samples_are_refused():
    scenario = LoadScenario("one_dof", {"sensor.force.sample_period": 1e-6})
    with pytest.raises(ScenarioError, match=r"with sensor.force.sample_period = 1e-06"):
        CheckSteps(scenario)
