"""Runs that must be the same, or related, because their physics is."""

import numpy as np
from numpy.testing import assert_allclose

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LayerConfig, LoadScenario

DIRECT = "controller.kind=direct_force"
TIMES = np.linspace(0.0, 2.0, 401)


def load(name, *overrides):
    # Between the steps of machine code one could not interpolate so well.
    steps = "simulator.max_step_size=0.005"
    return LoadScenario(name, [DIRECT, "duration=2.0", steps, *overrides])


def signals(scenario, *names, times=TIMES):
    recording = simulate(scenario, engine="auto")
    return [recording.Interpolate(name, times) for name in names]


def assert_equal(ours, theirs, tolerance=1e-6):
    """Compares signals to a share of their ranges."""
    for a, b in zip(ours, theirs, strict=True):
        assert_allclose(a, b, rtol=0, atol=tolerance * np.abs(b).max())


MOTION = ("tool_position", "tool_velocity", "control_force")


def test_a_transport_delay_is_a_variable_one_that_is_constant():
    channels = [
        f"{way}_channel={{kind: variable, delay: 0.1}}" for way in ("forward", "return")
    ]
    assert_equal(
        signals(load("two_dof_collision", *channels), *MOTION),
        signals(load("two_dof_collision"), *MOTION),
    )


def test_delay_moved_from_one_way_to_the_other_shifts_the_run():
    early = load("one_dof", "forward_channel.delay=0.04", "return_channel.delay=0.16")
    late = load("one_dof", "forward_channel.delay=0.13", "return_channel.delay=0.07")
    assert_equal(
        signals(early, *MOTION, times=TIMES[:380]),
        signals(late, *MOTION, times=TIMES[:380] + 0.09),
        1e-5,
    )


def test_a_layer_cut_in_two_is_the_layer():
    whole = load("one_dof", "robot.start=[0.006]")
    cut = load("one_dof", "robot.start=[0.006]")
    tissue, *others = cut.environment.layers
    second = LayerConfig(
        name="second",
        start=0.0065,
        stiffness=tissue.stiffness,
        damping=tissue.damping,
        reference=tissue.reference,
    )
    cut.environment.layers = [tissue, second, *others]
    assert_equal(signals(cut, *MOTION), signals(whole, *MOTION))


def test_a_task_that_is_moved_goes_the_same_way():
    here = load("one_dof", "robot.start=[0.006]")
    there = load("one_dof", "robot.start=[0.006]")
    shift = 0.25
    there.robot.start = here.robot.start + shift
    for layer in there.environment.layers:
        layer.start += shift
        layer.reference += shift
    position, *ours = signals(there, *MOTION)
    expected, *theirs = signals(here, *MOTION)
    assert_equal([position - shift, *ours], [expected, *theirs])
