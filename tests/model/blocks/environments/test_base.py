"""An environment of a user's own: its surface is where contact is, and nothing else."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from grids import Slow

from teleop_drake.cli import main
from teleop_drake.model.blocks.environments import EnvironmentConfig, Surface
from teleop_drake.model.run.scenario_run import WhyNotCompiled
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.task_recording import LoadRecording
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.analysis.stability import AnalyzeStability

DIAGRAMS = Path(__file__).parents[4] / "diagrams"
sys.path.append(str(DIAGRAMS))
from own_environment import Floor, HuntCrossleyWall  # noqa: E402

DOWN = ["surgeon.velocity=[0, -0.1]", "surgeon.contact_force=[0, -0.2]"]


@dataclass(kw_only=True, eq=False)
class Wall(EnvironmentConfig):
    """A wall across x that tells its surface, or does not."""

    x: float = 1.05
    tells: bool = True

    def MakeEnvironment(self, start):
        normal_W = np.eye(np.size(start))[0]
        wall = HuntCrossleyWall(
            surface=Surface("contact", self.x * normal_W, normal_W),
            stiffness=1000.0,
            damping=1.0,
        )
        if not self.tells:
            wall.Surfaces = None
        return wall


def Simulate(environment, *overrides, as_block=False):
    scenario = LoadScenario("two_dof_collision", [*overrides, "duration=3"])
    if as_block:  # The scenario's layers have their bone at 1.0 m.
        block = environment.MakeEnvironment(scenario.robot.start)
        teleoperator = MakeTeleoperator(scenario, environment=block)
        return simulate(scenario, teleoperator=teleoperator)
    scenario.environment = environment
    return simulate(scenario)


@pytest.mark.parametrize("as_block", Slow([False, True]), ids=["kind", "environment="])
def test_all_asks_the_wall(as_block):
    recording = Simulate(Wall(), as_block=as_block)
    (contact, *_) = recording.EventTimes("contact")
    x = recording.Interpolate("tool_position", np.array([contact]))[0, 0]
    assert x == pytest.approx(1.05, abs=1e-8)
    force = recording["environment_force"][:, 0]
    first_force = recording.time[np.flatnonzero(force > 0)[0]]
    assert contact <= first_force < contact + 0.01
    (switch,) = recording.EventTimes("surgeon_force")
    assert switch == pytest.approx(contact + 0.1, abs=1e-5)
    collision = RunMetrics(recording)["collision"]
    assert collision["time"] == pytest.approx(contact, abs=1e-8)
    assert collision["peak_force"] == pytest.approx(force.max(), rel=0.01)


def test_a_floor_is_met_from_above(tmp_path):
    recording = Simulate(Floor(y=-0.05), *DOWN)
    (contact, *_) = recording.EventTimes("contact")
    y = recording.Interpolate("tool_position", np.array([contact]))[0, 1]
    assert y == pytest.approx(-0.05, abs=1e-8)
    metrics = RunMetrics(recording)
    # Along the normal: the force on the floor is positive, the rebound is upwards.
    force = -recording["environment_force"][:, 1]
    assert metrics["collision"]["peak_force"] == pytest.approx(force.max(), rel=0.01)
    assert (
        metrics["collision"]["velocity"] > 0 > metrics["collision"]["rebound_velocity"]
    )
    assert metrics["puncture"] is None
    # The floor has no guard at which a step would end.
    (note,) = recording.notes
    assert "environment_force" in note and "jumps or bends" in note

    recording.Save(tmp_path / "run.npz")
    again = RunMetrics(LoadRecording(tmp_path / "run.npz"))
    assert again == metrics


def test_without_surfaces_the_metrics_are_left_out_and_that_is_said():
    recording = Simulate(Wall(tells=False), as_block=True)
    assert recording["environment_force"][:, 0].max() > 0
    assert (
        recording.EventTimes("contact") == recording.EventTimes("surgeon_force") == []
    )
    metrics = RunMetrics(recording)
    assert metrics["collision"] is None and metrics["puncture"] is None
    note, _ = recording.notes
    assert "reports no surfaces" in note


@pytest.mark.slow
def test_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    own = [
        x
        for override in (*DOWN, "environment={kind: own_environment:Floor, y: -0.02}")
        for x in ("--set", override)
    ]
    short = [*own, "--duration", "1", "--engine", "auto"]
    assert main(["run", "two_dof_collision", *short, "--json", "-", "--quiet"]) == 0
    collision = json.loads(capsys.readouterr().out)["metrics"]["collision"]
    assert 0.2 < collision["time"] < 1.0
    assert main(["analyze", "two_dof_collision", *own]) == 0
    assert "contact" in capsys.readouterr().out
    assert main(["diagram", "two_dof_collision", *own, "-o", "loop.dot"]) == 0


def test_the_layers_do_not_vanish_with_their_kind():
    kind = "environment.kind=own_environment:Floor"
    with pytest.raises(ScenarioError) as error:
        LoadScenario("two_dof_collision", [kind])
    assert str(error.value).startswith("environment.layers = [")
    assert str(error.value).endswith(
        "must be [] for the own_environment:Floor environment"
    )
    scenario = LoadScenario("two_dof_collision", ["environment.layers=[]", kind])
    assert scenario.environment.kind == "own_environment:Floor"


def test_a_run_without_surfaces_says_so(monkeypatch, capsys):
    monkeypatch.setattr(Floor, "MakeEnvironment", Wall(tells=False).MakeEnvironment)
    environment = "environment={kind: own_environment:Floor}"
    run = ["run", "two_dof_collision", "--duration", "0.1", "--json", "-", "--quiet"]
    assert main([*run, "--set", environment]) == 0
    output = capsys.readouterr()
    (note,) = json.loads(output.out)["notes"]
    assert output.err == f"teleop-drake: {note}\n"
    assert main(run) == 0
    output = capsys.readouterr()
    assert "notes" not in json.loads(output.out) and output.err == ""


@pytest.mark.slow
def test_three_axes_meet_a_slope():
    """On a plane that no axis is normal to."""
    normal_W = np.array([0.6, 0.0, -0.8])
    surface = Surface("contact", [0.45, 0.0, 0.18], normal_W)
    scenario = LoadScenario(
        DIAGRAMS / "own_arm.yaml", ["surgeon.velocity=[0.02, 0.02, -0.1]"]
    )

    def Make():
        slope = HuntCrossleyWall(surface=surface, stiffness=500.0, damping=1.0)
        return MakeTeleoperator(scenario, environment=slope)

    recording = simulate(scenario, teleoperator=Make())
    contact = recording.EventTimes("contact")[:1]
    p_WT = recording.Interpolate("tool_position", np.array(contact))[0]
    assert surface.Depth(p_WT) == pytest.approx(0, abs=1e-8)
    collision = RunMetrics(recording)["collision"]
    assert collision["time"] == pytest.approx(contact[0], abs=1e-8)
    v_WT = recording.Interpolate("tool_velocity", np.array(contact))[0]
    assert collision["velocity"] == pytest.approx(v_WT @ normal_W, rel=1e-6)

    points = AnalyzeStability(scenario, teleoperator=Make()).points
    assert [x.model.point.name for x in points] == ["empty", "contact"]
    deepest = points[-1].model.point.position
    assert surface.Depth(deepest) > 0


@pytest.mark.slow
def test_a_block_of_ones_own_runs_as_machine_code():
    """Also without modes: contact is found where the tool crosses its surface."""
    overrides = [
        "environment={kind: own_environment:Floor}",
        "surgeon.velocity=[0, -0.1]",
        "surgeon.contact_force=[0, -0.2]",
        "duration=0.8",
        "controller.kind=direct_force",
        "simulator.accuracy=1e-9",
    ]
    scenario = LoadScenario("two_dof_collision", overrides)
    assert WhyNotCompiled(scenario) == ""
    runs = [simulate(scenario, engine=engine) for engine in ("drake", "compiled")]
    drake, compiled = ({e.name: e.time for e in run.events} for run in runs)
    assert "contact" in drake and compiled == pytest.approx(drake, abs=1e-6)
