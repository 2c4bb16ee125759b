"""Tests of analysis.energy."""

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose

from teleop_drake.loops.numerics.step_polynomials import DEGREE
from teleop_drake.loops.run.recording import SolverStatistics
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import ARCHITECTURES, LoadScenario
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.analysis.energy import TwoPortEnergyBalance

NETWORK = {
    "kind": "network",
    "delay": 0.08,
    "sample_period": 0.02,
    "jitter": {"kind": "gamma", "std": 0.01, "minimum": 0.05},
    "loss": {"kind": "independent", "probability": 0.05},
    "seed": 3,
}


def Run(name, kind, **overrides):
    return simulate(LoadScenario(name, {"controller.kind": kind} | overrides))


def Sinusoids(phi, forward, back, w):
    """Returns a recording of sinusoids through raw delays, on two axes."""
    t = np.linspace(0, 12, 2401)

    def F(t):
        return 2 * np.sin(w * t)

    def v(t):
        return 0.7 * np.sin(w * t + phi)

    def Pack(first, second):
        return np.stack([first, 0 * t, second, 0 * t], axis=1)

    signals = {
        "tool_velocity": Pack(v(t), 0 * t)[:, :2],
        "control_force": Pack(F(t - forward), 0 * t)[:, :2],
        "forward_packet_sent": Pack(F(t), 9 + 0 * t),
        "forward_packet_received": Pack(F(t - forward), 9 + 0 * t),
        "return_packet_sent": Pack(7 + 0 * t, v(t)),
        "return_packet_received": Pack(7 + 0 * t, v(t - back)),
    }
    numbers = ("accuracy", "steps", "derivative_evaluations", "wall_time_s")
    solver = dict.fromkeys((*numbers, "real_time_factor"), 0)
    return TaskRecording(
        scenario=None,
        time=t,
        steps=np.arange(0, len(t) - 1, DEGREE)[:, None] + np.arange(DEGREE + 1),
        signals=signals,
        events=[],
        solver=SolverStatistics(engine="drake", scheme="", **solver),
    )


@pytest.mark.parametrize("phi", [-1.2, 0.4])
def test_sinusoids_in_closed_form(phi):
    """A raw delay generates energy at some phases. F_c is the received force."""
    w = 3.0
    forward = 0.3
    back = 0.1
    balance = TwoPortEnergyBalance(Sinusoids(phi, forward, back, w))
    t = balance.time
    # The integral of sin a sin b = (cos(a - b) - cos(a + b))/2 from 0.
    expected = 0.7 * (
        (np.cos(phi - w * back) - np.cos(phi + w * forward)) * t
        - (np.sin(2 * w * t + phi - w * back) - np.sin(phi - w * back)) / (2 * w)
        + (np.sin(2 * w * t + phi - w * forward) - np.sin(phi - w * forward)) / (2 * w)
    )
    assert_allclose(balance.energy, expected, atol=1e-8)
    assert (balance.violation[-1] > 1) == (phi < 0)
    assert balance.violation[-1] == pytest.approx(max(0, -balance.energy.min()))


def test_other_recordings():
    recording = Sinusoids(0.4, 0.3, 0.1, 3.0)
    del recording.signals["forward_packet_sent"]
    with pytest.raises(ValueError, match="recording = 'without packets'"):
        TwoPortEnergyBalance(recording)


def BySamples(recording):
    """Returns the two-port's energy at the recording's times, by the trapezoidal rule.

    The signals are sampled densely.
    """
    t = np.linspace(0.0, recording.time[-1], 40_001)
    names = ("force_command", "felt_velocity", "control_force", "tool_velocity")
    if "felt_velocity" not in recording.signals:
        names = ("forward_packet_sent", "return_packet_received", *names[2:])
    F_h, v_felt, F_c, v = (recording.Interpolate(name, t) for name in names)
    n = v.shape[1]
    power = np.sum(F_h[:, :n] * v_felt[:, -n:] - F_c * v, axis=1)
    energy = np.append(0, np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(t)))
    return np.interp(recording.time, t, energy)


def test_force_that_is_let_go_and_caught_between_packets():
    """The force jumps, with corners close behind the jumps."""
    channel = {"kind": "sampled", "delay": 0.1, "sample_period": 0.05}
    channels = {"forward_channel": channel, "return_channel": channel}
    kind = "time_domain_passivity"
    recording = Run("two_dof_combined", kind, duration=4.0, **channels)
    # The expected values are those of dense samples with steps of 0.0002 s.
    metrics = RunMetrics(recording)
    assert metrics["control_force_peak"] == pytest.approx([0.2, 0.0492862], rel=1e-3)
    assert metrics["control_force_variation"] == pytest.approx(
        [5.321714, 0.1807975], rel=1e-3
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize("channel", Slow(["transport", "network"]))
@pytest.mark.parametrize("kind", ARCHITECTURES)
def test_every_architecture_has_a_balance(kind, channel):
    """The balance equals that of dense samples."""
    overrides = {"duration": 1.0}
    if channel == "network":
        overrides |= {"forward_channel": NETWORK, "return_channel": NETWORK}
    recording = Run("two_dof_collision", kind, **overrides)
    balance = TwoPortEnergyBalance(recording)
    energy = BySamples(recording)
    scale = max(np.ptp(energy), 1e-4)
    assert_allclose(balance.energy, energy, rtol=0, atol=1e-3 * scale)


@pytest.mark.parametrize("delays", [(0.1, 0.1), (0.25, 0.05)])
def test_a_wave_line_stores_its_waves(delays):
    """The energy is that of the waves in the channels plus the damper's dissipation.

    The waves have the energies u^T u/2 and w^T w/2, integrated over the delays.
    """
    forward, back = delays
    overrides = {"forward_channel.delay": forward, "return_channel.delay": back}
    recording = Run("two_dof_collision", "wave_variables", duration=2.4, **overrides)
    D = ResolveController(recording.scenario).master_damping
    fine = np.linspace(0.0, recording.time[-1], 48001)

    def Integral(power):
        steps = (power[1:] + power[:-1]) / 2 * np.diff(fine)
        return np.concatenate([[0.0], np.cumsum(steps)])

    u, w, v = (
        recording.Interpolate(name, fine)[:, :2]
        for name in ("forward_packet_sent", "return_packet_sent", "felt_velocity")
    )
    sent_u, sent_w = (Integral(np.sum(x * x, axis=1) / 2) for x in (u, w))
    stored = sum(
        sent - np.interp(fine - delay, fine, sent)
        for sent, delay in ((sent_u, forward), (sent_w, back))
    )
    dissipated = Integral(np.einsum("ki,ij,kj->k", v, D, v))
    expected = np.interp(recording.time, fine, stored + dissipated)
    balance = TwoPortEnergyBalance(recording)
    energy = balance.energy
    scale = balance.energy.max()
    assert scale > 1e-3 and stored.max() > 0.02 * scale
    assert_allclose(energy, expected, atol=1e-3 * scale)
    assert balance.violation[-1] == 0
