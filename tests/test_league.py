"""The league of architectures: its search, runs, statistics, tables and sentences."""

import json
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from documentation import ROOT, CheckPicture
from grids import Slow
from league import compete, page, passive, search, traces
from league.__main__ import BUDGET
from league.claims import CHANGES, CLAIMS, Claim, FindRow
from league.compete import Compete
from league.entries import OneAxis, ReadEntries
from league.felt import BAND, BONES, FeltRow, TwoPort
from league.figures import Draw, DrawFelt, FeltRows
from league.laws import linear_core
from league.runs import CommandedTime, FreeImpact, Runs
from league.search import (
    CORNER_BOX,
    WORST,
    FindFront,
    Hypervolume,
    Members,
    Search,
    Terms,
    Trial,
    TryGains,
)
from league.statistics import (
    BASELINE,
    Difference,
    GroupOf,
    Median,
    ReadTable,
    Share,
    ShareBelow,
    StatisticsRows,
)

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioToYaml
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.transparency import FeltStiffness
from teleop_drake.study.figures.runs import SaveFigure

ENTRIES = ReadEntries()
DOCS = ROOT / "teleop_drake/docs"
TABLES = ("league", "league_runs", "league_felt")


@pytest.mark.parametrize("name", ENTRIES)
def test_an_entry_is_a_scenario_with_its_gains(name, subtests):
    entry = ENTRIES[name]
    gains = entry.GainsAt(np.full(len(entry.gains), 0.5))
    scenario = OneAxis(entry, gains, 0.1)
    for path, value in gains.items():
        with subtests.test(path=path):
            low, high = entry.gains[path]
            assert value == pytest.approx(np.sqrt(low * high), rel=1e-3)
            assert scenario.Value(path) == value


def test_the_linear_core_contains_the_damper_against_the_command():
    F_h, v_d, p, v, F_e = np.random.default_rng(0).normal(size=(5, 2))
    expected = F_h - 2.0 * (v - v_d)
    assert linear_core(F_h, v_d, p, v, F_e) == pytest.approx(expected)
    # And z = 0, W1 = 0 in (4.23) with B = Psi^-1 G1.
    s = (v - v_d) + 0.3 * (F_e - F_h)
    found = linear_core(F_h, v_d, p, v, F_e, B=4.0 / 5.0, Lambda=0.3)
    assert found == pytest.approx(F_e - 4.0 / 5.0 * s)


@pytest.mark.slow
def test_no_two_runs_are_alike():
    held_out, training = (
        [
            ScenarioToYaml(plan.Load(point))
            for plan in Runs(study, ENTRIES[BASELINE]).plans.values()
            for point in plan.points
        ]
        for study in ("league_held_out", "league")
    )
    assert len(set(held_out)) == len(held_out) == 106
    assert len(set(training)) == 7
    assert not set(training) & set(held_out)


@pytest.mark.slow
def test_the_outcome_of_a_run_has_its_metrics():
    entry = ENTRIES[BASELINE]
    runs = Runs("league", entry)
    found = runs.SimulateOne("two_dof_collision", 0, {})
    overrides = [*entry.overrides, "delay=0.05", "simulator.accuracy=1e-7"]
    scenario = LoadScenario("two_dof_collision", overrides)
    collision = RunMetrics(simulate(scenario))["collision"]
    # 0.15 m with 0.1 m/s.
    assert CommandedTime(scenario) == pytest.approx(1.5)
    assert found.arrival == pytest.approx(collision["time"] / 1.5)
    assert found.late == pytest.approx(collision["time"] - 1.5)
    assert found.rest == pytest.approx(collision["rest_time"])
    force = collision["peak_force"] / FreeImpact(scenario)
    assert found.impact == pytest.approx(force)


def test_the_impact_of_a_free_mass():
    """By the law of energy, m v^2/2 = k d^2/2 or 2/5 k d^(5/2), with F = k d^p."""
    scenario = LoadScenario("one_dof")
    assert FreeImpact(scenario) == pytest.approx(1e-3 * np.sqrt(150 * 0.5))
    wall = "environment={kind: hunt_crossley, start: 0.015, stiffness: 20000}"
    force = FreeImpact(LoadScenario("one_dof", [wall]))
    depth = (force / 20000) ** (1 / 1.5)
    assert 0.4 * 20000 * depth**2.5 == pytest.approx(0.5 * 0.5 * 1e-6)


@pytest.mark.slow
def test_a_rest_counts_from_the_stop():
    """An operator who never switches to force pushes on until the stop."""
    runs = Runs("league_held_out", ENTRIES[BASELINE])
    found = runs.SimulateOne("two_dof_collision-hold", 1, {})
    scenario = LoadScenario(
        "two_dof_collision",
        [
            *ENTRIES[BASELINE].overrides,
            *("surgeon.contact_force=null", "surgeon.stop_time=3", "duration=12"),
            "simulator.accuracy=1e-7",
        ],
    )
    collision = RunMetrics(simulate(scenario))["collision"]
    at_rest = collision["time"] + collision["rest_time"]
    assert found.rest == pytest.approx(at_rest - 3.1)
    assert 0 < found.rest < collision["rest_time"] - 1


@pytest.mark.slow
def test_what_never_rests_costs_the_most():
    entry = ENTRIES["direct force"]
    trial = TryGains(entry, Runs("league", entry), {})
    assert trial.terms.rest == trial.terms.loss == WORST
    assert trial.cost == pytest.approx(sum(trial.terms))


def test_a_search_is_repeatable_and_keeps_its_budget(monkeypatch):
    """With a cost that is known: gains of 2 and 0.3 are the best."""

    def Try(entry, runs, gains):
        logs = np.log([*gains.values()] or [1.0, 1.0])
        miss = float(np.sum((logs[:2] - np.log([2.0, 0.3])) ** 2))
        return Trial(gains, Terms(miss, 0.0, 1.0, 1.0))

    monkeypatch.setattr(search, "TryGains", Try)
    entry = ENTRIES["linear core"]
    trials = Search(entry, None, 32, 1)
    assert trials == Search(entry, None, 32, 1)
    assert 60 < len(trials) <= 65
    trials[0] = Trial({}, Terms(10.0, 0.0, 2.0, 1.0))  # Those by rule.
    members = Members(trials)
    assert members["rule"].gains == {}
    best = members["compromise"]
    assert best.cost == min(trial.cost for trial in trials)
    assert [*best.gains.values()] == pytest.approx([2.0, 0.3], rel=0.6)
    # Evolution comes closer than the sequence that covers the ranges.
    assert best.cost < min(trial.cost for trial in trials[:33])
    # A few sets are tried without evolution, and nothing where there is no gain.
    assert len(Search(entry, None, 4, 1)) == 5
    assert len(Search(ENTRIES["direct force"], None, 32, 1)) == 1


def test_fronts_and_their_volume():
    """A single trial dominates the product of what is left along each edge."""
    shares = np.array([0.5, 0.25, 0.5, 0.75])
    trial = Trial({}, Terms(*(shares * CORNER_BOX)))
    worse = Trial({}, trial.terms._replace(rest=9.0))
    other = Trial({}, trial.terms._replace(rest=1.0, loss=1.4))
    assert FindFront([trial, worse, other]) == [trial, other]
    assert Hypervolume([trial]) == pytest.approx(np.prod(1 - shares), abs=2e-3)
    assert Hypervolume([trial, worse]) == Hypervolume([trial])
    assert Hypervolume([trial, other]) > Hypervolume([trial])


@pytest.mark.parametrize("name", Slow(["waves", "adaptive", "linear core"]))
def test_the_felt_stiffness_is_that_of_the_analysis(name):
    """On each bone, although the two-port is computed once, at the bone of 150 N/m.

    The slopes of the adaptive law depend on the depth at rest a little.
    """
    close = 1e-5 if name == "adaptive" else 1e-9
    port = TwoPort(ENTRIES[name], {}, 0.1)
    for bone in BONES:
        key = "environment.layers.bone.stiffness"
        scenario = OneAxis(ENTRIES[name], {key: bone}, 0.1)
        felt = FeltStiffness(scenario, OperatingPoints(scenario)[-1], BAND)
        found = port.StiffnessLoss(BAND, 0.1, bone)
        assert found == pytest.approx(np.abs(1 - felt / bone), rel=close)


def test_what_direct_force_lets_feel():
    """Nearly k cos(w T) of a bone k; on a rigid wall the hand does not move at all."""
    row = FeltRow(ENTRIES["direct force"], "compromise", {})
    assert row["loss_at_1"] == pytest.approx(1 - np.cos(0.2), abs=5e-3)
    assert row["z_width"] > 3
    assert row["llewellyn"] < 1
    idle = FeltRow(ENTRIES["passivity + damper"], "compromise", {})
    assert np.isnan(idle["llewellyn"])


def test_medians_and_shares_of_times_that_may_be_infinite():
    never = np.inf
    rest = np.array([[1.0, 2.0, 3.0, never, never]])
    assert Median(rest).value == 3.0
    assert Median(np.array([[1.0, never, never]])).value == never
    assert Share(np.isfinite(rest)).value == pytest.approx(0.6)
    same = Difference(rest, rest)
    assert same == (0.0, 0.0, 0.0)
    other = rest + 0.5
    assert Difference(rest, other).value == -0.5
    assert ShareBelow(rest, other).value == pytest.approx(0.8)
    assert ShareBelow(other, rest).value == pytest.approx(0.2)


def test_the_interval_of_a_median_covers_it():
    """In 95 of 100 samples of 60 runs, give or take what 100 draws scatter."""
    rng = np.random.default_rng(1)
    intervals = [Median(rng.exponential(size=(1, 60))) for _ in range(100)]
    covered = sum(low <= np.log(2) <= high for _, low, high in intervals)
    assert 88 <= covered <= 100


def test_groups_of_runs():
    runs = {row["run"] for row in ReadTable("league_runs")}
    assert {GroupOf(run) for run in runs} == {
        *("delay", "bone", "task", "operator", "hold", "hardware", "mass", "wrong"),
        "network",
    }
    assert sum(GroupOf(run) == "network" for run in runs) == 22


def test_the_trace_of_the_satellite_is_what_is_made():
    assert traces.FILE.read_text("utf-8") == traces.MakeTrace()


@pytest.mark.parametrize(
    "names", Slow([[BASELINE, "waves"], [*ENTRIES]], but=[0]), ids=len
)
def test_the_tables_belong_together(names):
    runs = ReadTable("league_runs")
    rows = StatisticsRows([row for row in runs if row["architecture"] in names])
    kept = [
        row
        for row in ReadTable()
        if row["member"] == "compromise" and row["architecture"] in names
    ]
    assert len(rows) == len(kept) == 10 * len(names)
    for row, other in zip(rows, kept, strict=True):
        assert row == pytest.approx(other, nan_ok=True)


def test_the_tables_have_every_entry():
    architectures = dict.fromkeys(row["architecture"] for row in ReadTable())
    assert [*architectures] == [*ENTRIES]
    for row in ReadTable("league_search"):
        entry = ENTRIES[row["architecture"]]
        assert row["sets"] <= BUDGET * len(entry.gains)
        assert row["at_edge"] == entry.Edges(json.loads(row["gains"]))


def test_gains_at_an_edge_are_marked():
    entry = ENTRIES["linear core"]
    B, Lambda = entry.gains
    assert entry.Edges({B: 49.0, Lambda: 0.3}) == "B high"
    assert entry.Edges({B: 0.1, Lambda: 2.99}) == "B low, Lambda high"
    assert entry.Widened(2.0).Edges({B: 49.0, Lambda: 0.3}) == ""


def test_one_reach_for_everybody():
    """B = Psi^-1 G1 of the adaptive law reaches as far as that of its core."""
    psi = 1 / ResolveController(LoadScenario("one_dof")).Psi0[0, 0]
    _, largest = ENTRIES["adaptive"].gains["controller.G1"]
    _, own = ENTRIES["linear core"].gains["controller.parameters.B"]
    assert psi * largest == pytest.approx(own, rel=0.1)
    for name, entry in ENTRIES.items():
        for path, (_, high) in entry.gains.items():
            if path.endswith(("damping", "impedance")):
                assert high == 50, name


def test_the_pages_have_the_tables_and_the_sentences():
    parts = page.Parts(page.PAGE.read_text("utf-8"))
    assert [*parts] == ["sentences", "table", "edges"]
    assert parts == {name: page.Section(name) for name in parts}
    assert page.TABLE.read_text("utf-8") == page.AllRows()
    assert passive.Table() in (DOCS / "passive_and_quick.md").read_text("utf-8")


def test_the_table_of_the_page_is_short():
    rows = page.ShortRows()
    assert len(rows) == 12
    names = {row[0].rstrip("*") for row in rows}
    assert names | {*page.LEFT_OUT} == {*ENTRIES}
    assert {len(row) for row in rows} == {len(page.SHORT)} == {7}
    shares = {
        row["architecture"]: f"{row['at_rest']:.1%}".replace("%", " %")
        for row in ReadTable()
        if (row["member"], row["runs"]) == ("compromise", "all")
    }
    assert all(row[1] == shares[row[0].rstrip("*")] for row in rows)
    marked = {row[0][:-1] for row in rows if row[0].endswith("*")}
    assert marked == {*page.AtEdge()} - {*page.LEFT_OUT}
    assert {len(row) for row in page.TableRows()} == {len(page.HEADER)}


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.text[:40])
def test_a_sentence_is_right_and_the_plainest_changes_do_not_refute_it(claim, subtests):
    assert claim.holds(claim.Rows())
    for change in CHANGES:
        if change != claim.topic:
            with subtests.test(change=change):
                assert claim.holds(claim.Rows(change))


@pytest.mark.parametrize(
    ("rows", "holds", "change"),
    [
        # Sentences of edition 2.
        (
            {"waves": ("waves to ground", "compromise", "all")},
            lambda r: r.waves.arrival > 1.2,
            "the same damper",
        ),
        (
            {"smith": ("Smith + damper", "compromise")},
            lambda r: r.smith.loss_in_band < 0.3,
            "other bones",
        ),
    ],
    ids=["waves arrive late", "Smith is transparent"],
)
def test_what_a_change_refutes(rows, holds, change):
    claim = Claim("", rows, holds)
    assert claim.holds(claim.Rows())
    assert not claim.holds(claim.Rows(change))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "title", "number"),
    Slow(
        [
            (BASELINE, "two_dof_collision-hold", 1),
            ("linear core", "two_dof_combined-lte-network", 3),
            ("adaptive", "two_dof_collision-mass-wrong", 1),
            ("waves", "one_dof-hunt_crossley-bone", 0),
            ("PD at the slave", "two_dof_combined-delay", 2),
        ],
        but=[0],
    ),
)
def test_the_rows_are_those_of_the_runs(name, title, number, subtests):
    (gains,) = (
        json.loads(row["gains"])
        for row in ReadTable("league_search")
        if (row["architecture"], row["seed"]) == (name, 0)
    )
    found = Runs("league_held_out", ENTRIES[name]).SimulateOne(title, number, gains)
    (row,) = (
        row
        for row in ReadTable("league_runs")
        if (row["architecture"], row["member"], row["run"])
        == (name, "compromise", f"{title}-{number}")
    )
    for field in ("rest", "arrival", "impact"):
        with subtests.test(field=field):
            kept = float(str(row[field]).split()[0])
            assert getattr(found, field) == pytest.approx(kept, rel=2e-3)


def test_the_table_of_felt_stiffness():
    text = page.PAGE.read_text(encoding="utf-8")
    for cells in FeltRows():
        assert "\n| " + " | ".join(cells) + " |\n" in text


@pytest.mark.parametrize(
    ("file", "draw"),
    Slow(
        [
            ("league.png", lambda: Draw(*map(ReadTable, TABLES))),
            ("felt_stiffness.png", DrawFelt),
        ],
        but=[],
    ),
)
def test_the_figures(file, draw, tmp_path):
    SaveFigure(draw(), tmp_path / "now.png")
    CheckPicture(DOCS / file, tmp_path / "now.png")


@pytest.mark.slow
def test_a_search_is_done_once(tmp_path, monkeypatch):
    """With three held-out runs; an entry below has all of them."""

    def FewRuns(study, entry):
        runs = Runs(study, entry)
        title = {"league": "one_dof", "league_held_out": "one_dof-delay"}[study]
        runs.plans = {title: runs.plans[title]}
        return runs

    monkeypatch.setattr(compete, "Runs", FewRuns)
    file = tmp_path / "damper.json"
    Compete(ENTRIES[BASELINE], 4, {0: file})
    result = json.loads(file.read_text("utf-8"))
    assert [*result["members"]] == ["rule", "compromise", "twice the range"]
    for member in result["members"].values():
        assert [*member["runs"]] == [f"one_dof-delay-{number}" for number in range(3)]
    file.write_text("kept")
    Compete(ENTRIES[BASELINE], 4, {0: file})
    assert file.read_text() == "kept"


@pytest.mark.slow
def test_an_architecture_is_entered(tmp_path):
    """By a file of one's own, as the README says; an entry without gains is quick."""
    (tmp_path / "mine.py").write_text(
        "def push(haptic_force, velocity_command, tool_position, tool_velocity,\n"
        "         environment_force):\n"
        "    return haptic_force - 3.0 * (tool_velocity - velocity_command)\n"
    )
    (tmp_path / "mine.yaml").write_text(
        'my law:\n  set: {controller.kind: "mine:push"}\n  gains: {}\n  passive: "no"\n'
    )
    options = ["--enter", "mine.yaml", "--only", "my law", "--jobs", "1"]
    command = [sys.executable, "-m", "league", "out", *options]
    path = f"{ROOT}:{ROOT / 'notebooks'}:{tmp_path}"
    subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": path}, check=True)
    rows = ReadTable("league", tmp_path / "out")
    assert {row["architecture"] for row in rows} == {"my law"}
    (row,) = (row for row in rows if row["runs"] == "all")
    assert row["count"] == 106
    assert row["at_rest"] > 0.9


def test_the_readme_explains_the_columns(subtests):
    text = (ROOT / "notebooks/league/README.md").read_text("utf-8")
    told = set(re.findall(r"`(\w+)`", text))
    told |= {"architecture", "seed", "run", "gains", "passive_by_design"}
    for name in ("league", "league_runs", "league_search", "league_felt"):
        with subtests.test(name=name):
            columns = {
                re.sub("_(low|high)$", "", column) for column in ReadTable(name)[0]
            }
            assert columns <= told


def test_the_edition_is_cited():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    heading = (ROOT / "notebooks/league/README.md").read_text("utf-8").splitlines()[0]
    assert heading == "# The league of architectures, edition 3"
    assert "edition 3" in citation["abstract"]


def CoreGains():
    """Returns B in N s/m and Lambda in m/(N s) of the linear core's first search."""
    rows = ReadTable("league_search")
    (row,) = (x for x in rows if (x["architecture"], x["seed"]) == ("linear core", 0))
    gains = json.loads(row["gains"])
    return gains["controller.parameters.B"], gains["controller.parameters.Lambda"]


@pytest.mark.parametrize(("share", "rests"), [(0.9, True), (1.1, False)])
def test_the_linear_core_needs_a_fast_drive(share, rests):
    """Stable on a bone k only if the drive has a > k (Lambda - 1/B), as the page says.

    The tool obeys m s^2 x = F - k x, and the drive (s/a + 1) F = k x - B s x - B Lambda
    k x, which is m s^3 + m a s^2 + (k + a B) s + a B Lambda k = 0.
    """
    B, Lambda = CoreGains()
    a = 100.0
    k = share * a / (Lambda - 1 / B)
    roots = np.roots([0.5, 0.5 * a, k + a * B, a * B * Lambda * k])
    assert (roots.real.max() < 0) == rests
    numbers = {
        "controller.parameters.B": B,
        "controller.parameters.Lambda": Lambda,
        "actuator.bandwidth": a,
        "environment.layers.bone.stiffness": k,
    }
    settings = ENTRIES["linear core"].settings
    scenario = LoadScenario("one_dof", {**settings, **numbers})
    found = RunMetrics(simulate(scenario))["collision"]["rest_time"]
    assert (found is not None) == rests


def test_the_lag_of_the_law_is_most_of_its_damping():
    """The linear core with the thesis's gains, as the page on the law reports."""
    law = ResolveController(LoadScenario("one_dof"))
    core = {
        "controller.parameters.B": float(law.G1[0, 0] / law.Psi0[0, 0]),
        "controller.parameters.Lambda": float(law.Lambda[0, 0]),
        "simulator.accuracy": 1e-9,
        "duration": 60,
    }
    settings = ENTRIES["linear core"].settings
    run = simulate(LoadScenario("one_dof", {**settings, **core}))
    rest = RunMetrics(run)["collision"]["rest_time"]
    text = " ".join((DOCS / "why_adaptive.md").read_text("utf-8").split())
    assert f"the tool rests after {rest:.2f} s, with it after 1.59 s" in text


def test_the_page_tells_the_number_of_searches():
    counts = dict.fromkeys(ENTRIES, 0)
    for row in ReadTable("league_search"):
        counts[row["architecture"]] += 1
    for name, entry in ENTRIES.items():
        assert counts[name] == (5 if entry.gains else 1), name
    text = " ".join(page.PAGE.read_text("utf-8").split())
    assert "There are five searches for each architecture." in text


def test_the_page_tells_the_bounds_of_the_drive():
    B, Lambda = CoreGains()
    bounds = [k * (Lambda - 1 / B) for k in (150, 300)]
    text = " ".join(page.PAGE.read_text("utf-8").split())
    told = "{:.0f} rad/s on a bone of 150 N/m and {:.0f} rad/s on one of 300 N/m"
    assert told.format(*bounds) in text


def test_the_readme_tells_of_the_league():
    command, adaptive, rule, direct, waves = (
        SimpleNamespace(**FindRow((name, member, "all")))
        for name, member in (
            (BASELINE, "compromise"),
            ("adaptive", "compromise"),
            ("adaptive", "rule"),
            ("direct force", "compromise"),
            ("waves", "compromise"),
        )
    )
    told = (
        f"Over {command.count:.0f} runs that no search for gains has seen",
        f"on the bone in {command.at_rest:.0%} of them, after {command.rest:.2f} s in",
        f"in {adaptive.at_rest:.0%}, after {adaptive.rest:.2f} s, and",
        f"{rule.rest:.2f} s with the thesis's gains; direct force rests in",
        f"rests in {direct.at_rest:.0%}.",
        f"rest in {waves.at_rest:.0%}, after {waves.rest:.2f} s",
    )
    text = " ".join((ROOT / "README.md").read_text("utf-8").split())
    for sentence in told:
        assert sentence.replace("%", " %") in text
