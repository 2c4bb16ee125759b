"""The README and the pages of the documentation keep what they promise."""

import re

import numpy as np
import pytest
import yaml
from documentation import PAGES, ROOT, TEXT, Blocks
from grids import Slow
from league_table import (
    ARCHITECTURES,
    ROUND_TRIPS,
    HasBone,
    IsBounded,
    Medians,
    ReadTable,
    Select,
    Settles,
)
from matplotlib.image import imread
from runs import Run

from teleop_drake.analysis.stability import AnalyzeStability
from teleop_drake.cli import main
from teleop_drake.figures.runs import PlotComparison, SaveFigure
from teleop_drake.scenario import CONTROLLERS, LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.sweep import FlattenMetrics
from teleop_drake.sweep.plan import PointOverrides
from teleop_drake.sweep.study import LoadStudy
from teleop_drake.tasks.metrics import RunMetrics


def test_the_commands_are_one_line_each():
    """.ci/run executes all but the second."""
    commands = Blocks("sh")
    assert [command.count("\n") for command in commands] == [1, 1, 1, 1]
    set_up, _, tests, slow_tests = commands
    assert "teleop-drake compare two_dof_combined" in set_up
    assert "pytest" in tests and "slow" not in tests
    assert slow_tests.endswith(" -m slow\n")


def Anchors(text):
    """The anchors that GitHub makes of the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in headings}


LINKED = [*ROOT.glob("*.md"), *PAGES, *ROOT.glob("*/*.md"), *ROOT.glob("*/thesis/*.md")]


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", text):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in Anchors(target.read_text("utf-8")), link


def test_every_page_is_in_the_index():
    index = (ROOT / "teleop_drake/docs/index.md").read_text(encoding="utf-8")
    assert len(PAGES) > 5
    for page in PAGES:
        assert page.stem == "index" or f"]({page.name})" in index


@pytest.mark.filterwarnings("error")
def test_examples_run(capsys):
    """Each as a script of its own."""
    blocks = Blocks("python")
    assert len(blocks) == 7
    for block in blocks:
        exec(block, {"__name__": "__main__"})
        assert capsys.readouterr().out


def test_command_lines_are_understood(tmp_path, monkeypatch):
    """Each line parses; what it would simulate is not simulated here."""
    from teleop_drake.cli.main import MakeParser

    monkeypatch.chdir(tmp_path)
    parser = MakeParser()
    (block,) = [b for b in Blocks("") if b.startswith("teleop-drake list")]
    lines = [re.split(r"\s{3,}", line)[0] for line in block.splitlines()]
    assert len(lines) >= 5
    for line in lines:
        assert parser.parse_args(line.split()[1:]).command


def test_table_is_that_of_the_runs():
    rows = re.findall(
        r"^\| `([\w.]+)` \| (\S+) \| (\S+) \| (\S+) \|$", TEXT, re.MULTILINE
    )
    assert len(rows) == 5
    for i, kind in enumerate(CONTROLLERS):
        metrics = RunMetrics(Run("two_dof_combined", kind))
        for name, *values, _ in rows:
            value = metrics
            for key in name.split("."):
                value = value[key]
            if values[i] == "never":
                assert value is None
            else:
                assert value == pytest.approx(float(values[i]), rel=1e-3), name


@pytest.mark.parametrize("task", ["one_dof", "two_dof_collision"])
def test_delay_margins(task):
    (cells,) = re.findall(
        rf"^\| `{task}` \|((?: [\w.-]+ \|){{6}})$", TEXT, re.MULTILINE
    )
    cells = cells.replace("|", "").split()
    for i, kind in enumerate(CONTROLLERS):
        analysis = AnalyzeStability(LoadScenario(task, {"controller.kind": kind}))
        margins = {
            point["name"]: point["delay_margin"]
            for point in analysis.ToRecord()["operating_points"]
        }
        for layer, cell in zip(
            ("tissue", "free", "bone"), cells[3 * i :], strict=False
        ):
            if cell == "-":
                assert layer not in margins
            elif cell == "any":
                assert margins[layer] is None
            else:
                assert margins[layer] == pytest.approx(float(cell), rel=3e-3)
        name = ("direct force", "adaptive")[i]
        (row,) = re.findall(rf"^\| `{task}`, {name} \|(.*)\|$", TEXT, re.MULTILINE)
        bone = analysis["bone"]
        for loop, cell in zip((bone, bone.force_mode), row.split("|"), strict=True):
            root = loop.RightmostRoot(0.2)
            parts = [float(x) for x in re.findall(r"-?[\d.]+", cell)]
            expected = [root.real, root.imag][: len(parts)]
            assert parts == pytest.approx(expected, rel=5e-3, abs=1e-3)


LEAGUE = ReadTable()
EXACT = Select(LEAGUE, channel="exact")


@pytest.mark.parametrize("kind", ARCHITECTURES)
def test_league_table(kind):
    (cells,) = re.findall(rf"^\| `{kind}` \|(.*)\|$", TEXT, re.MULTILINE)
    mine = Select(EXACT, controller=kind)
    bones = [row for row in mine if HasBone(row["task"])]
    assert (len(mine), len(bones)) == (35, 30)
    trips = [row["round_trip"] for row in mine if not IsBounded(row)]
    medians = Medians(LEAGUE, 0.2)[kind]
    columns = ("puncture overshoot", "first impact", "settles after", "contact at")
    values = (medians[name] for name in (*columns, "felt stiffness"))
    assert [cell.strip() for cell in cells.split("|")] == [
        str(sum(map(IsBounded, mine))),
        str(sum(map(Settles, bones))),
        f"{min(trips):g}" if trips else "never",
        *("-" if value is None else f"{value:.3g}" for value in values),
    ]


def test_what_the_league_says():
    """Each claim of the conclusions, from the table."""
    rows = {trip: Medians(LEAGUE, trip) for trip in ROUND_TRIPS}
    at_rest = {
        trip: [kind for kind in ARCHITECTURES if rows[trip][kind]["settles after"]]
        for trip in ROUND_TRIPS
    }
    for kind in ("damped_force", "wave_variables", "proportional_damping"):
        mine = Select(EXACT, controller=kind)
        assert all(map(IsBounded, mine))
        assert all(Settles(row) for row in mine if HasBone(row["task"]))
        assert all(rows[trip][kind]["contact at"] > 1.1 for trip in ROUND_TRIPS)
    felt = {kind: rows[1.0][kind]["felt stiffness"] for kind in at_rest[1.0]}
    assert max(felt, key=felt.get) == "damped_force"
    for row in rows.values():
        damped, adaptive = row["damped_force"], row["adaptive_backstepping"]
        assert damped["first impact"] < adaptive["first impact"]
        assert damped["contact at"] > adaptive["contact at"]
    feels = [k for k in at_rest[0.2] if rows[0.2][k]["felt stiffness"] > 100]
    assert set(feels) == {"adaptive_backstepping", "damped_force"}
    slow = rows[1.0]["adaptive_backstepping"]
    assert slow["start overshoot"] > 100
    assert slow["first impact"] > 2 * rows[1.0]["wave_variables"]["first impact"]
    lost = Select(EXACT, controller="adaptive_backstepping")
    assert {
        (row["task"], row["surgeon"], row["round_trip"])
        for row in lost
        if not IsBounded(row)
    } == {(task, "never", 1.0) for task in ("two_dof_collision", "two_dof_combined")}
    four = {trip: rows[trip]["four_channel"] for trip in (0.1, 0.2)}
    assert four[0.1]["felt stiffness"] > 140 and four[0.2]["felt stiffness"] < 75
    assert four[0.2]["control effort"] > 20
    passive = Select(EXACT, controller="time_domain_passivity", surgeon="switches")
    assert not any(map(Settles, Select(passive, round_trip=0.0)))
    for row in Select(EXACT, controller="smith_predictor"):
        case = {key: row[key] for key in ("task", "surgeon")} | {"round_trip": 0.0}
        (ideal,) = Select(EXACT, controller="direct_force", **case)
        assert row["start_overshoot"] < 1.1 * ideal["start_overshoot"]
    lost_runs = {}
    for kind in ARCHITECTURES:
        if all(map(IsBounded, Select(EXACT, controller=kind))):
            mine = [row for row in Select(LEAGUE, controller=kind) if row not in EXACT]
            lost_runs[kind] = sum(row["runs"] - row["bounded"] for row in mine)
    assert len(lost_runs) == 5
    assert [kind for kind, lost in lost_runs.items() if lost] == [
        "time_domain_passivity"
    ]


def test_what_the_readme_says_of_the_damper():
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    runs = [
        Select(EXACT, controller=kind, surgeon="switches", round_trip=0.2)
        for kind in ("damped_force", "adaptive_backstepping")
    ]
    for mine in runs:
        first, *others, last = (f"{row['settling_time']:.3g}" for row in mine)
        assert f"after {', '.join([first, *others])} and {last} s" in readme
    late = [a["contact_time"] - b["contact_time"] for a, b in zip(*runs, strict=True)]
    assert late == pytest.approx([1.0] * 3, abs=0.15)


def test_channel_example_is_valid():
    (text,) = Blocks("yaml")
    scenario = LoadScenario("one_dof", yaml.safe_load(text))
    assert scenario.forward_channel.receiver.policy == "playout"


@pytest.mark.parametrize("which", Slow([0, 1]))
def test_sample_period_study(which):
    """The change with packets that take 0.1 s, and with the mean delay held."""
    (cells,) = re.findall(r"^\| 50 ms \|(.*)\|$", TEXT, re.MULTILINE)
    study = LoadStudy("sample_period")
    plan = study.plans["one_dof"]

    def Metrics(channel):
        point = {"controller": CONTROLLERS[1], "channel": channel}
        run = simulate(plan.source.Load(PointOverrides(point)))
        metrics = FlattenMetrics(RunMetrics(run))
        return np.array([metrics[name] for name in study.metrics])

    channels = plan.axes["channel"]
    sampled = [x for x in channels if x.get("sample_period") == 0.05][which]
    change = 100 * (Metrics(sampled) / Metrics(channels[0]) - 1)
    shown = [float(x) for x in re.findall(r"[\d.]+", cells.split(" | ")[1])]
    assert shown[which] == pytest.approx(abs(change).max(), rel=0.02)


def test_figure_is_that_of_the_runs(tmp_path):
    """Pixel by pixel but for the rendering of fonts, which may differ."""
    committed = imread(ROOT / "diagrams" / "two_dof_combined.png")
    recordings = {kind: Run("two_dof_combined", kind) for kind in CONTROLLERS}
    SaveFigure(PlotComparison(recordings), tmp_path / "now.png")
    now = imread(tmp_path / "now.png")
    assert now.shape == committed.shape
    assert np.mean(np.abs(now - committed)) < 0.01


@pytest.mark.slow
def test_map_is_that_of_the_sweep(tmp_path, monkeypatch):
    """By the command that the page on stability names."""
    monkeypatch.chdir(tmp_path)
    (command,) = re.findall(r"`teleop-drake (sweep one_dof [^`]*--vary[^`]*)`", TEXT)
    assert main([*command.split(), "--metrics", "collision.time", "--quiet"]) == 0
    committed = imread(PAGES[0].parent / "stability_map.png")
    now = imread("out/stability.png")
    assert now.shape == committed.shape
    assert np.mean(np.abs(now - committed)) < 0.01
