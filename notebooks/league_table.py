"""The league table of the control architectures: `python notebooks/league_table.py`.

Every architecture does the four tasks with round-trip delays from 0 to 1 s, over exact
channels and over networks with jitter, loss and both; once with a surgeon who switches
to a force command when contact is felt, as in the thesis, and once with one who never
does and keeps commanding a velocity. Surgeon, haptic device, robot, environment and
limits are the scenarios'; the gains are the architectures' defaults, which derive from
the scenario by the rule that is stated in its file in teleop_drake/architectures.

Each network is run with several sequences of random numbers. Runs are kept in --out as
they end, and --resume goes on with what is there. When all have ended,
league_table.csv, beside this file, has a row for each case and architecture, and the
summary is printed. --quick makes a few of the rows and leaves that file alone.
"""

import argparse
import csv
import functools
import itertools
import math
import statistics
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, TextIO

from teleop_drake.analysis.transparency import FeltStiffness
from teleop_drake.linear_model.operating_point import OperatingPoints
from teleop_drake.scenario import ARCHITECTURES as EVERY_ARCHITECTURE
from teleop_drake.scenario import LoadScenario
from teleop_drake.sweep import Sweep, SweepResult

TABLE = Path(__file__).with_suffix(".csv")

ARCHITECTURES = tuple(x for x in EVERY_ARCHITECTURE if x != "robust_backstepping")
"""Those of the league: a variant of the adaptive controller has no row of its own."""

DURATIONS = {
    "one_dof": 35.0,
    "two_dof_puncture": 7.0,
    "two_dof_collision": 16.0,
    "two_dof_combined": 16.0,
}
"""Tasks and how long they run in s. The slowest architecture touches the bone after
18 s with one axis and 5 s with the arm; then it has 10 s and more to settle. Without a
bone the arm would run out of reach after the scenario's own 7 s."""

ROUND_TRIPS = (0.0, 0.1, 0.2, 0.5, 1.0)
"""Of exact channels, s, half of it each way."""

NETWORK_ROUND_TRIPS = ROUND_TRIPS[1:]
"""Of networks, s, the mean. Without a delay there is nothing to jitter."""

NUM_SEEDS = 20
"""How many sequences of random numbers stand for each network."""

CHANNELS = ("exact", "jitter", "loss", "both")

SAMPLE_PERIOD = 0.005
"""Time between the packets of a network, s. A run costs as much as it has packets:
1 kHz would take five times as long."""

SURGEONS = ("switches", "never")
"""Whether the surgeon goes over to a force command when contact is felt."""

SWITCHING = {"switches": "switches", "never": "never switches"}
"""How to say it."""

STIFFNESS_FREQUENCY = 1.0
"""At which the felt stiffness is taken, rad/s."""

METRICS = {
    "diverged_at": "diverged_at",
    "start_overshoot": "start_velocity_overshoot",
    "puncture_overshoot": "puncture.velocity_overshoot",
    "contact_time": "collision.time",
    "first_impact": "collision.initial_impact_force",
    "peak_force": "collision.peak_force",
    "rebound": "collision.rebound_velocity",
    "settling_time": "collision.settling_time",
    "velocity_rms_error": "velocity_rms_error.x",
    "force_rms_error": "force_rms_error.x",
    "control_peak": "control_force_peak.x",
    "control_variation": "control_force_variation.x",
    "age": "forward_channel.age_mean",
}
"""Columns of the table and the metrics of a sweep, along x, that they have; in s, m/s
and N. `age` is how old on average is what a network's forward channel shows. On bone
there is `felt_stiffness` besides, at STIFFNESS_FREQUENCY in N/m, of exact channels."""

KEYS = ("task", "surgeon", "channel", "round_trip", "controller")
COUNTS = ("runs", "bounded", "at_rest")
INTERVAL = ("control_variation_low", "control_variation_high")
COLUMNS = (*KEYS, "status", *COUNTS, *METRICS, *INTERVAL, "felt_stiffness")
"""A row with several runs says how many there are, how many stay bounded and how many
come to rest on the bone, and has medians of those runs that have such a number; of the
settling time only if all come to rest. Its status is `diverged` if any run's is. The
INTERVAL is from the smallest to the largest."""


def Channel(kind: str, round_trip: float) -> dict[str, Any]:
    """Returns either direction of a channel, as fields of a scenario.

    Jitter has a gamma distribution with a standard deviation of 20 % of the delay and a
    least delay of 60 %. Of the packets 10 % are lost, in bursts of 10 on average, which
    is 50 ms. The receiver holds the newest packet.

    Args:
        kind: One of CHANNELS.
        round_trip: In s.
    """
    delay = round_trip / 2
    if kind == "exact":
        return {"kind": "transport", "delay": delay}
    channel: dict[str, Any] = {
        "kind": "network",
        "delay": delay,
        "sample_period": SAMPLE_PERIOD,
    }
    if kind in ("jitter", "both"):
        channel["jitter"] = {
            "kind": "gamma",
            "std": 0.2 * delay,
            "minimum": 0.6 * delay,
        }
    if kind in ("loss", "both"):
        channel["loss"] = {"kind": "burst", "probability": 0.1, "burst_length": 10.0}
    return channel


def HasBone(task: str) -> bool:
    """Returns whether there is a bone. Without one the surgeons do not differ."""
    return task != "two_dof_puncture"


def Overrides(task: str, surgeon: str, channel: str, round_trip: float) -> dict:
    """Returns what makes a configuration, as LoadScenario takes it.

    The solver is less accurate than by the scenarios' own settings, which moves no
    number by more than 0.2 % in the rows that were compared, also where time-domain
    passivity control brakes and lets go all the time.

    Args:
        task: One of DURATIONS.
        surgeon: One of SURGEONS.
        channel: One of CHANNELS.
        round_trip: In s.
    """
    overrides: dict[str, Any] = {
        "duration": DURATIONS[task],
        "simulator.accuracy": 1e-7,
        "forward_channel": Channel(channel, round_trip),
        "return_channel": Channel(channel, round_trip),
    }
    if channel == "exact" and task == "one_dof":
        # Its signals are small, and the error norm is absolute. Over a network steps
        # end at each packet, and are short without any error control.
        overrides["simulator.accuracy"] = 1e-10
    if surgeon == "never":
        overrides["surgeon.contact_force"] = None
    return overrides


def Configurations(is_quick: bool = False) -> list[tuple[str, str, str, float]]:
    """Returns (task, surgeon, channel, round trip) of each, in the table's order.

    Args:
        is_quick: Whether a few of them are enough.
    """
    if is_quick:
        return [
            ("two_dof_puncture", "never", "exact", 0.0),
            ("two_dof_puncture", "never", "both", 1.0),
            ("two_dof_collision", "switches", "exact", 0.5),
        ]
    return [
        (task, surgeon, channel, round_trip)
        for task in DURATIONS
        for surgeon in (SURGEONS if HasBone(task) else SURGEONS[1:])
        for channel in CHANNELS
        for round_trip in (ROUND_TRIPS if channel == "exact" else NETWORK_ROUND_TRIPS)
    ]


def MakeTable(
    configurations: Sequence[tuple[str, str, str, float]],
    *,
    out: Path | None = None,
    resume: bool = False,
    executor: Executor | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    engine: str = "auto",
) -> list[dict[str, Any]]:
    """Runs configurations with every architecture and returns the rows of the table.

    Args:
        configurations: As Configurations() returns them.
        out: Folder for the sweeps; None keeps none.
        resume: Whether to go on with the sweeps that are there.
        executor: Where to simulate; None: as Sweep does, in so many jobs.
        jobs: Number of processes.
        progress: Called with the number of runs that are finished and of all.
        engine: As Sweep takes it.

    Returns:
        One row for each architecture, with COLUMNS; None where there is no such number.
    """
    rows = []
    said: set[str] = set()

    def Notice(text: str) -> None:
        if text not in said:
            print(text, file=sys.stderr)
        said.add(text)

    grids = [Grid(channel) for _, _, channel, _ in configurations]
    sizes = [math.prod(map(len, grid.values())) for grid in grids]
    for i, (configuration, grid) in enumerate(zip(configurations, grids, strict=True)):
        task, *others = configuration

        def Report(done: int, total: int, before: int = sum(sizes[:i])) -> None:
            if progress is not None:
                progress(before + done, sum(sizes))

        result = Sweep(
            task,
            grid,
            overrides=Overrides(*configuration),
            executor=executor,
            jobs=jobs,
            out=out and out / "-".join(map(str, configuration)),
            resume=resume,
            progress=Report,
            engine=engine,
            notice=Notice,
        )
        rows += _Rows(dict(zip(KEYS, (task, *others), strict=False)), result)
    return rows


def Grid(channel: str) -> dict[str, Sequence[Any]]:
    """Returns what the runs of a configuration differ in, as Sweep takes it.

    Args:
        channel: One of CHANNELS.
    """
    grid: dict[str, Sequence[Any]] = {"controller": ARCHITECTURES}
    return grid if channel == "exact" else grid | {"seed": range(NUM_SEEDS)}


def _Rows(
    configuration: dict[str, Any], result: SweepResult
) -> Iterator[dict[str, Any]]:
    table = result.Table()
    for kind in ARCHITECTURES:
        runs = [run for run in table if run["controller"] == kind]
        row = dict.fromkeys(COLUMNS) | configuration | {"controller": kind}
        row |= _Numbers(runs)
        if row["channel"] == "exact" and HasBone(row["task"]):
            row["felt_stiffness"] = _FeltStiffness(row)
        yield row


def _Numbers(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Returns what a row says of its runs, see COLUMNS."""
    values = {
        column: [run[metric] for run in runs if run.get(metric) is not None]
        for column, metric in METRICS.items()
    }
    bounded = sum(run["status"] == "completed" for run in runs)
    at_rest = len(values["settling_time"])
    if at_rest < len(runs):
        values["settling_time"] = []
    row: dict[str, Any] = {
        column: statistics.median(x) if x else None for column, x in values.items()
    }
    ends = min(values["control_variation"]), max(values["control_variation"])
    row |= dict(zip(COUNTS, (len(runs), bounded, at_rest), strict=True))
    row |= dict(zip(INTERVAL, ends, strict=True))
    return row | {"status": "completed" if bounded == len(runs) else "diverged"}


def _FeltStiffness(row: dict[str, Any]) -> float:
    scenario = LoadScenario(
        row["task"],
        {
            "controller.kind": row["controller"],
            **Overrides(*(row[key] for key in KEYS[:4])),
        },
    )
    bone = OperatingPoints(scenario)[-1]
    return float(FeltStiffness(scenario, bone, [STIFFNESS_FREQUENCY])[0])


def WriteTable(rows: Iterable[dict[str, Any]], file: TextIO) -> None:
    """Writes rows as CSV, numbers with four digits and nothing for None."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        cells = (row[key] for key in COLUMNS)
        writer.writerow(f"{x:.4g}" if isinstance(x, float) else x for x in cells)


def ReadTable(path: Path = TABLE) -> list[dict[str, Any]]:
    """Returns the rows that WriteTable() wrote."""
    words = (*(key for key in KEYS if key != "round_trip"), "status")
    with path.open(encoding="utf-8", newline="") as file:
        return [
            {
                key: text if key in words else float(text) if text else None
                for key, text in row.items()
            }
            for row in csv.DictReader(file)
        ]


# What the table says.


def Select(rows: Iterable[dict[str, Any]], **values: Any) -> list[dict[str, Any]]:
    """Returns the rows with these values, for example round_trip=0.2."""
    return [
        row for row in rows if all(row[key] == value for key, value in values.items())
    ]


def IsBounded(row: dict[str, Any]) -> bool:
    """Returns whether all runs went on to their end, below five times the command."""
    return bool(row["status"] == "completed")


def Settles(row: dict[str, Any]) -> bool:
    """Returns whether the tool came to rest on the bone before the end, in all runs."""
    return row["settling_time"] is not None


def Count(rows: Iterable[dict[str, Any]], test: Callable[[dict], bool]) -> str:
    """Returns how many rows pass a test, as "3/7"."""
    results = [test(row) for row in rows]
    return f"{sum(results)}/{len(results)}"


def CountTable(
    rows: Iterable[dict[str, Any]], test: Callable[[dict], bool], **values: Any
) -> list[list[str]]:
    """Returns how many of an architecture's runs pass a test, by round trip and in all.

    Args:
        rows: Of the table.
        test: IsBounded, or Settles, for which runs without a bone do not count.
        **values: Which rows, as Select() takes them.

    Returns:
        Rows of cells, the head first.
    """
    rows = Select(rows, **values)
    if test is Settles:
        rows = [row for row in rows if HasBone(row["task"])]
    trips = sorted({row["round_trip"] for row in rows})
    body = []
    for kind in ARCHITECTURES:
        mine = Select(rows, controller=kind)
        cells = [Count(Select(mine, round_trip=trip), test) for trip in trips]
        body.append([kind, *cells, Count(mine, test)])
    return [["", *(f"{trip:g} s" for trip in trips), "all"], *body]


def FailureTable(rows: Iterable[dict[str, Any]]) -> list[list[str]]:
    """Returns at which round trip each architecture fails first, over exact channels.

    The shortest in the table at which the tool runs away; in brackets the shortest at
    which it does not settle, if that is shorter.

    Args:
        rows: Of the table.

    Returns:
        Rows of cells, the head first.
    """
    rows = Select(rows, channel="exact")
    columns = dict.fromkeys((row["task"], row["surgeon"]) for row in rows)
    body = []
    for kind in ARCHITECTURES:
        cells = []
        for task, surgeon in columns:
            mine = Select(rows, controller=kind, task=task, surgeon=surgeon)
            trips = [row["round_trip"] for row in mine if not IsBounded(row)]
            unsettled = [row["round_trip"] for row in mine if not Settles(row)]
            runaway = min(trips, default=None)
            cell = "-" if runaway is None else f"{runaway:g}"
            if HasBone(task) and unsettled and min(unsettled) != runaway:
                cell += f" ({min(unsettled):g})"
            cells.append(cell)
        body.append([kind, *cells])
    return [["", *(f"{task}, {surgeon}" for task, surgeon in columns)], *body]


MEDIANS = {
    "start overshoot": ("start_overshoot", "%"),
    "puncture overshoot": ("puncture_overshoot", "%"),
    "contact at": ("contact_time", "ratio"),
    "first impact": ("first_impact", "ratio"),
    "largest force": ("peak_force", "ratio"),
    "settles after": ("settling_time", "s"),
    "velocity error": ("velocity_rms_error", "ratio"),
    "control effort": ("control_variation", "ratio"),
    "felt stiffness": ("felt_stiffness", "N/m"),
}
"""Columns of Medians(), and the columns of the table and the units that they have."""


def Medians(
    rows: Sequence[dict[str, Any]], round_trip: float, channel: str = "exact"
) -> dict[str, dict[str, float | None]]:
    """Returns the medians over the tasks of what each architecture does.

    With the surgeon who switches; in the puncture, where there is nothing to switch
    for, with the other. Overshoots are in % of the commanded speed, settling in s and
    stiffness in N/m; the rest are ratios to what direct force does in the same task
    without delay.

    Args:
        rows: The whole table.
        round_trip: In s.
        channel: One of CHANNELS.

    Returns:
        By architecture and column. None where the tool runs away in any task, but for
        the stiffness, and for settling also where it does not settle on every bone.
    """
    medians: dict[str, dict[str, float | None]] = {}
    for kind in ARCHITECTURES:
        pairs = []
        for task in DURATIONS:
            case = {"task": task, "surgeon": SURGEONS[0 if HasBone(task) else 1]}
            (row,) = Select(
                rows, controller=kind, channel=channel, round_trip=round_trip, **case
            )
            (ideal,) = Select(
                rows,
                controller="direct_force",
                channel="exact",
                round_trip=0.0,
                **case,
            )
            pairs.append((row, ideal))
        medians[kind] = {
            name: _Median(column, unit, pairs)
            for name, (column, unit) in MEDIANS.items()
        }
    return medians


def _Median(
    column: str, unit: str, pairs: Sequence[tuple[dict[str, Any], dict[str, Any]]]
) -> float | None:
    is_bounded = all(IsBounded(row) for row, _ in pairs)
    if not is_bounded and column != "felt_stiffness":
        return None
    values = []
    for row, ideal in pairs:
        value = row[column]
        if value is None:
            if column == "settling_time" and HasBone(row["task"]):
                return None
        elif unit == "%":
            values.append(100 * value / _CommandedSpeed(row["task"]))
        else:
            values.append(value / ideal[column] if unit == "ratio" else value)
    return statistics.median(values) if values else None


@functools.cache
def _CommandedSpeed(task: str) -> float:
    return float(LoadScenario(task).surgeon.velocity[0])


def MedianTable(
    rows: Sequence[dict[str, Any]], round_trip: float, channel: str = "exact"
) -> list[list[str]]:
    """Returns Medians() as rows of cells, the head first."""
    head = ["", *(f"{name} [{unit}]" for name, (_, unit) in MEDIANS.items())]
    medians = Medians(rows, round_trip, channel)
    return [
        head,
        *(
            [kind, *("-" if x is None else f"{x:.3g}" for x in values.values())]
            for kind, values in medians.items()
        ),
    ]


def NetworkTable(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Returns what a network changes against an exact channel of the same mean delay.

    Args:
        rows: The whole table.

    Returns:
        Rows of cells, the head first. For each kind of network: how many more cases
        stay bounded, how many more come to rest on the bone, each case counted by the
        share of its runs, and the ratio of the control efforts where all are bounded:
        median over the cases, of the runs' medians and of their INTERVAL.
    """
    networks = CHANNELS[1:]
    body = []
    for kind in ARCHITECTURES:
        cells = []
        for channel in networks:
            ratios, bounded, at_rest = [], 0.0, 0.0
            for row in Select(rows, controller=kind, channel=channel):
                case = {key: row[key] for key in KEYS} | {"channel": "exact"}
                (exact,) = Select(rows, **case)
                bounded += row["bounded"] / row["runs"] - IsBounded(exact)
                at_rest += row["at_rest"] / row["runs"] - Settles(exact)
                if IsBounded(row) and IsBounded(exact):
                    effort = exact["control_variation"]
                    columns = ("control_variation", *INTERVAL)
                    ratios.append([row[column] / effort for column in columns])
            ratio = "-"
            if ratios:
                middle, *ends = map(statistics.median, zip(*ratios, strict=True))
                ratio = f"{middle:.3g} ({ends[0]:.3g} to {ends[1]:.3g})"
            cells += [f"{bounded:+.1f}", f"{at_rest:+.1f}", ratio]
        body.append([kind, *cells])
    head = [
        f"{channel}: {what}"
        for channel in networks
        for what in ("bounded", "at rest", "effort")
    ]
    return [["", *head], *body]


def Markdown(table: Sequence[Sequence[str]]) -> str:
    """Returns rows of cells as a table in Markdown, the first row as its head."""
    lines = itertools.chain(table[:1], [["---"] * len(table[0])], table[1:])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def Summary(rows: Sequence[dict[str, Any]]) -> str:
    """Returns all of these tables, in Markdown."""
    parts = []
    for test, title in ((IsBounded, "stay bounded"), (Settles, "settle on the bone")):
        for surgeon in SURGEONS:
            parts += [
                f"Runs that {title}, exact channels, the surgeon {SWITCHING[surgeon]}:",
                Markdown(CountTable(rows, test, channel="exact", surgeon=surgeon)),
            ]
    parts += [
        "Round trip in s at which the tool runs away (does not settle) first:",
        Markdown(FailureTable(rows)),
    ]
    for trip in ROUND_TRIPS:
        parts += [
            f"Medians over the tasks at {trip:g} s, the surgeon switches:",
            Markdown(MedianTable(rows, trip)),
        ]
    parts += [
        "What a network changes against an exact channel:",
        Markdown(NetworkTable(rows)),
    ]
    return "\n\n".join(parts)


def main() -> None:
    """Makes the table, or a part of it, and prints what it says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[1])
    parser.add_argument("--out", type=Path, default=Path("out/league"), metavar="DIR")
    parser.add_argument(
        "--resume", action="store_true", help="go on with what is there"
    )
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes")
    parser.add_argument("--quick", action="store_true", help="a few rows, printed")
    arguments = parser.parse_args()

    def Report(done: int, total: int) -> None:
        print(f"\r{done} of {total} runs", end="", file=sys.stderr, flush=True)

    try:
        rows = MakeTable(
            Configurations(arguments.quick),
            out=arguments.out,
            resume=arguments.resume,
            jobs=arguments.jobs,
            progress=Report,
        )
    finally:
        print(file=sys.stderr)
    if arguments.quick:
        WriteTable(rows, sys.stdout)
    else:
        with TABLE.open("w", encoding="utf-8", newline="") as file:
            WriteTable(rows, file)
        print(Summary(ReadTable()))


if __name__ == "__main__":
    main()
