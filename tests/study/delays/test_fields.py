"""Tests of delays of single fields of a packet."""

import numpy as np
import pytest

from teleop_drake import Compile, simulate
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.scenario import LoadScenario, ScenarioFromYaml, ScenarioToYaml
from teleop_drake.study.analysis.stability import AnalyzeStability


def Scenario(*overrides, kind="direct_force", **fields):
    named = {f"forward_channel.fields.{k}": {"delay": x} for k, x in fields.items()}
    base = {"controller.kind": kind, "duration": 1.5, **named}
    return LoadScenario("one_dof", [*base.items(), *overrides])


def Signals(run, times):
    names = ("forward_packet_sent", "forward_packet_received")
    return [run.Interpolate(name, times) for name in names]


TIMES = np.arange(0.4, 1.5, 0.013)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_a_field_is_older_than_the_packet(engine):
    """The velocity takes 0.1 s; the force 0.08 s more."""
    run = simulate(Scenario(force=0.08), engine=engine)
    _, received = Signals(run, TIMES)
    velocity, _ = Signals(run, TIMES - 0.1)
    force, _ = Signals(run, TIMES - 0.18)
    tolerance = 2e-5 * np.ptp(force[:, 0])
    assert received[:, 0] == pytest.approx(force[:, 0], abs=tolerance)
    assert received[:, 1] == pytest.approx(velocity[:, 1], abs=1e-9)
    # Without the delay of the field it would be another force.
    assert np.abs(received[:, 0] - velocity[:, 0]).max() > 1e2 * tolerance


@pytest.mark.slow
def test_both_fields_are_lost_with_their_packet():
    """The delayed field of a packet has the loss of the packet."""
    network = {
        "kind": "network",
        "delay": 0.05,
        "sample_period": 0.02,
        "loss": {"kind": "independent", "probability": 0.3},
        "fields": {"force": {"delay": 0.07}},
    }
    scenario = Scenario(("forward_channel", network))
    run = simulate(scenario)
    drake = simulate(scenario, engine="drake")
    channel = scenario.forward_channel.Network(1.5, stream="forward_channel")
    shown, stamps = channel.ShownUntil(scenario.forward_channel.receiver, 1.5)
    stamp = stamps[np.searchsorted(shown, TIMES, side="right") - 1]
    _, received = Signals(run, TIMES)
    velocity, _ = Signals(run, stamp)
    force, _ = Signals(run, stamp - 0.07)
    tolerance = 1e-5 * np.ptp(force[:, 0])
    assert received[:, 0] == pytest.approx(force[:, 0], abs=tolerance)
    assert received[:, 1] == pytest.approx(velocity[:, 1], abs=1e-9)
    assert np.abs(received[:, 0] - velocity[:, 0]).max() > 100 * tolerance
    assert run.channels["forward_channel"].lost > 10
    assert drake.channels == run.channels
    other = Signals(drake, TIMES)[1]
    assert other == pytest.approx(received, abs=1e-4 * np.ptp(received[:, 0]))


def test_a_program_takes_other_delays_of_fields():
    program = Compile(Scenario(force=0.08))
    found = program.Run(**{"forward_channel.fields.force.delay": 0.03})
    expected = Signals(simulate(Scenario(force=0.03)), TIMES)[1]
    tolerance = 1e-6 * np.ptp(expected[:, 0])
    assert Signals(found, TIMES)[1] == pytest.approx(expected, abs=tolerance)
    before = Signals(program.Run(), TIMES)[1]
    assert np.abs(before - expected).max() > 100 * tolerance


def test_fields_are_kept_in_yaml():
    scenario = Scenario(velocity=0.08)
    again = ScenarioFromYaml(ScenarioToYaml(scenario))
    assert again.forward_channel.fields == {"velocity": {"delay": 0.08}}


NAMES = {
    "adaptive_backstepping": ("force", "velocity"),
    "wave_variables": ("wave", "position"),
    "four_channel": ("position", "velocity", "force"),
    "time_domain_passivity": ("force", "energy"),
    "proportional_damping": ("position",),
    "smith_predictor": ("force", "velocity"),
}


@pytest.mark.parametrize("kind", NAMES)
def test_every_architecture_names_its_fields(kind):
    from teleop_drake.model.run.simulate import MakeDiagram

    names = NAMES[kind]
    diagram = MakeDiagram(Scenario(kind=kind, **dict.fromkeys(names, 0.01)))
    channel = diagram.GetSubsystemByName("forward_channel")
    found = [x.get_name() for x in channel.GetSystems()]
    assert [name for name in names if name in found] == list(names)
    with pytest.raises(ScenarioError, match=r"forward_channel.fields = 'temperature'"):
        MakeDiagram(Scenario(kind=kind, temperature=0.01))


REFUSED = [
    ({"force": 0.1}, "forward_channel.fields.force = 0.1: must be a mapping"),
    ({"force": {}}, "forward_channel.fields.force = {}: must be a mapping"),
    ({"force": {"delay": -1}}, "fields.force.delay = -1: must be 0 or a finite"),
    ({"force": {"delay": "x"}}, "fields.force.delay = 'x': must be a number"),
    ({"force": {"delay": 0.1, "loss": 1}}, "must be a mapping with the key delay"),
]


@pytest.mark.parametrize(("fields", "message"), REFUSED)
def test_bad_fields(fields, message):
    with pytest.raises(ScenarioError) as error:
        Scenario(("forward_channel.fields", fields))
    assert message in str(error.value)


def test_an_analysis_refuses_fields():
    with pytest.raises(ScenarioError, match="an analysis has one delay each way"):
        AnalyzeStability(Scenario(velocity=0.08))


def test_fields_without_delay_change_nothing():
    scenario = Scenario(velocity=0.0)
    assert AnalyzeStability(scenario).forward_delay == 0.1
    received = Signals(simulate(scenario), TIMES)[1]
    expected = Signals(simulate(Scenario()), TIMES)[1]
    assert received == pytest.approx(expected, abs=1e-6 * np.ptp(expected[:, 0]))
