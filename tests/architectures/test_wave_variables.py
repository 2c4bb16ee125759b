"""The wave line against its closed forms, and its energy in simulated runs."""

import math

import numpy as np
import pytest
from grids import Slow
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from runs import TASKS

from teleop_drake.architectures.wave_variables import WaveMaster, WaveSlave
from teleop_drake.channels.transport import TransportDelay
from teleop_drake.scenario import LoadScenario, ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.metrics import RunMetrics

B, T = 0.92, 0.2


def Wave(name, *overrides):
    scenario = LoadScenario(name, ["controller.kind=wave_variables", *overrides])
    return simulate(scenario, engine="auto")


def test_pushing_on_a_wall_through_the_blocks():
    """x_m = F T / (2 b): slowly enough, the line is a spring."""
    trajectory = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
        [0.0, 8.0, 10.0], np.array([[0.0, 0.3, 0.3]]), [[0.0]], [[0.0]]
    )
    builder = DiagramBuilder()
    force = builder.AddSystem(TrajectorySource(trajectory))
    rest = builder.AddSystem(ConstantVectorSource([0.0]))
    master = builder.AddSystem(
        WaveMaster(impedance=[[B]], damping=[[0.0]], start=[0.0])
    )
    slave = builder.AddSystem(WaveSlave(impedance=[[B]]))
    channels = [builder.AddSystem(TransportDelay(delay=T / 2, size=2)) for _ in "fr"]
    for source, target in (
        (force.get_output_port(), master.GetInputPort("haptic_force")),
        (master.GetOutputPort("forward_packet"), channels[0].get_input_port()),
        (channels[0].get_output_port(), slave.GetInputPort("forward_packet")),
        (rest.get_output_port(), slave.GetInputPort("tool_position")),
        (rest.get_output_port(), slave.GetInputPort("tool_velocity")),
        (slave.GetOutputPort("return_packet"), channels[1].get_input_port()),
        (channels[1].get_output_port(), master.GetInputPort("return_packet")),
    ):
        builder.Connect(source, target)
    builder.ExportOutput(master.GetOutputPort("master_position"), "x_m")
    builder.ExportOutput(slave.GetOutputPort("control_force"), "F")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5",
            accuracy=1e-9,
            use_error_control=True,
            max_step_size=0.02,
        ),
        simulator,
    )
    simulator.AdvanceTo(10.0)
    context = simulator.get_context()
    x_m = diagram.GetOutputPort("x_m").Eval(context)[0]
    assert x_m == pytest.approx(0.3 * T / (2 * B), rel=0.01)
    assert diagram.GetOutputPort("F").Eval(context)[0] == pytest.approx(0.3, rel=0.01)


def test_a_matched_master_reflects_nothing():
    block = WaveMaster(impedance=[[B]], damping=[[B]], start=[0.0])
    assert not block.HasDirectFeedthrough(
        block.GetInputPort("return_packet").get_index(),
        block.GetOutputPort("forward_packet").get_index(),
    )
    context = block.CreateDefaultContext()
    block.GetInputPort("haptic_force").FixValue(context, [0.4])
    block.GetInputPort("velocity_command").FixValue(context, [0.0])
    waves = []
    for w in (-1.0, 0.5):
        block.GetInputPort("return_packet").FixValue(context, [w, 0.0])
        waves.append(block.GetOutputPort("forward_packet").Eval(context)[0])
    assert waves == pytest.approx([0.4 / math.sqrt(2 * B)] * 2)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: WaveMaster(impedance=[[0.0]], damping=[[0.0]], start=[0.0]), "imped"),
        (lambda: WaveMaster(impedance=[[1.0]], damping=[[-1.0]], start=[0.0]), "damp"),
        (lambda: WaveMaster(impedance=[[1.0]], damping=[[1.0]], start=[0, 0]), "start"),
        (lambda: WaveSlave(impedance=[[1.0, 2.0]]), "impedance"),
        (lambda: WaveSlave(impedance=[[1.0]], scaling=1.1), "scaling"),
        (lambda: WaveSlave(impedance=[[1.0]], bandwidth=0.0), "bandwidth"),
        (lambda: WaveSlave(impedance=[[1.0]], drift_correction=-1.0), "drift"),
    ],
)
def test_bad_parameters_of_the_blocks(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# Runs.


def Integral(time, y):
    return np.concatenate([[0.0], np.cumsum(np.diff(time) * (y[1:] + y[:-1]) / 2)])


def LineEnergy(recording):
    """Energy that went into the line and did not come out, at each sample (J)."""
    time = recording.time
    return sum(
        sign * Integral(time, recording[name].sum(axis=1))
        for name, sign in (("master_power", 1), ("slave_power", -1))
    )


@pytest.mark.slow  # test_a_wave_line_stores_its_waves() says it.
@pytest.mark.parametrize("name", Slow(["one_dof", "two_dof_collision"]))
def test_the_energy_of_the_line_is_that_of_the_waves_under_way(name):
    recording = Wave(
        name,
        "duration=4.0",
        "forward_channel.delay=0.08",
        "return_channel.delay=0.13",
        "controller.wave_variables.master_damping=0.2",
        "simulator.max_step_size=0.002",
    )
    n = recording["tool_position"].shape[1]
    energy = LineEnergy(recording)
    times = np.linspace(0.2, 4.0, 40)
    expected = np.zeros(len(times))
    for packet, delay in (("forward_packet_sent", 0.08), ("return_packet_sent", 0.13)):
        total = Integral(recording.time, (recording[packet][:, :n] ** 2).sum(axis=1))
        expected += np.interp(times, recording.time, total) / 2
        expected -= np.interp(times - delay, recording.time, total) / 2
    ours = np.interp(times, recording.time, energy)
    assert expected.max() > 0
    np.testing.assert_allclose(ours, expected, atol=1e-3 * expected.max())


GROWING = (
    "duration=6.0",
    "surgeon.stop_time=2.0",
    "forward_channel={kind: variable, delay: 0.1, drift: 0.4}",
    "return_channel={kind: variable, delay: 0.1, drift: 0.4}",
)


def test_a_growing_delay_makes_energy_unless_the_waves_are_scaled():
    """Waves die out after the stop: what is left of the energy was lost or made."""
    unscaled = [
        f"controller.wave_variables.{way}_scaling=1" for way in ("forward", "return")
    ]
    made = LineEnergy(Wave("two_dof_puncture", *GROWING, *unscaled))
    scaled = LineEnergy(Wave("two_dof_puncture", *GROWING))
    peak = scaled.max()
    assert made[-1] < -0.1 * peak
    assert scaled.min() > -1e-6 * peak
    config = ResolveController(
        LoadScenario("two_dof_puncture", ["controller.kind=wave_variables", *GROWING])
    )
    assert config.forward_scaling == pytest.approx(math.sqrt(0.6))


@pytest.mark.parametrize("name", Slow(TASKS, but=[2]))
@pytest.mark.parametrize("delay", Slow([0.4, 0.0, 0.1]))
def test_thesis_tasks_are_stable_whatever_the_delay(name, delay):
    recording = Wave(
        name,
        f"forward_channel.delay={delay}",
        f"return_channel.delay={delay}",
        "simulator.accuracy=1e-6",
    )
    metrics = RunMetrics(recording)
    assert not metrics["diverged"]
    if metrics["collision"]:
        assert metrics["collision"]["settling_time"] < 10
        final = recording["environment_force"][-1, 0]
        expected = recording.scenario.surgeon.contact_force[0]
        assert final == pytest.approx(expected, rel=0.05)


def test_nothing_jumps_but_events_and_their_echoes():
    recording = Wave("two_dof_combined")
    jumps = recording.time[1:][np.diff(recording.time) == 0]
    delay = 0.1
    causes = [0.0, *(event.time for event in recording.events)]
    assert len(jumps) >= len(causes)
    for jump in jumps:
        echoes = [
            (jump - cause) / delay for cause in causes if cause < jump + delay / 2
        ]
        assert min(abs(echo - round(echo)) for echo in echoes) < 1e-5, jump


def test_filters_and_drift_correction_act():
    across = ("duration=2.5", "robot.start=[0.0065]")  # The border of the tissue.
    plain = Wave("one_dof", *across)
    for override in ("forward_bandwidth=20", "return_bandwidth=20"):
        filtered = Wave("one_dof", *across, f"controller.wave_variables.{override}")
        error = filtered["tool_velocity"][-1] - plain["tool_velocity"][-1]
        assert 1e-6 < abs(error[0]) < 5e-4, override

    def Drift(*more):
        """How far the tool is from where the master was a delay ago, at the end."""
        # A third of the packets is lost, so the waves do not arrive complete.
        recording = Wave(
            "one_dof",
            "duration=4.0",
            "forward_channel={kind: network, delay: 0.1, sample_period: 0.01, "
            "loss: {kind: independent, probability: 0.3}}",
            *more,
        )
        x_m = recording["forward_packet_received"][-1, 1]
        return x_m - recording["tool_position"][-1, 0]

    corrected = Drift("controller.wave_variables.drift_correction=2.0")
    assert abs(corrected) < abs(Drift())


def test_defaults_match_the_operator():
    scenario = LoadScenario("two_dof_combined", ["controller.kind=wave_variables"])
    config = ResolveController(scenario)
    assert config.impedance == pytest.approx(0.92 * np.eye(2))
    assert config.master_damping == pytest.approx(config.impedance)
    assert (config.forward_scaling, config.return_scaling) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["controller.wave_variables.impedance=0"], "wave_variables.impedance = 0.0"),
        (["controller.wave_variables.forward_scaling=2"], "forward_scaling = 2.0: "),
        (["controller.wave_variables.return_bandwidth=-1"], "return_bandwidth = -1"),
        (["controller.wave_variables.drift_correction=.nan"], "drift_correction = nan"),
        (
            ["haptic_device.numerator=[0, 50]", "haptic_device.denominator=[1, 25, 0]"],
            "controller.wave_variables.impedance = null",
        ),
        (
            ["haptic_device.numerator=[1, 9]", "haptic_device.denominator=[1, 2]"],
            "haptic_device.numerator",
        ),
        (
            [
                "controller.wave_variables.master_damping=0",
                "forward_channel.delay=0",
                "return_channel.delay=0",
            ],
            "controller.wave_variables.master_damping = ",
        ),
    ],
)
def test_bad_input_is_named(overrides, message):
    with pytest.raises(ScenarioError, match=message):
        Wave("one_dof", "duration=0.1", *overrides)
