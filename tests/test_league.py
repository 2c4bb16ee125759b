"""The league table: complete, what the runs give, and passive where it says so."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import league_table
import numpy as np
import pytest
from grids import Slow
from league_table import (
    ARCHITECTURES,
    CHANNELS,
    COLUMNS,
    DURATIONS,
    INTERVAL,
    KEYS,
    METRICS,
    NETWORK_ROUND_TRIPS,
    NUM_SEEDS,
    ROUND_TRIPS,
    SURGEONS,
    Configurations,
    HasBone,
    IsBounded,
    MakeTable,
    Markdown,
    Medians,
    MedianTable,
    Overrides,
    ReadTable,
    Select,
    Settles,
    Summary,
    WriteTable,
)
from runs import Run

from teleop_drake.analysis.energy import ChannelEnergyBalance
from teleop_drake.scenario import LoadScenario, ScenarioToYaml
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.sweep import FlattenMetrics
from teleop_drake.tasks.metrics import RunMetrics

TABLE = ReadTable()


def Key(row):
    return tuple(row[key] for key in KEYS)


def AssertSame(row, expected, columns=tuple(METRICS), rel=0.02):
    for column in columns:
        value, wanted = row[column], expected[column]
        if wanted is None:
            assert value is None, (Key(row), column)
        else:
            # An overshoot can be next to nothing.
            close = pytest.approx(wanted, rel=rel, abs=2e-5)
            assert value == close, (Key(row), column)


def test_every_cell_is_there():
    expected = [
        (*configuration, kind)
        for configuration in Configurations()
        for kind in ARCHITECTURES
    ]
    assert [Key(row) for row in TABLE] == expected
    assert {row["channel"] for row in TABLE} == set(CHANNELS)
    for task in DURATIONS:
        assert (LoadScenario(task).surgeon.contact_force is not None) == HasBone(task)
        for kind in ARCHITECTURES:
            mine = Select(TABLE, task=task, controller=kind)
            num_networks = (len(CHANNELS) - 1) * len(NETWORK_ROUND_TRIPS)
            num_surgeons = len(SURGEONS) if HasBone(task) else 1
            assert len(mine) == num_surgeons * (len(ROUND_TRIPS) + num_networks)


def test_rows_are_consistent():
    always = ("start_overshoot", "velocity_rms_error", "force_rms_error")
    always += ("control_peak", "control_variation")
    contact = ("contact_time", "first_impact", "peak_force", "rebound")
    for row in TABLE:
        assert row["status"] in ("completed", "diverged"), Key(row)
        assert IsBounded(row) == (row["diverged_at"] is None)
        assert all(row[name] is not None for name in always), Key(row)
        assert (row["age"] is None) == (row["channel"] == "exact")
        num_runs = 1 if row["channel"] == "exact" else NUM_SEEDS
        assert row["runs"] == num_runs >= row["bounded"] >= row["at_rest"], Key(row)
        assert IsBounded(row) == (row["bounded"] == num_runs)
        assert Settles(row) == (row["at_rest"] == num_runs)
        low, high = (row[column] for column in INTERVAL)
        assert low <= row["control_variation"] <= high, Key(row)
        has_contact = row["contact_time"] is not None
        assert has_contact or not (IsBounded(row) and HasBone(row["task"])), Key(row)
        assert all((row[name] is not None) == has_contact for name in contact)
        if Settles(row):
            assert IsBounded(row) and row["settling_time"] < DURATIONS[row["task"]]
        if has_contact:
            assert row["peak_force"] >= row["first_impact"] > 0
        has_stiffness = row["channel"] == "exact" and HasBone(row["task"])
        assert (row["felt_stiffness"] is not None) == has_stiffness


def test_without_delay_the_predictor_has_nothing_to_predict():
    """Then it is direct force, in every number."""
    rows = Select(TABLE, channel="exact", round_trip=0.0)
    for row in Select(rows, controller="smith_predictor"):
        (direct,) = Select(
            rows,
            controller="direct_force",
            **{key: row[key] for key in ("task", "surgeon")},
        )
        AssertSame(row, direct, rel=2e-3)


def test_until_the_contact_the_surgeons_are_the_same():
    for row in Select(TABLE, surgeon="switches"):
        case = {key: row[key] for key in KEYS} | {"surgeon": "never"}
        (other,) = Select(TABLE, **case)
        columns = ("start_overshoot", "puncture_overshoot", "contact_time")
        if IsBounded(row) or row["contact_time"] is not None:
            AssertSame(other, row, columns, rel=2e-3)


def test_all_have_the_same_surgeon_device_robot_and_limits():
    """A scenario's kind of controller is all that is different in a configuration."""
    for task in DURATIONS:
        for channel in ("exact", "both"):
            overrides = Overrides(task, "never", channel, 0.2)
            texts = set()
            for kind in ARCHITECTURES:
                scenario = LoadScenario(task, overrides | {"controller.kind": kind})
                scenario.controller.kind = "direct_force"
                texts.add(ScenarioToYaml(scenario))
            assert len(texts) == 1
            assert scenario.surgeon.contact_force is None
            given = LoadScenario(task)
            assert scenario.divergence_speed_ratio == given.divergence_speed_ratio
            for part in ("robot", "haptic_device", "environment"):
                assert repr(getattr(scenario, part)) == repr(getattr(given, part))


# Both tests in one process: what they share takes a minute.
in_one_process = pytest.mark.xdist_group("league")


@pytest.fixture(scope="module", params=Slow([1, 3]))
def quick(request, tmp_path_factory):
    """The first configurations that --quick runs, where and how, and the rows."""
    configurations = Configurations(is_quick=True)[: request.param]
    out = tmp_path_factory.mktemp("league")
    engine = "auto"
    with ThreadPoolExecutor(1) as executor:
        rows = MakeTable(configurations, out=out, executor=executor, engine=engine)
    return configurations, out, engine, rows


@in_one_process
def test_runs_give_the_rows(quick):
    configurations, _, _, rows = quick
    assert len(rows) == len(configurations) * len(ARCHITECTURES)
    if any(round_trip > 0 for *_, round_trip in configurations):
        assert {row["status"] for row in rows} == {"completed", "diverged"}
    for row in rows:
        (committed,) = Select(TABLE, **{key: row[key] for key in KEYS})
        assert row["status"] == committed["status"], Key(row)
        assert Settles(row) == Settles(committed), Key(row)
        AssertSame(row, committed, (*METRICS, "felt_stiffness"))


@in_one_process
def test_resuming_simulates_nothing_anew(quick, tmp_path):
    configurations, out, engine, rows = quick
    done = []
    again = MakeTable(
        configurations,
        out=out,
        resume=True,
        executor=None,
        engine=engine,
        progress=lambda finished, total: done.append((finished, total)),
    )
    assert again == rows
    # Each sweep reports once, that it has finished.
    sizes = [
        len(ARCHITECTURES) * (1 if channel == "exact" else NUM_SEEDS)
        for _, _, channel, _ in configurations
    ]
    assert done == [(end, sum(sizes)) for end in np.cumsum(sizes).tolist()]
    with (tmp_path / "table.csv").open("w", encoding="utf-8") as file:
        WriteTable(rows, file)
    read = ReadTable(tmp_path / "table.csv")
    assert [tuple(row) for row in read] == [COLUMNS] * len(rows)
    for row, expected in zip(read, rows, strict=True):
        AssertSame(row, expected, rel=1e-3)


@pytest.mark.parametrize("kind", ["adaptive_backstepping", "wave_variables"])
def test_the_tables_solver_is_accurate_enough(kind):
    """Rows against the scenario's own settings, up to when the tool has settled."""
    (row,) = Select(
        TABLE,
        task="two_dof_combined",
        surgeon="switches",
        channel="exact",
        round_trip=0.2,
        controller=kind,
    )
    run = Run("two_dof_combined", kind, engine="auto")
    metrics = FlattenMetrics(RunMetrics(run))
    columns = ("start_overshoot", "puncture_overshoot", "contact_time", "first_impact")
    columns += ("peak_force", "rebound", "settling_time")
    expected = {column: metrics[METRICS[column]] for column in columns}
    AssertSame(row, expected, columns, rel=2e-3)


@pytest.mark.parametrize("kind", ["wave_variables", "time_domain_passivity"])
def test_the_solver_of_networks_is_accurate_enough(kind):
    """A run by the table's settings against a far more accurate one, packet by packet.

    Time-domain passivity control chatters, and its control effort converges all the
    same.
    """
    case = ("two_dof_puncture", "never", "both", 0.2)
    overrides = Overrides(*case) | {"controller.kind": kind}
    ours, accurate = (
        FlattenMetrics(
            RunMetrics(simulate(LoadScenario(case[0], settings), engine="compiled"))
        )
        for settings in (overrides, overrides | {"simulator.accuracy": 1e-10})
    )
    columns = ("start_overshoot", "puncture_overshoot", "velocity_rms_error")
    columns += ("control_peak", "control_variation")
    run, expected = (
        dict.fromkeys(KEYS) | {column: metrics[METRICS[column]] for column in columns}
        for metrics in (ours, accurate)
    )
    AssertSame(run, expected, columns, rel=5e-4)
    # It is one of those in the table.
    (row,) = Select(TABLE, **dict(zip(KEYS, case, strict=False)), controller=kind)
    low, high = (row[column] for column in INTERVAL)
    assert low * 0.999 < run["control_variation"] < high * 1.001


def test_summary_is_markdown():
    text = Summary(TABLE)
    num_tables = 4 + 1 + len(ROUND_TRIPS) + 1
    assert text.count("\n| ---") == num_tables
    for kind in ARCHITECTURES:
        assert text.count(f"\n| {kind} |") == num_tables
    assert Markdown(MedianTable(TABLE, 0.2)) in text


def test_what_the_notebook_says():
    text = (Path(league_table.__file__).parent / "06_architectures.ipynb").read_text(
        encoding="utf-8"
    )
    medians = {trip: Medians(TABLE, trip) for trip in ROUND_TRIPS}

    def Said(kind, column, trip):
        return medians[trip][kind][column]

    start = [
        Said("adaptive_backstepping", "start overshoot", trip) for trip in (0.2, 1.0)
    ]
    assert "{:.0f} % at 0.2 s, and {:.0f} % at 1 s".format(*start) in text
    impacts = [Said("proportional_damping", "first impact", x) for x in ROUND_TRIPS[1:]]
    assert "0.6 throughout" in text and impacts == pytest.approx([0.6] * 4, rel=0.02)
    late = [Said("proportional_damping", "contact at", trip) for trip in (0.2, 1.0)]
    assert late == pytest.approx([1.6, 2.0], rel=0.03)
    late = [Said("wave_variables", "contact at", trip) for trip in ROUND_TRIPS]
    assert (min(late), max(late)) == pytest.approx((1.2, 1.3), rel=0.02)
    for column in ("first impact", "settles after"):
        for trip in (0.1, 0.2, 0.5):
            ours, theirs = (
                Said(kind, column, trip)
                for kind in ("wave_variables", "adaptive_backstepping")
            )
            assert ours == pytest.approx(theirs, rel=0.2)
    # At 1 s the adaptive controller hits hardest of those that are bounded.
    hardest = max(
        (row["first impact"] or 0, kind) for kind, row in medians[1.0].items()
    )
    assert hardest[1] == "adaptive_backstepping"
    late = [Said("damped_force", "contact at", trip) for trip in ROUND_TRIPS]
    assert (min(late), max(late)) == pytest.approx((1.3, 1.4), rel=0.03)
    # Who comes to rest in every run up to 0.5 s and lets the bone be felt.
    for trip in (0.1, 0.2, 0.5):
        mine = Select(TABLE, channel="exact", round_trip=trip)
        for kind in ARCHITECTURES:
            bones = [x for x in Select(mine, controller=kind) if HasBone(x["task"])]
            is_both = all(map(Settles, bones)) and bones[0]["felt_stiffness"] > 100
            assert is_both == (
                kind in ("adaptive_backstepping", "damped_force")
                or (kind == "four_channel" and trip == 0.1)
            )


def StandardError(rows, column):
    """Returns that of the number of cases, each of which counts by a share of runs."""
    rows = [row for row in rows if column == "bounded" or HasBone(row["task"])]
    shares = np.array([row[column] / row["runs"] for row in rows])
    return np.sqrt((shares * (1 - shares)).sum() / (NUM_SEEDS - 1))


def test_what_the_notebook_says_of_networks():
    text = (Path(league_table.__file__).parent / "06_architectures.ipynb").read_text(
        encoding="utf-8"
    )
    networks = [row for row in TABLE if row["channel"] != "exact"]
    mine = {kind: Select(networks, controller=kind) for kind in ARCHITECTURES}
    runs = {kind: sum(row["runs"] for row in rows) for kind, rows in mine.items()}
    lost = {
        kind: runs[kind] - sum(row["bounded"] for row in rows)
        for kind, rows in mine.items()
    }
    assert set(runs.values()) == {1680} and "none of the 1680 runs each" in text
    for kind in (
        "damped_force",
        "wave_variables",
        "proportional_damping",
        "four_channel",
    ):
        assert lost[kind] == 0
    assert lost["time_domain_passivity"] == 11
    assert "Of time-domain passivity 11 do" in text
    for row in mine["time_domain_passivity"]:
        assert IsBounded(row) or (
            row["surgeon"] == "never"
            and row["channel"] != "jitter"
            and row["round_trip"] in (0.1, 0.5)
        )
    spread = {
        kind: np.median(
            [
                (row[INTERVAL[1]] - row[INTERVAL[0]]) / row["control_variation"]
                for row in rows
                if IsBounded(row)
            ]
        )
        for kind, rows in mine.items()
    }
    passivity = spread.pop("time_domain_passivity")
    assert "are 2 to 9 % in most cases" in text
    assert min(spread.values()) > 0.02 and max(spread.values()) < 0.095
    assert f"with time-domain passivity {100 * passivity:.0f} %" in text
    errors = [
        StandardError(Select(mine[kind], channel=channel), column)
        for kind in ARCHITECTURES
        for channel in CHANNELS[1:]
        for column in ("bounded", "at_rest")
    ]
    assert f"standard errors of at most {max(errors):.2f} cases" in text


# Passivity over networks, for any of which neither was designed.


def Energy(recording):
    """What went into the channel and did not come out, at each sample, per axis (J)."""
    time = recording.time
    power = recording["master_power"] - recording["slave_power"]
    steps = np.diff(time)[:, None] * (power[1:] + power[:-1]) / 2
    return np.vstack([np.zeros(power.shape[1]), np.cumsum(steps, axis=0)])


def OverNetwork(kind, channel, round_trip):
    """Through tissue into free space, and a stop: nothing is left to be stored."""
    overrides = Overrides("two_dof_puncture", "never", channel, round_trip)
    overrides |= {"controller.kind": kind, "surgeon.stop_time": 3.0, "duration": 5.0}
    return simulate(LoadScenario("two_dof_puncture", overrides), engine="auto")


@pytest.mark.parametrize(
    ("channel", "round_trip"), Slow([("loss", 0.2), ("both", 1.0)])
)
def test_waves_stay_passive_over_networks(channel, round_trip):
    recording = OverNetwork("wave_variables", channel, round_trip)
    energy = Energy(recording).sum(axis=1)
    assert energy.max() > 0
    assert energy.min() > -1e-6 * energy.max()


@pytest.mark.slow  # test_the_channel_is_passive() has a network.
@pytest.mark.parametrize(
    ("channel", "round_trip"), Slow([("loss", 0.2), ("both", 1.0)])
)
def test_time_domain_passivity_holds_over_networks(channel, round_trip):
    """No axis gives more than E_0, but for what the largest mobility lets through."""
    recording = OverNetwork("time_domain_passivity", channel, round_trip)
    E_0 = ResolveController(recording.scenario).initial_energy
    assert recording["injected_mobility"].max() > 0
    assert Energy(recording).min() > -1.35 * E_0
    assert recording["slave_budget"].min() > -0.01 * E_0
    assert recording["master_budget"].min() > -0.35 * E_0


@pytest.mark.slow  # As test_the_raw_delay_is_not_passive().
def test_the_same_network_is_not_passive_by_itself():
    recording = OverNetwork("direct_force", "both", 0.2)
    E_0 = ResolveController(
        LoadScenario("two_dof_puncture", ["controller.kind=time_domain_passivity"])
    ).initial_energy
    assert ChannelEnergyBalance(recording).violation[-1] > 2 * E_0
