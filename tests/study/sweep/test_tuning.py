"""Tests of the search for gains, with functions in closed form and with runs."""

import csv
from pathlib import Path

import pytest

from teleop_drake.cli.main import main
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.scenario.yaml_text import ParseFile
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.analysis.transparency import FeltStiffnessLoss
from teleop_drake.study.sweep import Sweep, TaskSweepResult
from teleop_drake.study.sweep.study import LoadStudy
from teleop_drake.study.sweep.tuning import STIFFNESS_LOSS, Tune

TASK = {"scenario": "two_dof_combined", "controller": "damped_force"}
B = "controller.damped_force.damping"


@pytest.fixture
def fake_runs(monkeypatch):
    """A function that replaces runs by a function from points to metrics."""

    def Use(metrics):
        def RunSweep(plan, execution):
            records = []
            for run, point in enumerate(plan.points):
                values = metrics(point)
                record = {"run": run, "varied": point, "duration": 8.0, "reason": "-"}
                status = "diverged" if values is None else "completed"
                records.append(record | {"status": status, "metrics": values})
            return TaskSweepResult(
                scenario=plan.scenario, axes=plan.axes, records=records
            )

        monkeypatch.setattr("teleop_drake.study.sweep.run.RunSweep", RunSweep)

    return Use


def Contact(settling_time, peak_force):
    return {"collision": {"settling_time": settling_time, "peak_force": peak_force}}


TIME = "collision.settling_time"
FORCE = "collision.peak_force"


@pytest.mark.parametrize("weights", [(12, 2), (1, 1)])
def test_the_minimum_of_two_parabolas(weights, fake_runs):
    """w (x - 1)^2/4 + w' (x - 3)^2/2; 4 and 2 are the metrics of the own gains."""

    def Metrics(point):
        x = point.get(B)
        return Contact(4.0, 2.0) if x is None else Contact((x - 1) ** 2, (x - 3) ** 2)

    fake_runs(Metrics)
    minimize = [f"{TIME}:{weights[0]}", f"{FORCE}:{weights[1]}"]
    result = Tune(**TASK, gains=["damping=0.1:10"], minimize=minimize)
    a = weights[0] / 4
    b = weights[1] / 2
    assert result.best.gains[B] == pytest.approx((a + 3 * b) / (a + b), rel=0.02)
    assert result.front == [result.best] and len(result.tried) <= 65
    assert result.reference.gains == {}


def test_a_front_is_that_of_two_parabolas(fake_runs):
    """The front of (x - 1)^2 and (x - 2)^2 is 1 to 2, without gains that diverge."""

    def Metrics(point):
        x = point.get(B, 4.0)
        if 1.7 < x < 3.9:
            return None
        return Contact(1e-3 + (x - 1) ** 2, 1e-3 + (x - 2) ** 2)

    fake_runs(Metrics)
    gains = ["damping=0.1:10"]
    result = Tune(**TASK, gains=gains, minimize=[TIME, FORCE], evaluations=128)
    found = [trial.gains[B] for trial in result.front]
    assert len(found) > 5 and found == sorted(found)
    assert 0.97 < found[0] < 1.05 and 1.5 < found[-1] <= 1.7
    assert result.best in result.front
    assert any(trial.reason for trial in result.tried)


def test_a_time_that_never_comes_is_the_duration(fake_runs):
    fake_runs(lambda x: Contact(None if x.get(B, 9) > 1 else 2.0, 1.0))
    result = Tune(**TASK, gains=["damping=0.1:10"], minimize=[TIME], evaluations=8)
    assert result.own.values["two_dof_combined"] == [[8.0]]
    assert result.Scores(result.best) == [0.25]
    fake_runs(lambda x: Contact(2.0, None if x.get(B, 0) < 5 else 1.0))
    result = Tune(**TASK, gains=["damping=0.1:10"], minimize=[FORCE], evaluations=8)
    assert result.reference.gains[B] >= 5
    fake_runs(lambda x: None)
    with pytest.raises(ScenarioError, match=r"none of the first 8 .* is accepted"):
        Tune(**TASK, gains=["damping=0.1:10"], minimize=[FORCE], evaluations=8)


@pytest.mark.slow
def test_a_margin_holds(fake_runs):
    """The best damping is the least one whose loop stays stable for 0.4 s more."""
    fake_runs(lambda x: Contact(1.0, 1 + x.get(B, 9.0)))
    gains = ["damping=0.1:10"]
    task = TASK | {"scenario": "one_dof"}
    result = Tune(**task, gains=gains, minimize=[FORCE], evaluations=8, margin=0.4)
    tried = sorted(trial.gains[B] for trial in result.tried if trial.gains)
    rejected = tried[: tried.index(result.best.gains[B])]
    assert 1 <= len(rejected) < 7
    for damping in (rejected[-1], result.best.gains[B]):
        overrides = {"controller.kind": "damped_force", B: damping, "delay": 0.3}
        loops = AnalyzeStability(LoadScenario("one_dof", overrides)).Loops()
        is_stable = all(loop.is_stable for loop in loops)
        assert is_stable == (damping == result.best.gains[B])


def test_felt_stiffness_is_a_spring_in_series():
    """Wave variables on bone, at low frequency: k_e = 150 N/m in series with 2 b/T."""
    waves = "controller.wave_variables.impedance"
    overrides = {"controller.kind": "wave_variables", waves: 2.0}
    scenario = LoadScenario("one_dof", overrides)
    line = 2 * 2.0 / 0.2
    assert OperatingPoints(scenario)[-1].name == "bone"
    expected = 1 - line / (150 + line)
    assert FeltStiffnessLoss(scenario) == pytest.approx(expected, rel=0.02)


@pytest.mark.slow
def test_the_best_of_real_runs(tmp_path):
    """They are as good as a grid's best. A resumed search writes the same bytes."""
    overrides = {"simulator.accuracy": 1e-5, "duration": 6}
    common = {**TASK, "gains": ["damping=0.5:8"], "minimize": [TIME]}
    common |= {"grid": {"delay": [0.1]}, "held_out": {"delay": [0.15]}}
    common |= {"evaluations": 16, "overrides": overrides}
    result = Tune(**common, out=tmp_path / "once")
    files = result.Write(tmp_path / "once")

    def Interrupt(finished, runs):
        if finished == 11:
            raise KeyboardInterrupt

    again = tmp_path / "again"
    with pytest.raises(KeyboardInterrupt):
        Tune(**common, out=again, progress=Interrupt)
    assert not (again / "runs/generation-01/runs.csv").exists()
    resumed = Tune(**common, out=again, resume=True)
    for path, other in zip(files, resumed.Write(again), strict=True):
        assert path.read_bytes() == other.read_bytes()
    with pytest.raises(ScenarioError, match="holds a sweep already"):
        Tune(**common, out=again)

    best = result.best.gains[B]
    values = [0.5 * 16 ** (i / 6) for i in range(7)]
    overrides |= {"controller.kind": "damped_force", "delay": 0.1}
    sweep = Sweep("two_dof_combined", {B: [*values, best]}, overrides=overrides)
    times = sweep.Values(TIME)
    assert times[-1] <= 1.02 * min(times[:-1])
    with open(again / "tuning.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    runs = [(gains, x) for x in ("training", "held out") for gains in ("own", "best")]
    assert [(row["gains"], row["runs"]) for row in rows] == runs
    assert float(rows[1][f"{TIME} mean"]) == pytest.approx(times[-1], rel=1e-9)

    file = str(again / "gains.yaml")
    scenario = LoadScenario("two_dof_combined", ParseFile(Path(file)))
    assert scenario.controller.damped_force.damping == best
    study = f"scenarios: [two_dof_combined]\noverrides: {file}\n"
    (tmp_path / "study.yaml").write_text(study, encoding="utf-8")
    (plan,) = LoadStudy(tmp_path / "study.yaml").plans.values()
    assert plan.scenario.controller.damped_force.damping == best
    assert main(["show", "two_dof_combined", "--set", file]) == 0


COMMAND = ["tune", "two_dof_combined", "--controller", "damped_force"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--gains", "dampin"], "damped_force.dampin: unknown key 'dampin'"),
        (["--gains", "damping=3"], "gains.damping = '3': must be LOW:HIGH"),
        (["--gains", "damping=3:1"], "LOW:HIGH, two numbers, the larger one last"),
        (["--gains", "damping=-1:1"], "damping = -1.0: must be null, "),
        (["--gains", "surgeon.stop_time"], "must be NAME=LOW:HIGH; its own value"),
        (["--evaluations", "4"], "evaluations = 4: must be 8 or more with 1 gains"),
        (["--minimize", "bone"], "minimize = 'bone': must be one of felt_stiffness"),
        (
            ["--minimize", f"{TIME}:1"],
            "must be METRIC or METRIC:WEIGHT, weights > 0 for all or none",
        ),
        (["--margin", "-1"], "margin = -1.0: must be a finite number >= 0 (s)"),
        (["--held-out", "delay"], "must be KEY=VALUES of a scenario, or one study"),
        (["--vary", f"{B}=1,2"], f"gains.{B} = (0.1"),
        (["--delay", "a"], "forward_channel.delay = 'a': must be a number"),
    ],
)
def test_bad_input(options, message, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    given = ["--gains", "damping", "--minimize", FORCE]
    assert main([*COMMAND, *given, *options]) == 2
    out, err = capsys.readouterr()
    assert not out and err.count("\n") == 1 and message in err
    assert not list(tmp_path.iterdir())


def test_the_command(capsys, tmp_path, fake_runs):
    fake_runs(lambda x: Contact(1.0, 1 + abs(x.get(B, 9.0) - 2)))
    options = ["--gains", "damping=1:4", "--minimize", FORCE, "--delay", "0.05,0.1"]
    options += ["--held-out", "delay=0.08", "--evaluations", "16", "--quiet"]
    assert main([*COMMAND, *options, "--out", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert not err and out.splitlines()[0].split()[:2] == ["damping", FORCE]
    text = (tmp_path / "gains.yaml").read_text(encoding="utf-8")
    assert text.startswith("controller.kind: damped_force\ncontroller.damped_force.d")
    assert STIFFNESS_LOSS not in out
    # What was asked for is printed: the held-out runs, those of the table.
    head, own, best = (line.split() for line in out.splitlines()[3:6])
    assert head == [
        "held",
        "out",
        "scenario",
        "bounded",
        FORCE,
        "[N]:",
        "mean",
        "largest",
    ]
    assert own == ["own", "two_dof_combined", "1", "of", "1", "8", "8"]
    assert best[:5] == ["best", "two_dof_combined", "1", "of", "1"]
    gains = ParseFile(tmp_path / "gains.yaml")
    assert float(best[5]) == pytest.approx(1 + abs(gains[B] - 2), rel=1e-3)


def test_held_out_runs_that_diverge_have_no_mean(capsys, tmp_path, fake_runs):
    fake_runs(lambda x: None if x["delay"] > 0.1 else Contact(1.0, 1.0))
    options = ["--gains", "damping=1:4", "--minimize", FORCE, "--delay", "0.05,0.1"]
    options += ["--held-out", "delay=0.2,0.3", "--evaluations", "8", "--quiet"]
    assert main([*COMMAND, *options, "--out", str(tmp_path)]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[4:6]]
    assert [row[2:] for row in rows] == 2 * [["0", "of", "2", "-", "-"]]


def test_each_option_gains_adds_to_those_before(capsys, tmp_path, fake_runs):
    fake_runs(lambda x: Contact(1.0, 1.0))
    law = "controller.four_channel"
    options = ["--controller", "four_channel", "--gains", "C2=1:2", "--gains", "C3=2:3"]
    options += ["--minimize", FORCE, "--evaluations", "16", "--quiet"]
    assert main([*COMMAND[:2], *options, "--out", str(tmp_path)]) == 0
    gains = ParseFile(tmp_path / "gains.yaml")
    head = capsys.readouterr().out.splitlines()[0].split()
    assert head[:2] == ["C2", "C3"]
    with open(tmp_path / "tuning.csv", encoding="utf-8", newline="") as file:
        row = next(csv.DictReader(file))
    assert {f"{law}.C2", f"{law}.C3"} <= {*row}
    assert {*gains} >= {"controller.kind"}
