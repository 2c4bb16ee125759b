"""Options, workers and reports shared by the commands that sweep."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli.exit_codes import DONE, FAILED, BadInput, Fail
from teleop_drake.cli.tables import SeedsTable

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from teleop_drake.figures.sweeps import Boundaries
    from teleop_drake.sweep import SweepPlan, SweepResult


def AddSweepOptions(parser: argparse.ArgumentParser) -> None:
    """Adds --separate, --jobs, --dask and --resume."""
    parser.add_argument(
        "--separate",
        action="store_true",
        help="draw each metric into a file of its own; more than 24 panels always are",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help="processes that simulate (default: one per processor; none for a few "
        "compiled runs)",
    )
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="simulate on the cluster of this Dask scheduler instead, for example "
        "tcp://host:8786",
    )
    parser.add_argument(
        "--resume", action="store_true", help="do only what is missing in --out"
    )


def ReportSweep(
    result: "SweepResult",
    plan: "SweepPlan",
    metrics: Sequence[str],
    folder: Path,
    *,
    is_silent: bool,
    is_separate: bool,
    formats: Sequence[str] = ("png",),
) -> None:
    """Draws a sweep into its folder, and prints how it ended and what was written.

    Args:
        metrics: The metrics to draw; empty: some, of those that any run has.
        is_separate: Whether each metric has a file of its own.
    """
    from teleop_drake.sweep import (
        TableNames,
        VariesSeedsOnly,
    )

    figures, note = _DrawSweep(result, metrics, folder, plan, formats, is_separate)
    if is_silent:
        return
    statuses = [record["status"] for record in result.records]
    counts = ", ".join(
        f"{statuses.count(status)} {status}"
        for status in ("completed", "diverged", "failed")
    )
    print(f"{result.scenario.name}: {len(statuses)} runs, {counts}")
    if VariesSeedsOnly(result):
        print(SeedsTable(result, metrics))
    if note:
        print(note)
    names = ["runs.jsonl", *TableNames(result)]
    written = [folder / name for name in names] + figures
    print("Written:", ", ".join(map(str, written)))


def ExitCode(result: "SweepResult") -> int:
    """Returns the exit code of a sweep; says so if none of its runs succeeded."""
    if any(record["status"] != "failed" for record in result.records):
        return DONE
    count, first = len(result.records), result.records[0]["reason"]
    return Fail(FAILED, f"{result.scenario.name}: all {count} runs failed: {first}")


@contextmanager
def DaskExecutor(address: str | None, is_quiet: bool) -> Iterator["Executor | None"]:
    """Yields the executor of a Dask cluster, or None without an address.

    If the cluster has no workers yet, it says so on stderr.
    """
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise BadInput(
            f"--dask = {address!r}: must be left out, or the package distributed "
            "installed (pip install 'teleop-drake[dask]')"
        ) from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as e:
        raise BadInput(
            f"--dask = {address!r}: must be the address of a Dask scheduler ({e})"
        ) from None
    with client:
        if not is_quiet and not client.scheduler_info()["workers"]:
            print(
                f"teleop-drake: {address} has no workers; the runs wait for the first "
                f"one (dask worker {address}). Ctrl-C ends the sweep",
                file=sys.stderr,
                flush=True,
            )
        # The default, pure, would take runs with equal arguments for one.
        yield client.get_executor(pure=False)


def _DrawSweep(
    result: "SweepResult",
    names: Sequence[str],
    folder: Path,
    plan: "SweepPlan",
    formats: Sequence[str],
    is_separate: bool,
) -> tuple[list[Path], str]:
    """Draws the metrics; returns the files, or why there are none."""
    import numpy as np

    from teleop_drake.figures import sweeps
    from teleop_drake.figures.runs import SaveFigure
    from teleop_drake.sweep import SelectMetrics, VariesSeedsOnly

    metrics = list(names) or [
        metric
        for metric in SelectMetrics(result.scenario)
        if np.isfinite(result.Values(metric)).any()
    ]
    # Over the seeds alone, there is nothing to plot a metric against.
    has_seeds_only = VariesSeedsOnly(result)
    plot = sweeps.PlotSeeds if has_seeds_only else sweeps.PlotSweep
    try:
        rows, columns = (1, 1) if has_seeds_only else sweeps.SweepGrid(result).shape[:2]
        is_separate |= rows * columns * len(metrics) > sweeps.MAX_PANELS
        groups: dict[str, Sequence[str]] = {
            metric.replace(".", "_") if is_separate else "metrics": (
                [metric] if is_separate else metrics
            )
            for metric in metrics
        }
        figures = {name: plot(result, *group) for name, group in groups.items()}
    except ValueError as e:
        return [], f"No figures ({e})"
    note = ""
    with suppress(ValueError):  # Only one key is varied.
        figures["stability"] = sweeps.PlotStability(result)
        boundaries, note = _Boundaries(result, plan)
        figures["stability"] = sweeps.PlotStability(result, boundaries)
        for name, group in groups.items():
            figures[f"{name}_map"] = sweeps.PlotMap(
                result, *group, boundaries=boundaries
            )
    written = []
    for name, figure in figures.items():
        for suffix in formats:
            written.append(folder / f"{name}.{suffix}")
            SaveFigure(figure, written[-1])
    return written, note


def _Boundaries(result: "SweepResult", plan: "SweepPlan") -> tuple["Boundaries", str]:
    """Returns what the analysis says of each panel of a map, or why it says nothing."""
    from teleop_drake.figures.sweeps import SweepGrid
    from teleop_drake.sweep.boundary import FindBoundaries

    grid = SweepGrid(result)
    try:
        found = {
            (i, j): FindBoundaries(
                plan, grid.x_key, grid.line_key, grid.line_values, others=others
            )
            for i, row in enumerate(grid.panel_points)
            for j, others in enumerate(row)
        }
    except ValueError as error:
        return {}, f"No boundary of stability in the maps ({error})"
    notes = dict.fromkeys(x.note for drawn in found.values() for x in drawn if x.note)
    return found, "\n".join(notes)
