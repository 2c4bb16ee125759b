"""The Smith predictor: with an exact model the delay is outside of the loop."""

from dataclasses import replace

import numpy as np
import pytest
from block_checks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs
from numpy.testing import assert_allclose, assert_array_equal
from phasors import FeltImpedance, Response
from pydrake.systems.analysis import Simulator
from runs import Run

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.model.blocks.architectures.smith_predictor import (
    SmithPredictorConfig,
    SmithPredictorMaster,
)
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.stations import MakeArchitecture, ResolveController

KIND = "smith_predictor"
M = np.array([[2.0, 0.3], [0.3, 1.0]])
B = np.diag([0.4, 0.1])
K = np.array([[5.0, 1.0], [1.0, 4.0]])


def Make(delay=0.2, **changes):
    given = {"mass": M, "damping": B, "stiffness": K, "delay": delay}
    return SmithPredictorMaster(SmithPredictorConfig(**(given | changes)), num_axes=2)


def test_the_master_by_its_equation():
    block = Make()
    inputs = RandomInputs(block, 1)
    y = np.array([0.1, 0.2])
    v = np.array([0.3, -0.4])
    now = Block(block, inputs, np.concatenate([y, v]))
    force = inputs["haptic_force"] - B @ v - K @ y
    expected = np.concatenate([v, np.linalg.solve(M, force)])
    assert_allclose(now.Rate(), expected, rtol=1e-12)
    p, v_ret = inputs["return_packet"].reshape(2, 2)
    assert_array_equal(now["model_velocity"], v)
    assert_array_equal(now["felt_position"], p)
    # The model has been at rest until now.
    assert_allclose(now["felt_velocity"], v_ret + v, rtol=1e-12)
    sent = [*inputs["haptic_force"], *inputs["velocity_command"]]
    assert_array_equal(now["forward_packet"], sent)
    for predictor in (block, Make(delay=0.0)):
        AssertFeedthroughIsReal(predictor)
        assert Feedthrough(predictor) == {
            "forward_packet": {"haptic_force", "velocity_command"},
            "felt_position": {"return_packet"},
            "felt_velocity": {"return_packet"},
        }


def test_the_model_is_taken_away_again_one_delay_later():
    """Under a constant force the model comes to rest, and nothing is left of it."""
    block = Make(delay=0.5)
    inputs = {name: np.zeros_like(x) for name, x in RandomInputs(block, 0).items()}
    inputs["haptic_force"] = [1.0, 0.0]
    now = Block(block, inputs)
    simulator = Simulator(block, now.context)
    simulator.get_mutable_integrator().set_maximum_step_size(0.01)
    velocities = []
    for time in (0.4, 0.9):
        simulator.AdvanceTo(time)
        velocities.append(now["model_velocity"].copy())
        delayed = velocities[0] if time == 0.9 else np.zeros(2)
        difference = now["model_velocity"] - delayed
        assert_allclose(now["felt_velocity"], difference, atol=1e-6)
    assert np.abs(velocities[0]).max() > 0.05


def Scenario(*overrides, name="one_dof"):
    return LoadScenario(name, [f"controller.kind={KIND}", *overrides])


def Delays(forward, back):
    return [f"forward_channel.delay={forward}", f"return_channel.delay={back}"]


# The robot's own damper, of which the model knows, changes nothing.
@pytest.mark.parametrize(
    ("delays", "damper", "without"),
    [
        ((0.35, 0.25), "local_damping=0", "direct_force"),
        ((0.0, 0.3), "local_damping=2", "damped_force"),
    ],
)
def test_an_exact_model_gives_the_response_without_delay_only_later(
    delays, damper, without
):
    """In the tissue, of which the slider's default model knows everything."""
    short = "duration=2.0"
    forward = delays[0]
    damper = f"controller.{KIND}.{damper}"
    late = simulate(Scenario(short, damper, *Delays(*delays)))
    free = Run("one_dof", without, short, *Delays(0.0, 0.0))
    times = np.linspace(0, 2 - forward, 500)
    for ours, theirs, shift in (
        ("tool_velocity", "tool_velocity", forward),
        ("force_command", "forward_packet_sent", 0.0),
    ):
        expected = free.Interpolate(theirs, times)[:, 0]
        assert_allclose(
            late.Interpolate(ours, times + shift)[:, 0],
            expected,
            atol=1e-4 * np.ptp(expected),
        )


@pytest.mark.parametrize("is_exact", [True, False])
def test_the_characteristic_equation_has_no_delay(is_exact):
    """F_h / v_felt is the tool's impedance, if that is what the model has."""
    m = 0.5
    c = 0.6
    k = 0.01
    scenario = Scenario() if is_exact else Scenario(f"controller.{KIND}.mass=0.7")
    config = ResolveController(scenario)
    # Without its delay line the block is a model beside the return channel.
    block = SmithPredictorMaster(replace(config, delay=0.0), num_axes=1)
    s = 3.0j
    tool = m * s + c + k / s
    Z = Response(block, ["haptic_force"], ["model_velocity"], s)[0, 0]
    felt = Z + np.exp(-s * 0.2) * (1 / tool - Z)
    if is_exact:
        assert 1 / felt == pytest.approx(tool)
    else:
        assert abs(1 / felt - tool) > 0.1 * abs(tool)
    # At no delay the predictor is not there at all.
    sides = MakeArchitecture(Scenario(*Delays(0.0, 0.0)))
    block = sides.master_side
    assert isinstance(block.GetSubsystemByName("model_delay"), TransportDelay)
    bare = FeltImpedance(
        block,
        sides.slave_side,
        s,
        delays=(0.0, 0.0),
        robot=m * s + 0.1,
        environment=0.5 + k / s,
    )
    assert bare == pytest.approx(tool)


def test_defaults_are_the_tool_in_its_first_layer():
    config = ResolveController(Scenario(*Delays(0.07, 0.2)))
    assert config.mass == pytest.approx(0.5)
    assert config.damping == pytest.approx(0.1 + 0.5)
    assert config.stiffness == pytest.approx(0.01)
    assert config.delay == pytest.approx(0.27)
    # The tissue acts along x only, and in free space there is none.
    config = ResolveController(Scenario(name="two_dof_combined"))
    assert config.damping == pytest.approx(np.diag([0.5, 0.0]))
    assert config.mass[0, 1] != 0
    config = ResolveController(Scenario(name="two_dof_collision"))
    assert not np.any(config.damping)


def test_the_delay_of_the_model_limits_the_step():
    recording = simulate(Scenario("duration=0.1", f"controller.{KIND}.delay=0.002"))
    assert recording.termination == "completed"
    assert np.diff(recording.time).max() < 0.0021


@pytest.mark.parametrize(
    "bad",
    ({"mass": np.zeros((2, 2))}, {"damping": np.eye(3)}, {"delay": -0.1}),
)
def test_bad_parameters_of_the_block(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        Make(**bad)
