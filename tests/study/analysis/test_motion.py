"""Tests of the validity of the linear model of an instant of a motion."""

import math

import numpy as np
import pytest

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.loop_model import CutLoop, MotionRate
from teleop_drake.study.analysis.operating_point import OperatingPointAt
from teleop_drake.study.analysis.stability import AnalyzeStability


def EverywhereBone(stiffness, **overrides):
    return {
        "controller.kind": "direct_force",
        "environment.layers": [
            {"name": "bone", "start": -math.inf, "stiffness": stiffness}
        ],
        "divergence_speed_ratio": 1000.0,
    } | overrides


@pytest.mark.parametrize("speed", [0.002, 0.1])
def test_modes_of_the_motion_itself_are_neutral(speed):
    """The slave of a moving arm without a controller has the roots 0.2 v +- 1.5 v j.

    They are as slow as the arm's motion across the workspace and must not count.
    """
    scenario = LoadScenario(
        "two_dof_collision",
        {"controller.kind": "smith_predictor", "surgeon.velocity": [speed, 0.0]},
    )
    free = AnalyzeStability(scenario)["free"]
    assert free.is_stable
    assert free.stable_delays == [(0.0, 2.0)]
    assert free.margin is None or free.margin.delay > 100
    assert not len(free.hidden_modes) and free.num_neutral == 6
    assert free.unresolved == pytest.approx(2.5 * speed, rel=0.3)
    assert free.RightmostRoot(0.2).real == pytest.approx(-0.68, abs=0.02)


def test_slow_root_that_is_unstable_is_found():
    """The model of a heavy slider on a soft spring does not change along its path."""
    scenario = LoadScenario(
        "one_dof",
        EverywhereBone(
            0.01,
            **{
                "robot.mass": 100.0,
                "robot.damping": 0.0,
                "surgeon.velocity": [1e-3],
                "forward_channel.delay": 1.0,
                "return_channel.delay": 1.0,
            },
        ),
    )
    point = OperatingPointAt(scenario, 0.01)
    bone = AnalyzeStability(scenario, points=[point]).points[0]
    root = bone.RightmostRoot(2.0)
    assert 0 < root.real < abs(root) < 0.2
    assert bone.unresolved < 1e-3 * abs(root)
    assert not bone.is_stable


def test_rate_of_a_motion():
    """A root a that changes at the rate a' is as slow as its change if a^2 = |a'|."""
    A = np.diag([-10.0, 0.0, 0.0]) + np.eye(3, k=1)
    assert MotionRate(A, 0 * A) == 0
    A_dot = np.diag([0.0, 0.0, 0.04])
    # The result is the next circle outside of 0.2; there are six circles per decade.
    assert 0.2 <= MotionRate(A, A_dot) <= 0.2 * 10 ** (1 / 6)
    units = np.array([1.0, 1e3, 1e-3])
    scale = units / units[:, None]
    assert MotionRate(A * scale, A_dot * scale) == pytest.approx(MotionRate(A, A_dot))


def test_slider_on_a_spring_rests_while_it_moves():
    scenario = LoadScenario("one_dof", EverywhereBone(150.0))
    model = Linearizer(scenario).Loop(OperatingPointAt(scenario, 0.01))
    assert model.motion.Rate(CutLoop(model)) == 0


def Rate(recording, begin):
    """Returns the growth rate in 1/s of a deviation from steady motion.

    It is computed from the deviation's extremes.
    """
    t = np.linspace(begin, recording.time[-1], 6000)
    v = recording.Interpolate("tool_velocity", t)[:, 0]
    i = np.flatnonzero(np.diff(v)[:-1] * np.diff(v)[1:] < 0) + 1
    swings = np.abs(np.diff(v[i]))
    return np.polyfit((t[i][1:] + t[i][:-1]) / 2, np.log(swings), 1)[0]


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(i, marks=pytest.mark.slow) for i in range(2, 8))]
)
def test_roots_against_growth(seed):
    """A run with a random slider, spring and delay grows or decays as predicted.

    The predicted rate is that of the rightmost root.
    """
    rng = np.random.default_rng(seed)
    delay = rng.uniform(0.1, 0.5)
    share = rng.uniform(0.2, 0.8)
    overrides = EverywhereBone(
        rng.uniform(80.0, 300.0),
        **{
            "robot.mass": rng.uniform(0.3, 1.0),
            "robot.damping": rng.uniform(0.0, 0.5),
            "forward_channel.delay": share * delay,
            "return_channel.delay": (1 - share) * delay,
            # Error control is absolute, and these signals are small.
            "simulator.max_step_size": 0.005,
        },
    )
    scenario = LoadScenario("one_dof", overrides)
    point = OperatingPointAt(scenario, 0.01)
    bone = AnalyzeStability(scenario, points=[point]).points[0]
    roots = bone.Roots(delay, count=6)
    root = roots[0]
    # Long enough for the faster modes to decay, and short enough for the slowest one to
    # remain.
    duration = float(np.clip(10 / abs(root.real), 2.0, 10.0))
    apart = next(s.real for s in roots if abs(s.imag) != abs(root.imag))
    if (root.real - apart) * duration < 20 or root.imag == 0:
        pytest.skip("no single mode in sight")
    recording = simulate(
        LoadScenario("one_dof", overrides | {"duration": duration}), engine="auto"
    )
    rate = Rate(recording, 0.5 * duration)
    assert rate == pytest.approx(root.real, rel=5e-3, abs=1e-3)
    assert (root.real < 0) == bone.is_stable
