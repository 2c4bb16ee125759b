"""Tests of ensembles: what their members do, they would do alone."""

import dataclasses

import numpy as np
import pytest
from benchmarks import accuracy, contenders

from teleop_drake.scenario import CONTROLLERS, LoadScenario, ScenarioError
from teleop_drake.simulation import simulate, simulate_ensemble
from teleop_drake.simulation.ensemble import MakeEnsemble, MemberSignals
from teleop_drake.tasks.metrics import RunSummary

DELAYS = (0.09, 0.1, 0.115)


def Load(task="one_dof", forward=0.1, back=0.1, **overrides):
    delays = {"forward_channel.delay": forward, "return_channel.delay": back}
    return LoadScenario(task, delays | overrides)


@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.parametrize("task", ["one_dof", "two_dof_combined"])
def test_equal_members_take_the_steps_of_one(task, kind):
    # Up to the bone and back.
    duration = 3.0 if task == "two_dof_combined" else 15.5
    scenario = Load(task, duration=duration, **{"controller.kind": kind})
    alone = simulate(scenario)
    assert alone.EventTimes("contact")
    for member in simulate_ensemble([scenario] * 3):
        assert member.scenario == scenario
        assert member.termination == "completed"
        assert list(member.signals) == list(alone.signals)
        assert member.solver.steps == alone.solver.steps
        np.testing.assert_allclose(member.time, alone.time, rtol=0, atol=1e-9)
        for name, x in alone.signals.items():
            np.testing.assert_allclose(
                member[name],
                x,
                rtol=0,
                atol=1e-6 * max(np.ptp(x), 1e-6),
                err_msg=name,
            )


@pytest.mark.parametrize("task", ["one_dof", "two_dof_combined"])
def test_members_are_as_accurate_as_alone(task):
    duration = 4.0 if task == "two_dof_combined" else 17.0
    scenarios = [Load(task, delay, delay, duration=duration) for delay in DELAYS]
    bound = contenders.TARGETS[scenarios[0].num_axes]
    for member in simulate_ensemble(scenarios):
        delay = member.scenario.forward_channel.delay
        oracle = accuracy.Oracle(task, "adaptive_backstepping", delay, duration)
        solution = contenders.FromRecording(member)
        assert accuracy.LargestError(oracle, solution) < bound


def test_each_channel_has_its_delay():
    pairs = [(0.05, 0.2), (0.2, 0.05), (0.1, 0.1)]
    scenarios = [Load(forward=a, back=b, duration=9.0) for a, b in pairs]
    for member, scenario in zip(simulate_ensemble(scenarios), scenarios, strict=True):
        alone = simulate(scenario)
        assert member.scenario == scenario
        names = [event.name for event in alone.events]
        assert [event.name for event in member.events] == names
        for mine, its in zip(member.events, alone.events, strict=True):
            assert mine.time == pytest.approx(its.time, abs=1e-5)
        start = member.signals["forward_packet_received"][:, 1].nonzero()[0][0]
        assert member.time[start] == scenario.forward_channel.delay
        metrics, expected = (
            RunSummary(recording)["metrics"]["puncture"]
            for recording in (member, alone)
        )
        assert metrics == pytest.approx(expected, rel=1e-4)


def test_jumps_of_the_others_leave_no_trace():
    scenarios = [Load("two_dof_combined", x, x, duration=3.0) for x in DELAYS]
    for member, scenario in zip(simulate_ensemble(scenarios), scenarios, strict=True):
        jumps = member.time[1:][np.diff(member.time) == 0]
        alone = simulate(scenario)
        np.testing.assert_allclose(
            jumps, alone.time[1:][np.diff(alone.time) == 0], rtol=0, atol=1e-5
        )


def test_member_signals():
    times = np.array([0.0, 1.0, 1.0, 2.0])
    mine, other = np.array([[1.0, 2, 2, 3], [5, 6, 7, 8]])
    signals = {
        "tool_position": np.column_stack((mine, mine, other, other)),
        "return_packet_sent": np.column_stack((mine, other, 10 * mine, 10 * other)),
    }

    def Member(member, *crossings):
        return MemberSignals(
            times, signals, member=member, num_members=2, crossings=crossings
        )

    own_times, own = Member(0)
    assert own_times.tolist() == [0, 1, 2]
    assert own["tool_position"].tolist() == [[1, 1], [2, 2], [3, 3]]
    assert own["return_packet_sent"].tolist() == [[1, 10], [2, 20], [3, 30]]
    assert Member(0, 1.0)[0].tolist() == [0, 1, 1, 2]
    own_times, own = Member(1)
    assert own_times.tolist() == [0, 1, 1, 2]
    assert own["return_packet_sent"].tolist() == [[5, 50], [6, 60], [7, 70], [8, 80]]


def test_if_one_diverges_each_is_simulated_alone():
    changes = {"controller.kind": "direct_force", "divergence_speed_ratio": 1.6}
    scenarios = [Load(forward=a, back=a, duration=9.0, **changes) for a in (0.05, 0.4)]
    members = simulate_ensemble(scenarios)
    assert [x.termination for x in members] == ["completed", "diverged"]
    for member, scenario in zip(members, scenarios, strict=True):
        alone = simulate(scenario)
        assert member.reason == alone.reason
        np.testing.assert_array_equal(member["tool_velocity"], alone["tool_velocity"])


def test_the_diagram_is_that_of_a_teleoperator():
    ensemble = MakeEnsemble([Load(forward=x, back=x) for x in DELAYS])
    assert ensemble.get_name() == "ensemble"
    assert {system.get_name() for system in ensemble.GetSystems()} == {
        "stale_cache_guard",
        "master",
        "forward_channel",
        "controller",
        "robot",
        "environment",
        "return_channel",
    }
    robot = ensemble.GetSubsystemByName("robot")
    assert robot.GetSubsystemByName("plant").num_positions() == len(DELAYS)


@pytest.mark.parametrize(
    ("scenarios", "message"),
    [
        ([], "scenarios = []: must have at least one member"),
        (
            [Load(**{"controller.kind": "wave_variables"})],
            "controller.kind = 'wave_variables': must be one of direct_force, "
            "adaptive_backstepping in an ensemble",
        ),
        (
            [Load(), Load(back=0.0)],
            "return_channel = transport with a delay of 0 s: must be transport with a "
            "delay > 0 in an ensemble",
        ),
        (
            [
                Load(
                    **{
                        "forward_channel.kind": "sampled",
                        "forward_channel.sample_period": 0.01,
                    }
                )
            ],
            "forward_channel = sampled with a delay of 0.1 s: must be transport with a "
            "delay > 0 in an ensemble",
        ),
        (
            [Load(), Load(**{"robot.mass": 0.6})],
            "robot.mass: must be the same for all members of an ensemble, which may "
            "differ in their delays only",
        ),
        (
            [LoadScenario("network_tracking_linear")],
            "scenarios: must be teleoperations, not a tracking",
        ),
    ],
)
def test_what_cannot_be_an_ensemble_is_refused(scenarios, message):
    with pytest.raises(ScenarioError) as info:
        simulate_ensemble(scenarios)
    assert str(info.value) == message


def test_a_bad_member_is_refused():
    bad = Load()
    bad.robot = dataclasses.replace(bad.robot, mass=-1.0)
    with pytest.raises(ScenarioError, match=r"robot\.mass"):
        simulate_ensemble([Load(), bad])
