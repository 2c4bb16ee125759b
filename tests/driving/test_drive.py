"""Driving: a script in the place of the hand."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from teleop_drake.driving import (
    AsRecorded,
    Drive,
    MakeControls,
    MakeView,
    Score,
    Scores,
    ScriptedHand,
    Segment,
    Settings,
)
from teleop_drake.driving.drive import PERIOD
from teleop_drake.recording import Recording
from teleop_drake.scenario import LoadScenario, ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.tasks.metrics import RunMetrics

DIAGRAMS = Path(__file__).parents[2] / "diagrams"
DIRECT = Settings(controller="direct_force", delay=0.1)
COARSE = ["simulator.accuracy=1e-7", "simulator.max_step_size=0.02"]


def Driven(hand, duration, overrides=(), **arguments):
    drive = Drive(
        "one_dof",
        [*COARSE, *overrides],
        hand=hand,
        duration=duration,
        rate=math.inf,
        **{"engine": "drake", **arguments},
    )
    drive.Run()
    return drive.segments


@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_what_the_hand_did_can_be_repeated(engine, tmp_path):
    """The recorded operator gives the same run, to what the solver is accurate to."""
    # Half of the full speed is the task's speed.
    hand = ScriptedHand(lambda t: [0.5 * math.sin(2 * t) ** 2], DIRECT)
    (segment,) = Driven(hand, 2.0, engine=engine)
    assert segment.recording.termination == "completed"
    assert len(hand.felt) == 2.0 / PERIOD == len(segment.command) - 1
    file = tmp_path / "hand.csv"
    np.savetxt(file, segment.command, delimiter=",")
    scenario = AsRecorded(segment, str(file)).scenario
    scenario = dataclasses.replace(scenario, duration=2.0)
    again, mine = simulate(scenario), segment.recording
    times = np.linspace(0.2, 1.99, 40)
    for name in ("tool_position", "tool_velocity"):
        expected, found = (x.Interpolate(name, times) for x in (mine, again))
        np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())
    # The felt force arrives at the hand as the loop has it.
    force, velocity = hand.felt[-1]
    end = mine["forward_packet_sent"][-1]
    assert (force, velocity) == (end[:1], mine["return_packet_received"][-1, 1:])


def test_settings_change_on_the_way():
    """A new segment begins at the pose where the last one ended, at rest."""
    others = dataclasses.replace(DIRECT, delay=0.05, stiffness=2.0)
    hand = ScriptedHand(lambda t: [0.5], DIRECT, changes=[(0.5, others)], anew=[1.2])
    first, second, third = Driven(hand, 2.0)
    start = second.scenario.robot.start
    np.testing.assert_array_equal(start, first.recording["tool_position"][-1])
    assert start[0] > 0
    assert second.recording["tool_velocity"][0] == 0
    assert second.scenario.forward_channel.delay == 0.05
    assert second.settings == others
    # Anew: from the start of the task, with the settings as they are.
    assert third.scenario.robot.start == [0.0]
    assert third.settings == others
    total = sum(x.recording.time[-1] for x in (first, second, third))
    assert total == pytest.approx(2.0)
    score = Score(first)
    metrics = RunMetrics(first.recording)
    assert score["overshoot"] == metrics["start_velocity_overshoot"]
    assert score["impact"] is None
    rows = Scores([first, second])
    assert len(rows) == 4
    assert len({len(row) for row in rows}) == 1


def test_behind_the_contact_surface_it_begins_at_the_start():
    lines = []
    overrides = [
        "environment.layers.free.start=0.0001",
        "environment.layers.bone.start=0.0002",
        "environment.layers.bone.reference=0.0002",
        "environment.layers.bone.stiffness=1.0",
    ]
    others = dataclasses.replace(DIRECT, delay=0.05)
    hand = ScriptedHand(lambda t: [1.0], DIRECT, changes=[(1.0, others)])
    first, second = Driven(hand, 1.5, overrides, say=lines.append)
    assert first.recording["tool_position"][-1] > 0.0002
    assert second.scenario.robot.start == [0.0]
    assert len(lines) == 1
    assert lines[0].startswith("It begins at the start of the task: robot.start = ")


def test_what_is_not_possible_is_said():
    lines = []
    hand = ScriptedHand(lambda t: [0.0], Settings(controller="no_such"))
    overrides = ["controller.kind=direct_force"]
    (segment,) = Driven(hand, 0.1, overrides, say=lines.append)
    assert "controller.kind = 'no_such': must be one of" in lines[0]
    assert segment.scenario.controller.kind == "direct_force"
    assert segment.recording.time[-1] == pytest.approx(0.1)
    with pytest.raises(ScenarioError, match="scenario"):
        Drive("no_such", hand=hand)


def test_other_files_of_the_scenario_are_found_from_everywhere(monkeypatch):
    monkeypatch.chdir(DIAGRAMS.parent)
    scenario = LoadScenario("diagrams/own_arm.yaml")
    recording = Recording(
        scenario=scenario, time=np.array([0.0, 1.5]), signals={}, events=[], solver=None
    )
    segment = Segment(
        settings=DIRECT,
        scenario=scenario,
        recording=recording,
        command=np.zeros((2, 4)),
        rate=1.0,
        was_late=False,
    )
    again = AsRecorded(segment, "hand.csv").scenario
    assert again.robot.file == str(DIAGRAMS / "own_arm.urdf")
    assert (again.surgeon.kind, again.surgeon.file) == ("recorded", "hand.csv")
    assert again.duration == 1.5
    assert scenario.robot.file == "diagrams/own_arm.urdf"


def test_a_segment_is_as_long_as_its_steps_allow():
    """What simulate() would refuse is cut into pieces."""
    hand = ScriptedHand(lambda t: [0.0], DIRECT)
    drive = Drive("one_dof", ["simulator.max_step_size=1e-4"], hand=hand, duration=400)
    scenario = drive._Load(DIRECT, None)
    assert scenario.duration == 100


def test_machine_code_ends_as_drake_does():
    """What the hand wants, and a run that diverges, end a segment of either engine."""
    ends = []
    others = dataclasses.replace(DIRECT, delay=0.05)
    for engine in ("drake", "compiled"):
        hand = ScriptedHand(lambda t: [1.0], DIRECT, changes=[(0.5, others)])
        segments = Driven(hand, 2.0, ["divergence_speed_ratio=1.05"], engine=engine)
        ends.append([(x.recording.time[-1], x.recording.termination) for x in segments])
    assert [x for _, x in ends[1]] == [x for _, x in ends[0]]
    assert "diverged" in {x for _, x in ends[0]} > {"diverged"}
    np.testing.assert_allclose(*([t for t, _ in x] for x in ends), atol=1e-4)


def test_the_segment_under_way_outlives_its_page():
    def Command(time):
        if time >= 0.25:
            raise RuntimeError("Meshcat's thread exited")
        return [1.0]

    said = []
    (segment,) = Driven(ScriptedHand(Command, DIRECT), 2.0, say=said.append)
    assert segment.recording.time[-1] == 0.25
    assert said == ["Ended: Meshcat's thread exited."]


def test_by_the_sliders_of_a_page():
    """The command is the slider's, and what is felt is shown."""
    meshcat = Meshcat()
    scenario = LoadScenario("one_dof", [*COARSE, "controller.kind=direct_force"])
    controls = MakeControls(meshcat, scenario)
    meshcat.SetSliderValue("hand x (← →)", 0.5)
    drive = Drive(
        "one_dof",
        [*COARSE, "controller.kind=direct_force"],
        hand=controls,
        view=MakeView(meshcat, scenario),
        duration=0.5,
        rate=math.inf,
        engine="drake",
    )
    drive.Run()
    (segment,) = drive.segments
    # Half of the full speed, twice that of the task, after one picture.
    np.testing.assert_allclose(segment.command[1:, 1], 0.001)
    assert segment.recording["tool_velocity"][-1] > 0
    end = segment.recording.commands[-1, 0]
    shown = meshcat.GetSliderValue("felt: force x (N)")
    assert shown == pytest.approx(end, abs=2e-5)
    for path in ("force/line_0", "speed/line_0", "force/frame"):
        assert meshcat.HasPath(f"/driving/{path}")
