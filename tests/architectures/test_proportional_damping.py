"""P+d: stable where its theorem says so, and where the exact roots say so."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from blocks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs
from grids import Slow
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from runs import TASKS

from teleop_drake.architectures.proportional_damping import (
    ProportionalDampingConfig,
    ProportionalMaster,
    ProportionalSlave,
)
from teleop_drake.channels.transport import TransportDelay
from teleop_drake.robots import MakeRobot
from teleop_drake.scenario import LoadScenario, ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.metrics import RunMetrics

KIND = "proportional_damping"
M, B = np.array([[2.0, 0.3], [0.3, 1.0]]), np.diag([0.4, 0.0])
K, START = np.array([[5.0, 1.0], [1.0, 4.0]]), [0.5, -0.2]
CONFIG = ProportionalDampingConfig(
    master_mass=M, stiffness=K, master_damping=B, slave_damping=2 * B
)


def test_the_master_by_its_equation():
    block = ProportionalMaster(CONFIG, start=START)
    inputs = RandomInputs(block, 1)
    F_h, x_s = inputs["haptic_force"], inputs["return_packet"]
    x_m, v_m = np.array([0.1, 0.2]), np.array([0.3, -0.4])
    now = Block(block, inputs, np.concatenate([x_m, v_m]))
    force = F_h - K @ (x_m - x_s) - B @ v_m
    expected = np.concatenate([v_m, np.linalg.solve(M, force)])
    np.testing.assert_allclose(now.Rate(), expected, rtol=1e-12)
    np.testing.assert_array_equal(now["felt_position"], x_s)
    np.testing.assert_array_equal(now["felt_velocity"], v_m)
    np.testing.assert_array_equal(now["forward_packet"], x_m)
    np.testing.assert_allclose(now["coupling_force"], K @ (x_m - x_s), rtol=1e-12)
    AssertFeedthroughIsReal(block)
    assert Feedthrough(block) == {
        "felt_position": {"return_packet"},
        "coupling_force": {"return_packet"},
    }
    start = Block(block, RandomInputs(block, 0))
    np.testing.assert_array_equal(start["forward_packet"], START)
    np.testing.assert_array_equal(start["felt_velocity"], [0.0, 0.0])


def test_the_slave_by_its_equation():
    block = ProportionalSlave(CONFIG, num_axes=2)
    inputs = RandomInputs(block, 1)
    p = inputs["tool_position"]
    now = Block(block, inputs)
    expected = K @ (inputs["forward_packet"] - p) - 2 * B @ inputs["tool_velocity"]
    np.testing.assert_allclose(now["control_force"], expected, rtol=1e-12)
    np.testing.assert_array_equal(now["return_packet"], p)
    AssertFeedthroughIsReal(block)


def Spectrum(M, m, B_m, B_s, K, T_f, T_r, count=16):
    """The rightmost characteristic roots of the free pair.

    z = [x_m, v_m, x_s, v_s] of dz/dt = A z(t) + F z(t - T_f) + R z(t - T_r): the
    derivative on Chebyshev points over the longest delay, Trefethen's matrix, with the
    equation itself in the row of the present.
    """
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1
    A[1, 0], A[1, 1] = -K / M, -B_m / M
    A[3, 2], A[3, 3] = -K / m, -B_s / m
    F, R = np.zeros((4, 4)), np.zeros((4, 4))
    F[3, 0], R[1, 2] = K / m, K / M
    longest = max(T_f, T_r)
    x = np.cos(np.pi * np.arange(count + 1) / count)
    c = np.ones(count + 1)
    c[[0, -1]] = 2
    c *= (-1.0) ** np.arange(count + 1)
    D = np.outer(c, 1 / c) / (x[:, None] - x + np.eye(count + 1))
    D -= np.diag(D.sum(axis=1))
    full = np.kron(2 / longest * D, np.eye(4))

    def Past(T):
        """Interpolates z(t - T) from the points."""
        at = 1 - 2 * T / longest
        w = (-1.0) ** np.arange(count + 1)
        w[[0, -1]] /= 2
        if np.any(np.isclose(x, at, atol=1e-12)):
            row = np.isclose(x, at, atol=1e-12).astype(float)
        else:
            row = w / (at - x)
        return row / row.sum()

    full[:4] = np.kron(Past(T_f), F) + np.kron(Past(T_r), R)
    full[:4, :4] += A
    roots = np.linalg.eigvals(full)
    # Nothing holds the pair in place: one root is 0.
    rest = np.delete(roots, np.argmin(np.abs(roots)))
    return rest[np.argmax(rest.real)]


def test_the_spectrum_finds_known_roots():
    """Far from each other: without coupling the pair only brakes, at -B/M."""
    assert Spectrum(0.5, 0.5, 1.0, 3.0, 1e-9, 0.1, 0.2).real == pytest.approx(
        0.0, abs=1e-8
    )
    # The root solves the characteristic equation.
    M, m, B_m, B_s, K, T_f, T_r = 0.5, 0.7, 0.9, 0.4, 8.0, 0.11, 0.23
    s = Spectrum(M, m, B_m, B_s, K, T_f, T_r)
    z = np.exp(-s * (T_f + T_r))
    f = (M * s**2 + B_m * s + K) * (m * s**2 + B_s * s + K) - K**2 * z
    assert abs(f) < 1e-6 * K**2


positive = st.floats(0.1, 5.0)


@settings(max_examples=5)
@given(positive, positive, positive, positive, st.floats(0.01, 1), st.floats(0.01, 1))
def test_the_condition_suffices(M, m, B_m, B_s, T_f, T_r):
    K = np.sqrt(4 * B_m * B_s) / (T_f + T_r) * 0.999
    assert Spectrum(M, m, B_m, B_s, K, T_f, T_r).real < 1e-7


def Gap(K, B, T):
    """Lets the pair go with the master displaced; returns |x_m - p_WT| over time."""
    builder = DiagramBuilder()
    config = ProportionalDampingConfig(
        master_mass=0.5, stiffness=K, master_damping=B, slave_damping=B
    )
    master = builder.AddNamedSystem("master", ProportionalMaster(config, start=[0.01]))
    slave = builder.AddNamedSystem("slave", ProportionalSlave(config, num_axes=1))
    robot = builder.AddNamedSystem(
        "robot", MakeRobot(model="slider", start=[0.0], mass=0.5, damping=0.0)
    )
    zero = builder.AddNamedSystem("zero", ConstantVectorSource([0.0]))
    channels = [
        builder.AddNamedSystem(name, TransportDelay(delay=T / 2, size=1))
        for name in ("forward", "return")
    ]
    p = robot.GetOutputPort("tool_position")
    for source, target in (
        (zero.get_output_port(), master.GetInputPort("haptic_force")),
        (zero.get_output_port(), robot.GetInputPort("environment_force")),
        (master.GetOutputPort("forward_packet"), channels[0].get_input_port()),
        (channels[0].get_output_port(), slave.GetInputPort("forward_packet")),
        (slave.GetOutputPort("control_force"), robot.GetInputPort("control_force")),
        (p, slave.GetInputPort("tool_position")),
        (robot.GetOutputPort("tool_velocity"), slave.GetInputPort("tool_velocity")),
        (slave.GetOutputPort("return_packet"), channels[1].get_input_port()),
        (channels[1].get_output_port(), master.GetInputPort("return_packet")),
    ):
        builder.Connect(source, target)
    run = simulate(builder.Build(), duration=8.0, engine="compiled")
    return run.time, np.abs(run["forward_packet_sent"] - run["tool_position"])[:, 0]


@pytest.mark.parametrize(("margin", "is_stable"), [(0.05, False), (1.1, True)])
def test_the_blocks_grow_or_decay_as_the_exact_root_says(margin, is_stable):
    B, T = 0.92, 0.2
    K = np.sqrt(4 * B * B / margin) / T
    root = Spectrum(0.5, 0.5, B, B, K, T / 2, T / 2)
    assert (root.real < 0) == is_stable
    times, gaps = Gap(K, B, T)
    early = gaps[(times > 2) & (times < 4)].max()
    late = gaps[(times > 6) & (times < 8)].max()
    assert np.log(late / early) / 4 == pytest.approx(root.real, abs=0.15)


@pytest.mark.parametrize(
    ("name", "delay"),
    Slow([("two_dof_collision", 0.3), *product(TASKS, (0.0, 0.1, 0.3))]),
)
def test_thesis_tasks_are_stable(name, delay):
    scenario = LoadScenario(
        name,
        [
            f"controller.kind={KIND}",
            f"forward_channel.delay={delay}",
            f"return_channel.delay={delay}",
            "simulator.accuracy=1e-6",
        ],
    )
    config = ResolveController(scenario)
    K, B = config.stiffness[0, 0], config.slave_damping[0, 0]
    assert (2 * delay * K) ** 2 < 4 * B**2
    assert pytest.approx(0.92) == B
    if delay == 0.1:
        assert pytest.approx((0.2 * K) ** 2 * 2) == 4 * B**2
    if delay == 0:
        assert pytest.approx(0.5 * 25**2) == K
    metrics = RunMetrics(simulate(scenario, engine="auto"))
    assert not metrics["diverged"]
    assert metrics["start_velocity_overshoot"] < 0.1 * abs(scenario.surgeon.velocity[0])


def test_bad_parameters_of_the_blocks():
    with pytest.raises(ValueError, match="master_mass"):
        ProportionalMaster(replace(CONFIG, master_mass=0.0), start=START)
    with pytest.raises(ValueError, match="start"):
        ProportionalMaster(CONFIG, start=[np.nan])
    with pytest.raises(ValueError, match="stiffness = null"):
        ProportionalSlave(replace(CONFIG, stiffness=None), num_axes=2)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (f"controller.{KIND}.margin=1", f"controller.{KIND}.margin = 1.0: must be"),
        (f"controller.{KIND}.master_mass=0", "master_mass = 0.0: must be"),
        (f"controller.{KIND}.stiffness=-1", "stiffness = -1.0: must be"),
        (f"controller.{KIND}.master_damping=0", f"controller.{KIND}.stiffness = null"),
        ("haptic_device.numerator=[50]", f"controller.{KIND}.master_damping = null"),
    ],
)
def test_bad_input_is_named(override, message):
    overrides = ["duration=0.1", override, f"controller.kind={KIND}"]
    with pytest.raises(ScenarioError, match=message):
        simulate(LoadScenario("one_dof", overrides), engine="auto")
