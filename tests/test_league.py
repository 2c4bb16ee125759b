"""The league: its table is complete and what its study gives."""

from dataclasses import replace

import pytest
from energies import ChannelEnergy
from grids import Slow
from league_table import (
    ARCHITECTURES,
    CHANNELS,
    INTERVAL,
    KEYS,
    METRICS,
    ROUND_TRIPS,
    TASKS,
    HasBone,
    IsBounded,
    MakeRows,
    ReadTable,
    Select,
    Settles,
)
from runs import Run

from teleop_drake.analysis.energy import ChannelEnergyBalance
from teleop_drake.scenario import LoadScenario, ScenarioToYaml
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.sweep import FlattenMetrics, RunSweep
from teleop_drake.sweep.plan import PointOverrides
from teleop_drake.sweep.study import LoadStudy
from teleop_drake.tasks.metrics import RunMetrics

TABLE = ReadTable()
NUM_SEEDS = 20

# They share the study, which takes a second to load.
pytestmark = pytest.mark.xdist_group("league")


@pytest.fixture(scope="module")
def plans():
    return LoadStudy("league").plans


def Key(row):
    return tuple(row[key] for key in KEYS)


def Overrides(plan, kind, channel="exact", round_trip=0.2):
    """Returns the overrides of the first run of a row."""
    for point in plan.points:
        given = point.get("channel", {})
        names = [name for name in ("jitter", "loss") if name in given]
        is_it = {"exact": [], "both": ["jitter", "loss"]}.get(channel, [channel])
        delay = given.get("delay", point.get("delay"))
        if point["controller"] == kind and names == is_it and 2 * delay == round_trip:
            return [*plan.overrides, *PointOverrides(point)]
    raise AssertionError("no such row")


def AssertSame(row, expected, columns=tuple(METRICS), rel=0.02):
    for column in columns:
        value, wanted = row[column], expected[column]
        if wanted is None:
            assert value is None, (Key(row), column)
        else:
            # An overshoot can be next to nothing.
            close = pytest.approx(wanted, rel=rel, abs=2e-5)
            assert value == close, (Key(row), column)


def test_every_cell_is_there(plans):
    assert [Key(row) for row in TABLE] == [
        (task, surgeon, channel, trip, kind)
        for task in TASKS
        for surgeon in (("switches", "never") if HasBone(task) else ("never",))
        for channel in CHANNELS
        for trip in (ROUND_TRIPS if channel == "exact" else ROUND_TRIPS[1:])
        for kind in ARCHITECTURES
    ]
    assert sum(len(plan.points) for plan in plans.values()) == sum(
        row["runs"] for row in TABLE
    )
    for name, plan in plans.items():
        task, surgeon, _ = name.split("-")
        assert plan.scenario.name == task
        assert (plan.scenario.surgeon.contact_force is None) == (surgeon == "never")


def test_rows_are_consistent():
    contact = ("contact_time", "first_impact", "peak_force", "rebound")
    for row in TABLE:
        assert row["status"] in ("completed", "diverged"), Key(row)
        assert IsBounded(row) == (row["diverged_at"] is None)
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
        if has_contact:
            assert row["peak_force"] >= row["first_impact"] > 0
        has_stiffness = row["channel"] == "exact" and HasBone(row["task"])
        assert (row["felt_stiffness"] is not None) == has_stiffness


def test_without_delay_the_predictor_has_nothing_to_predict():
    """Then it is direct force, in every number."""
    rows = Select(TABLE, channel="exact", round_trip=0.0)
    for row in Select(rows, controller="smith_predictor"):
        case = {key: row[key] for key in ("task", "surgeon")}
        (direct,) = Select(rows, controller="direct_force", **case)
        AssertSame(row, direct, rel=2e-3)


def test_until_the_contact_the_surgeons_are_the_same():
    for row in Select(TABLE, surgeon="switches"):
        case = {key: row[key] for key in KEYS} | {"surgeon": "never"}
        (other,) = Select(TABLE, **case)
        columns = ("start_overshoot", "puncture_overshoot", "contact_time")
        if IsBounded(row) or row["contact_time"] is not None:
            AssertSame(other, row, columns, rel=2e-3)


def test_all_have_the_same_surgeon_device_robot_and_limits(plans):
    """A scenario's kind of controller is all that is different in a configuration."""
    for name in ("one_dof-never-networks", "two_dof_combined-never-networks"):
        given, texts = LoadScenario(name.split("-")[0]), set()
        for kind in ARCHITECTURES:
            overrides = Overrides(plans[name], kind, "both")
            scenario = LoadScenario(given.name, overrides)
            scenario.controller.kind = "direct_force"
            texts.add(ScenarioToYaml(scenario))
        assert len(texts) == 1
        assert scenario.divergence_speed_ratio == given.divergence_speed_ratio
        for part in ("robot", "haptic_device", "environment"):
            assert repr(getattr(scenario, part)) == repr(getattr(given, part))


@pytest.mark.parametrize(
    ("name", "is_chosen"),
    Slow(
        [
            ("two_dof_puncture-never-exact", {"delay": 0}),
            ("two_dof_puncture-never-networks", {"delay": 0.5, "loss": True}),
            ("two_dof_collision-switches-exact", {"delay": 0.25}),
        ]
    ),
)
def test_runs_give_the_rows(name, is_chosen, plans, in_this_process):
    def IsChosen(point):
        given = point.get("channel", point)
        has_loss = "loss" in given and "jitter" in given
        return given["delay"] == is_chosen["delay"] and has_loss == (
            "loss" in is_chosen
        )

    points = list(filter(IsChosen, plans[name].points))
    plan = replace(plans[name], points=points)
    rows = MakeRows(name, plan, RunSweep(plan))
    assert len(rows) == len(ARCHITECTURES)
    for row in rows:
        (committed,) = Select(TABLE, **{key: row[key] for key in KEYS})
        assert list(row) == list(committed)
        assert row["status"] == committed["status"], Key(row)
        assert Settles(row) == Settles(committed), Key(row)
        AssertSame(row, committed, (*METRICS, *INTERVAL, "felt_stiffness"))


@pytest.mark.parametrize("kind", ["adaptive_backstepping", "wave_variables"])
def test_the_tables_solver_is_accurate_enough(kind):
    """Rows against the scenario's own settings, up to when the tool has settled."""
    case = {"task": "two_dof_combined", "surgeon": "switches", "channel": "exact"}
    (row,) = Select(TABLE, **case, round_trip=0.2, controller=kind)
    metrics = FlattenMetrics(RunMetrics(Run("two_dof_combined", kind, engine="auto")))
    columns = ("start_overshoot", "puncture_overshoot", "contact_time", "first_impact")
    columns += ("peak_force", "rebound", "settling_time")
    expected = {column: metrics[METRICS[column]] for column in columns}
    AssertSame(row, expected, columns, rel=2e-3)


@pytest.mark.slow  # A tighter run of a network takes as long as it does.
@pytest.mark.parametrize("kind", ["time_domain_passivity", "wave_variables"])
def test_the_solver_of_networks_is_accurate_enough(kind, plans):
    """A run by the table's settings against a far more accurate one, packet by packet.

    Time-domain passivity control chatters, and its control effort converges all the
    same.
    """
    overrides = Overrides(plans["two_dof_puncture-never-networks"], kind, "both")
    ours, accurate = (
        FlattenMetrics(
            RunMetrics(
                simulate(LoadScenario("two_dof_puncture", settings), engine="compiled")
            )
        )
        for settings in (overrides, [*overrides, "simulator.accuracy=1e-10"])
    )
    columns = ("start_overshoot", "puncture_overshoot", "velocity_rms_error")
    columns += ("control_peak", "control_variation")
    run, expected = (
        dict.fromkeys(KEYS) | {column: metrics[METRICS[column]] for column in columns}
        for metrics in (ours, accurate)
    )
    AssertSame(run, expected, columns, rel=5e-4)
    # It is one of those in the table.
    case = ("two_dof_puncture", "never", "both", 0.2, kind)
    (row,) = Select(TABLE, **dict(zip(KEYS, case, strict=True)))
    low, high = (row[column] for column in INTERVAL)
    assert low * 0.999 < run["control_variation"] < high * 1.001


# Passivity over networks, for any of which neither was designed.


def OverNetwork(plans, kind, channel, round_trip):
    """Through tissue into free space, and a stop: nothing is left to be stored."""
    plan = plans["two_dof_puncture-never-networks"]
    overrides = Overrides(plan, kind, channel, round_trip)
    overrides += ["surgeon.stop_time=3.0", "duration=5.0"]
    return simulate(LoadScenario("two_dof_puncture", overrides), engine="auto")


@pytest.mark.parametrize(
    ("channel", "round_trip"), Slow([("loss", 0.2), ("both", 1.0)])
)
def test_waves_stay_passive_over_networks(plans, channel, round_trip):
    recording = OverNetwork(plans, "wave_variables", channel, round_trip)
    energy = ChannelEnergy(recording).sum(axis=1)
    assert energy.max() > 0
    assert energy.min() > -1e-6 * energy.max()


@pytest.mark.slow  # test_the_channel_is_passive() has a network.
def test_time_domain_passivity_holds_over_networks(plans):
    """No axis gives more than E_0, but for what the largest mobility lets through."""
    recording = OverNetwork(plans, "time_domain_passivity", "both", 1.0)
    E_0 = ResolveController(recording.scenario).initial_energy
    assert recording["injected_mobility"].max() > 0
    assert ChannelEnergy(recording).min() > -1.35 * E_0
    assert recording["slave_budget"].min() > -0.01 * E_0
    assert recording["master_budget"].min() > -0.35 * E_0
    # The same network is not passive by itself.
    recording = OverNetwork(plans, "direct_force", "both", 0.2)
    assert ChannelEnergyBalance(recording).violation[-1] > 2 * E_0
