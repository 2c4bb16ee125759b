"""The Smith predictor: with an exact model the delay is outside of the loop."""

import numpy as np
import pytest
from grids import Slow
from phasors import FeltImpedance, Response
from runs import Run

from teleop_drake.architectures.smith_predictor import SmithPredictorMaster
from teleop_drake.channels.transport import TransportDelay
from teleop_drake.scenario import LoadScenario, ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.stations import MakeArchitecture, ResolveController
from teleop_drake.tasks.metrics import RunMetrics

KIND = "smith_predictor"


def Scenario(*overrides, name="one_dof"):
    return LoadScenario(name, [f"controller.kind={KIND}", *overrides])


def Delays(forward, back):
    return [f"forward_channel.delay={forward}", f"return_channel.delay={back}"]


@pytest.mark.parametrize(
    ("forward", "back"),
    Slow([(0.35, 0.25), (0.1, 0.1), (0.0, 0.3), (0.4, 0.0)], but=[0, 2]),
)
def test_an_exact_model_gives_the_response_without_delay_only_later(forward, back):
    """In the tissue, of which the slider's default model knows everything."""
    late = Scenario("duration=6.0", *Delays(forward, back))
    recording = simulate(late, engine="drake")
    undelayed = ("duration=6.0", *Delays(0.0, 0.0))
    free = Run("one_dof", "direct_force", *undelayed, engine="drake")
    times = np.linspace(0, 6 - forward, 500)
    for ours, theirs, shift in (
        ("tool_velocity", "tool_velocity", forward),
        ("force_command", "forward_packet_sent", 0.0),
    ):
        expected = free.Interpolate(theirs, times)[:, 0]
        np.testing.assert_allclose(
            recording.Interpolate(ours, times + shift)[:, 0],
            expected,
            atol=1e-4 * np.ptp(expected),
        )


def test_without_the_predictor_it_would_not():
    delays = Delays(0.35, 0.25)
    direct = RunMetrics(Run("one_dof", "direct_force", "duration=6.0", *delays))
    ours = RunMetrics(simulate(Scenario("duration=6.0", *delays), engine="auto"))
    free = RunMetrics(Run("one_dof", "direct_force", "duration=6.0", *Delays(0.0, 0.0)))
    name = "start_velocity_overshoot"
    assert ours[name] == pytest.approx(free[name], rel=1e-3)
    assert direct["diverged"] or direct[name] > 5 * ours[name]


@pytest.mark.parametrize("is_exact", [True, False])
def test_the_characteristic_equation_has_no_delay(is_exact):
    """F_h / v_felt is the tool's impedance, if that is what the model has."""
    m, c, k = 0.5, 0.6, 0.01
    scenario = Scenario() if is_exact else Scenario(f"controller.{KIND}.mass=0.7")
    config = ResolveController(scenario)
    # Without its delay line the block is a model beside the return channel.
    block = SmithPredictorMaster(
        mass=config.mass, damping=config.damping, stiffness=config.stiffness, delay=0.0
    )
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


def test_a_wrong_model_costs_what_it_promises():
    name = "start_velocity_overshoot"
    delays = [*Delays(0.2, 0.2), "duration=7.0"]
    exact = RunMetrics(simulate(Scenario(*delays), engine="auto"))[name]
    errors = [
        abs(
            RunMetrics(simulate(Scenario(*delays, override), engine="auto"))[name]
            - exact
        )
        for override in (
            f"controller.{KIND}.mass=1.0",
            f"controller.{KIND}.delay=0.2",
        )
    ]
    assert min(errors) > 0.1 * exact


@pytest.mark.slow  # As rows of the league table.
def test_it_does_not_foresee_the_bone():
    ours = RunMetrics(simulate(Scenario("simulator.accuracy=1e-6"), engine="auto"))[
        "collision"
    ]
    theirs = RunMetrics(Run("one_dof", "direct_force"))["collision"]
    assert ours["settling_time"] is None
    assert ours["peak_force"] == pytest.approx(theirs["peak_force"], rel=0.1)


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


def test_a_local_damper_is_known_to_the_model():
    """With it, too, an exact model gives the response without delay, only later."""
    damper = f"controller.{KIND}.local_damping=2"
    late = simulate(Scenario("duration=2.0", damper, *Delays(0.3, 0.2)), engine="drake")
    overrides = ["controller.kind=damped_force", "duration=2.0", *Delays(0.0, 0.0)]
    free = simulate(LoadScenario("one_dof", overrides), engine="drake")
    times = np.linspace(0, 1.7, 500)
    expected = free.Interpolate("tool_velocity", times)
    np.testing.assert_allclose(
        late.Interpolate("tool_velocity", times + 0.3), expected, atol=1e-7
    )


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ([f"controller.{KIND}.mass=0"], f"controller.{KIND}.mass = 0.0: must be"),
        ([f"controller.{KIND}.damping=-1"], "damping = -1.0: must be null, not neg"),
        ([f"controller.{KIND}.delay=-1"], "delay = -1.0: must be a finite number >= 0"),
    ],
)
def test_bad_input_is_named(overrides, message):
    with pytest.raises(ScenarioError, match=message):
        simulate(Scenario("duration=0.1", *overrides))


def test_the_delay_of_the_model_limits_the_step():
    recording = simulate(Scenario("duration=0.1", f"controller.{KIND}.delay=0.002"))
    assert recording.termination == "completed"
    assert np.diff(recording.time).max() < 0.0021


def test_bad_parameters_of_the_block():
    good = {"mass": [[1.0]], "damping": [[1.0]], "stiffness": [[1.0]], "delay": 0.1}
    for bad in ({"mass": [[0.0]]}, {"damping": np.eye(2)}, {"delay": -0.1}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            SmithPredictorMaster(**{**good, **bad})
