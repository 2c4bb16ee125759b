"""The tracking of chapter 3, against a second solver and the thesis's numbers."""

import functools
import itertools

import appendix_a as arm
import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp, trapezoid

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import (
    LoadScenario,
    ScenarioError,
    TrajectoryConfig,
)
from teleop_drake.model.task_recording import LoadRecording
from teleop_drake.model.tasks.metrics import RunMetrics, RunSummary
from teleop_drake.model.tasks.tracking import MakeReference
from teleop_drake.study.figures.runs import PlotRun

# The tests share runs, and therefore run in one process.
pytestmark = pytest.mark.xdist_group("tracking")

CASES = ("network_tracking_linear", "network_tracking_coupled")


@functools.cache
def Run(name, *overrides):
    return simulate(LoadScenario(name, overrides))


# A second solver, which shares no code with the package and does not use Drake.

CENTRES = np.array(
    list(itertools.product(np.linspace(0.8, 1.4, 5), np.linspace(-0.2, 0.2, 5)))
)
WIDTHS = np.array([0.15, 0.1])


def Loop(t, state, name):
    """Returns (d/dt [q, q', W], signals by name)."""
    q = state[:2]
    qdot = state[2:4]
    W = state[4:].reshape(2, -1)
    J = arm.J(q)
    (x, z) = arm.p_WT(q)
    v = x_dot, z_dot = J @ qdot
    F_e = 10 * np.array([x, z])
    if name == "network_tracking_coupled":
        F_e[0] += 10 * (x_dot * z + 2 * z_dot * x + z * z)
        F_e[1] += 10 * (z_dot * x + 2 * z * x_dot + x * x)

    e = np.array([x - 1.1 - 0.1 * np.sin(t), z])
    e_dot = v - [0.1 * np.cos(t), 0]
    s = e_dot + 35 * e
    Phi = np.exp(-((([x, z] - CENTRES) / WIDTHS) ** 2).sum(axis=1))
    bias = arm.C(q, qdot) @ qdot + arm.G(q)
    # J' q' is the centripetal acceleration of both links.
    angles = np.array([q[0], q.sum()])
    rates = np.array([qdot[0], qdot.sum()])
    pull = np.array([arm.L1, arm.L3]) * rates**2
    J_dot_qdot = -np.array([pull @ np.cos(angles), pull @ np.sin(angles)])
    J_inv = np.linalg.inv(J)
    M_r = J_inv.T @ arm.M(q) @ J_inv
    F_c = (
        W @ Phi
        + J_inv.T @ bias
        - M_r @ J_dot_qdot
        + M_r @ (np.array([-0.1 * np.sin(t), 0]) - 35 * e_dot - s)
    )
    qddot = np.linalg.solve(arm.M(q), J.T @ (F_c - F_e) - bias)
    W_dot = 5 * (-np.outer(np.linalg.inv(M_r).T @ s, Phi) - 0.001 * W)
    signals = {
        "tool_position": np.array([x, z]),
        "tool_velocity": v,
        "control_force": F_c,
        "environment_force": F_e,
        "disturbance_estimate": W @ Phi,
        "weights_1": W.ravel(),
        "error": e,
    }
    return np.concatenate([qdot, qddot, W_dot.ravel()]), signals


@functools.cache
def Reference(name):
    """Returns times, and the second solver's signals at these times."""
    start = np.concatenate([arm.joints([1.15, 0.095]), np.zeros(52)])
    solution = solve_ivp(
        lambda t, state: Loop(t, state, name)[0],
        (0, 6.3),
        start,
        method="DOP853",
        rtol=1e-8,
        atol=1e-9,
        dense_output=True,
    )
    times = np.linspace(0, 6.3, 2101)
    rows = [Loop(t, solution.sol(t), name)[1] for t in times]
    return times, {key: np.array([row[key] for row in rows]) for key in rows[0]}


@pytest.mark.slow
@pytest.mark.parametrize("name", Slow(CASES, but=[1]))
def test_agrees_with_a_second_solver(name):
    times, expected = Reference(name)
    recording = Run(name)
    for signal in set(expected) - {"error"}:
        error = np.abs(recording.Interpolate(signal, times) - expected[signal])
        scale = np.ptp(expected[signal], axis=0).max()
        assert error.max() <= 1e-3 * scale, signal


@pytest.mark.parametrize("name", Slow(CASES, but=[1]))
def test_metrics_agree_with_a_second_solver(name, subtests):
    times, expected = Reference(name)

    def rms(y):
        return np.sqrt(trapezoid(y**2, times, axis=0) / times[-1])

    unknown = expected["disturbance_estimate"] - expected["environment_force"]
    metrics = RunMetrics(Run(name))
    for key, values in {
        "max_error": np.abs(expected["error"]).max(axis=0),
        "rms_error": rms(expected["error"]),
        "disturbance_rms_error": rms(unknown),
    }.items():
        with subtests.test(key=key):
            assert metrics[key] == pytest.approx(values, rel=1e-3), key
    assert len(metrics) == 3


# The thesis.


def test_printed_trajectory_leaves_the_workspace():
    with pytest.raises(
        ScenarioError,
        match=r"^trajectory.amplitude = \[1.0, 0.0\]: must keep the trajectory in r",
    ):
        LoadScenario(CASES[0], ["trajectory.amplitude.0=1"])


# The diagram and its runs.


def test_reference_is_its_own_derivative():
    reference = MakeReference(
        TrajectoryConfig(
            centre=np.array([1.1, 0.3]),
            amplitude=np.array([0.2, -0.1]),
            frequency=2.0,
            phase=0.5,
        )
    )
    context = reference.CreateDefaultContext()

    def evaluate(name, t):
        context.SetTime(t)
        return reference.GetOutputPort(f"desired_{name}").Eval(context)

    expected = [1.1 + 0.2 * np.sin(2.5), 0.3 - 0.1 * np.sin(2.5)]
    assert_allclose(evaluate("position", 1.0), expected)
    for name, rate in (("position", "velocity"), ("velocity", "acceleration")):
        slope = (evaluate(name, 1 + 1e-6) - evaluate(name, 1 - 1e-6)) / 2e-6
        assert_allclose(evaluate(rate, 1.0), slope, rtol=1e-6)


def test_without_force_and_error_the_arm_holds_itself():
    # Gravity is the only load, and the controller compensates for it.
    recording = Run(
        CASES[0],
        "disturbance.gain=0",
        "robot.start=[1.1, 0]",
        "trajectory.amplitude=[0, 0]",
        "duration=1",
    )
    assert np.abs(recording["tool_position"] - [1.1, 0]).max() < 1e-9
    assert np.abs(recording["joint_torque"]).min() > 1


def test_recording_survives_a_file(tmp_path):
    recording = Run(CASES[1])
    recording.Save(tmp_path / "a.npz")
    loaded = LoadRecording(tmp_path / "a.npz")
    assert loaded.scenario == recording.scenario
    assert loaded.scenario != LoadScenario(CASES[0])
    assert RunSummary(loaded) == RunSummary(recording)
    assert recording.events == []


def test_a_run_that_diverges_ends_at_its_limit():
    # The disturbance pushes the tool away and is ten times as large.
    recording = Run(CASES[1], "disturbance.gain=-100")
    assert recording.termination == "diverged"
    assert "exceeds 10 m/s" in recording.reason
    speed = np.linalg.norm(recording["tool_velocity"], axis=1)
    assert speed[-1] == pytest.approx(10, rel=1e-6)
    summary = RunSummary(recording)
    assert summary["diverged"] is True
    assert summary["diverged_at"] == recording.time[-1] < 1


def test_plot():
    figure = PlotRun(Run(CASES[0]))
    assert len(figure.axes) == 6
    for ax in figure.axes:
        assert ax.get_ylabel()
        assert all(len(line.get_xdata()) > 0 for line in ax.get_lines())
    desired, actual = figure.axes[0].get_lines()[-2:]
    assert np.ptp(desired.get_ydata()) == pytest.approx(0.2, rel=1e-3)
    assert np.ptp(actual.get_ydata()) != pytest.approx(0.2, rel=1e-3)
    error = figure.axes[3].get_lines()[-1].get_ydata()
    assert np.max(error) == pytest.approx(0.105, rel=1e-3)
