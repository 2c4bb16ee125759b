"""The recorded operator: its file, and what of it is refused."""

import numpy as np
import pytest
import yaml

from teleop_drake import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError, ScenarioToYaml


def test_a_file_beside_the_scenario(tmp_path):
    (tmp_path / "hand.csv").write_text("# by hand\nt,v\n0.0,0.0\n1.0,0.002\n1.5,0.0\n")
    built_in = LoadScenario("one_dof").robot.start.tolist()
    (tmp_path / "mine.yaml").write_text(
        "duration: 1.0\n"
        f"robot: {{model: slider, start: {built_in}, mass: 0.5, damping: 0.1}}\n"
        "surgeon: {kind: recorded, velocity: [0.002], file: hand.csv}\n"
        "controller: {kind: direct_force}\n"
    )
    scenario = LoadScenario(tmp_path / "mine.yaml")
    assert scenario.surgeon.LongestStep() == pytest.approx(1.0)
    dut = scenario.surgeon.MakeOperator(start=built_in)
    context = dut.CreateDefaultContext()
    values = []
    for time in (0.5, 1.0, 1.25, 1.5, 9.0):
        context.SetTime(time)
        values.append(dut.GetOutputPort("velocity_command").Eval(context).item())
    assert values == pytest.approx([0.001, 0.002, 0.001, 0.0, 0.0])


def Hand(tmp_path, text, **changes):
    path = tmp_path / "hand.csv"
    path.write_text(text)
    hand = {"surgeon.kind": "recorded", "surgeon.file": str(path), "duration": 1.0}
    return LoadScenario("one_dof", hand | changes)


def test_the_command_of_a_run_is_that_of_the_file(tmp_path):
    """A logger at 1 kHz, with UNIX stamps."""
    times = np.arange(1001) * 1e-3
    rows = [f"{1.7e9 + t:.3f},{1e3 * 0.001 * np.sin(3 * t):.9f}" for t in times]
    run = simulate(Hand(tmp_path, "stamp,v_mm_s\n" + "\n".join(rows)))
    sent = run.Interpolate("forward_packet_sent", times[1:-1])[:, 1]
    assert sent == pytest.approx(0.001 * np.sin(3 * times[1:-1]), abs=1e-9)
    assert run.notes == [
        "surgeon: 1001 rows in 1 s, every 0.001 s, velocity in 'v_mm_s', up to 0.001 "
        "m/s, clock: s since 1970"
    ]


def test_a_hand_that_falls_out_of_the_run_is_told(tmp_path):
    run = simulate(Hand(tmp_path, "t,v\n5,0.001\n7,0.001\n"))
    assert run.notes[1] == (
        "surgeon: nothing of its velocity, from 5 to 7 s, falls into the run, 0 to 1 s"
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"surgeon.file": None},
            "surgeon.file = null: must be a table of time and v",
        ),
        ({"surgeon.file": "none.csv"}, "must be readable (No such file or directory)"),
        ({"surgeon.file": {"quantity": "position"}}, "must be a table of time and v_d"),
    ],
)
def test_refused(changes, message, tmp_path):
    with pytest.raises(ScenarioError) as error:
        Hand(tmp_path, "t,v\n0,1\n1,1\n", **changes)
    assert message in str(error.value)


def test_no_hand_is_as_fast(tmp_path):
    with pytest.raises(ScenarioError, match="velocities up to 1000 m/s, not 2000 m/s"):
        Hand(tmp_path, "t,v\n0,2000\n1,1\n")


def test_a_mapping_names_columns_beside_the_scenario(tmp_path):
    """The path in it is relative to the scenario's file, and it is saved with it."""
    (tmp_path / "log.csv").write_text("ms;a;b\n0;1;2\n500;1;2\n")
    scenario = LoadScenario("one_dof")
    hand = {
        "surgeon": {
            "kind": "recorded",
            "velocity": [0.002],
            "file": {
                "file": "log.csv",
                "columns": {"time": "ms", "velocity": ["b"]},
                "units": {"time": "ms", "velocity": "mm/s"},
            },
        }
    }
    tree = yaml.safe_load(ScenarioToYaml(scenario)) | hand
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(tree))
    loaded = LoadScenario(tmp_path / "mine.yaml")
    plan = loaded.surgeon.MakePlan()
    assert plan.parameters["breaks"].tolist() == [0, 0.5]
    assert plan.parameters["coefficients"][0, 0].tolist() == [0.002]
    assert yaml.safe_load(ScenarioToYaml(loaded))["surgeon"]["file"] == {
        **hand["surgeon"]["file"],
        "file": str(tmp_path / "log.csv"),
    }
