"""Drake's DiscreteTimeDelay as a channel."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import DiscreteTimeDelay, PassThrough, Sine
from wired import Wired

from teleop_drake import MakePage, simulate
from teleop_drake.model.channels.discrete import DiscreteChannelConfig
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.analysis.stability import AnalyzeStability

H = 0.02


def Scenario(kind="discrete", delay=0.1, **more):
    """Returns one_dof with channels of a kind."""
    changes = {"duration": 0.6, "controller.kind": "direct_force"}
    for name in ("forward_channel", "return_channel"):
        changes[name] = {"kind": kind, "delay": delay, "sample_period": H}
    return LoadScenario("one_dof", {**changes, **more})


def test_what_is_sampled_comes_out_whole_periods_later():
    """After the update at t = j h, sample j - n is there, taken at (j - n) h."""
    config = DiscreteChannelConfig(delay=0.1, sample_period=H)
    channel = config.MakeChannel(size=1, initial_value=[0.5])
    diagram = Wired(
        {"source": Sine(1.0, 3.0, 0.0, 1), "channel": channel}, {"channel": "source.y0"}
    )
    simulator = Simulator(diagram)
    context = channel.GetMyContextFromRoot(simulator.get_context())
    for j in range(12):
        simulator.AdvanceTo((j + 0.5) * H)
        expected = np.sin(3.0 * (j - 5) * H) if j >= 5 else 0.5
        value = channel.get_output_port().Eval(context)
        assert value == pytest.approx([expected], abs=1e-12)


def test_it_is_drakes_block():
    config = DiscreteChannelConfig(delay=0.06, sample_period=H)
    assert type(config.MakeChannel(size=2, initial_value=[0, 0])) is DiscreteTimeDelay
    assert config.AsConstantDelay("x", 1.0).delay == pytest.approx(3.5 * H)
    assert DiscreteChannelConfig(delay=0.0, sample_period=H).PacketPeriod() == H


@pytest.mark.mostly_slow
@pytest.mark.parametrize("controller", ["direct_force", "adaptive_backstepping"])
def test_it_compiles_and_is_the_sampled_channel(controller):
    scenario = Scenario(**{"controller.kind": controller})
    compiled = simulate(scenario, engine="compiled")
    assert compiled.solver.engine == "compiled"
    sampled = simulate(Scenario("sampled", **{"controller.kind": controller}))
    in_drake = simulate(scenario, engine="drake")
    times = np.linspace(0.005, 0.595, 60)
    expected = compiled.Interpolate("tool_velocity", times)
    for other in (sampled, in_drake):
        assert_allclose(other.Interpolate("tool_velocity", times), expected, atol=1e-8)


def test_analyze_names_its_mean_delay():
    analysis = AnalyzeStability(Scenario())
    assert any("mean delay (n + 1/2) h is 0.11 s" in note for note in analysis.notes)


@pytest.mark.slow
def test_it_runs_in_a_page():
    page = MakePage(Scenario(), controllers=["direct_force"])
    assert page.notes is not None


def test_a_delay_of_a_part_of_a_period_is_refused():
    with pytest.raises(ScenarioError) as error:
        Scenario(delay=0.11)
    assert str(error.value) == (
        "forward_channel.delay = 0.11: must be a whole number of sample periods, "
        "0.02 s each"
    )


def test_a_channel_is_any_system_with_one_input_and_one_output():
    """DiscreteTimeDelay's ports are called u and y."""
    scenario = Scenario(**{"duration": 0.3})
    own = MakeTeleoperator(
        scenario,
        forward_channel=DiscreteTimeDelay(H, 5, 2),
        return_channel=DiscreteTimeDelay(H, 5, 2),
    )
    mine = simulate(scenario, teleoperator=own)
    expected = simulate(scenario)
    assert {*mine.signals} == {*expected.signals}
    times = np.linspace(0.005, 0.295, 30)
    assert_allclose(
        mine.Interpolate("tool_velocity", times),
        expected.Interpolate("tool_velocity", times),
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({"forward_channel": PassThrough(3)}, "forward_channel: y has 3 entries, must"),
        ({"robot": PassThrough(1)}, "robot: PassThrough lacks the ports input control"),
        ({"environment": PassThrough}, "must be an instance: environment=PassThrough("),
        ({"operator": 3}, "operator = 3: must be a system of Drake's"),
        (
            {"control_law": PassThrough(1)},
            "control_law: PassThrough lacks the ports",
        ),
    ],
    ids=["width", "ports", "class", "number", "law"],
)
def test_a_system_that_does_not_fit_is_refused_by_name(own, message):
    with pytest.raises(ScenarioError) as error:
        MakeTeleoperator("one_dof", **own)
    assert message in str(error.value)
