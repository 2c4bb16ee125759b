"""The command `teleop-drake sweep`."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_drake.cli.exit_codes import FAILED, INTERRUPTED, BadInput, Fail
from teleop_drake.cli.options import (
    OVERRIDES,
    AddEngineOption,
    AddRunOptions,
    AddScenarioOptions,
    ChannelOverrides,
)
from teleop_drake.cli.output import CheckJson, WriteJson
from teleop_drake.cli.progress import SweepProgress
from teleop_drake.cli.tables import NO_INTERVALS, SeedsTable

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from teleop_drake.figures.sweep_maps import Boundaries
    from teleop_drake.sweep import SweepPlan, SweepResult


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.epilog = (
        "VALUES are START:STOP:COUNT or A,B,... in YAML. A sweep that was interrupted, "
        "or killed, goes on with --resume."
    )
    AddScenarioOptions(parser, has_controller=False, is_sweep=True)
    parser.add_argument(
        "--controllers",
        metavar="A,B,...",
        help="controller.kind; `all`: every architecture (default: the thesis's two)",
    )
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="PATH=VALUES",
        help="values of any other field, for example "
        "environment.layers.bone.stiffness=100:400:7; repeatable",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        metavar="N",
        help="N runs of each, with the seeds 0 to N - 1 of the network channels; "
        "statistics.csv and differences.csv have medians, shares and differences "
        "between controllers with intervals",
    )
    parser.add_argument(
        "--metrics",
        metavar="A,B,...",
        help="metrics to draw, for example collision.peak_force or a whole group such "
        "as puncture (default: a few; runs.csv has all)",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help="processes that simulate (default: one per processor)",
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
    AddEngineOption(parser, default="auto")
    AddRunOptions(
        parser,
        json_help="write a list with the records of all runs as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write runs.jsonl, runs.csv and figures (.png) there (default: out)",
        out_default="out",
    )


def Execute(args: argparse.Namespace) -> int:
    """Simulates all runs of a sweep, and draws them."""
    from teleop_drake.scenario import ScenarioError
    from teleop_drake.sweep import (
        HasIntervals,
        HasSeeds,
        PlanSweep,
        RunSweep,
        SelectMetrics,
        SweepError,
        TableNames,
        VariesSeedsOnly,
    )

    if args.jobs is not None and args.dask is not None:
        raise BadInput("--jobs: must be left out with --dask, which has workers")
    CheckJson(args.json)
    num_finished = num_runs = 0
    try:
        grid, overrides = Grid(args)
        plan = PlanSweep(args.scenario, grid, overrides=overrides, engine=args.engine)
        metrics = []
        if args.metrics is not None:
            names = [name.strip() for name in args.metrics.split(",")]
            metrics = SelectMetrics(plan.scenario, names)
        with (
            _DaskExecutor(args.dask, args.quiet) as executor,
            SweepProgress(args.quiet) as show,
        ):

            def Report(finished: int, runs: int) -> None:
                nonlocal num_finished, num_runs
                num_finished, num_runs = finished, runs
                show(finished, runs)

            result = RunSweep(
                plan,
                executor=executor,
                jobs=args.jobs,
                out=args.out,
                resume=args.resume,
                progress=Report,
                notice=lambda text: print(f"teleop-drake: {text}", file=sys.stderr),
            )
    except (ScenarioError, SweepError) as e:
        raise BadInput(e) from None
    except RuntimeError as e:  # The executor gave up.
        return Fail(FAILED, f"{e}; --resume does the rest")
    except KeyboardInterrupt:
        return Fail(
            INTERRUPTED,
            f"interrupted; {num_finished} of {num_runs} runs are in {args.out}, "
            "--resume does the rest",
        )
    figures, note = _DrawSweep(result, metrics, Path(args.out), plan)
    if args.json is not None:
        WriteJson(args.json, result.records)
    if args.json != "-":
        statuses = [record["status"] for record in result.records]
        counts = ", ".join(
            f"{statuses.count(status)} {status}"
            for status in ("completed", "diverged", "failed")
        )
        print(f"{plan.scenario.name}: {len(statuses)} runs, {counts}")
        if HasSeeds(result) and not HasIntervals():
            print(NO_INTERVALS)
        if VariesSeedsOnly(result):
            print(SeedsTable(result, metrics))
        if note:
            print(note)
        names = ["runs.jsonl", *TableNames(result)]
        written = [Path(args.out) / name for name in names] + figures
        print("Written:", ", ".join(map(str, written)))
    return 0


# Options that stand for keys of a grid.
_GRID_OPTIONS = {
    "delay": "delay",
    "forward_delay": "forward_delay",
    "return_delay": "return_delay",
    "seed": "seeds",
    "controller": "controllers",
}


def Grid(args: argparse.Namespace) -> tuple[dict[str, list[Any]], list[str]]:
    """Returns the grid of a sweep and the overrides for all its runs.

    Seeds vary fastest, then the delays.
    """
    from teleop_drake.scenario import (
        ARCHITECTURES,
        CONTROLLERS,
        LoadScenario,
        ScenarioError,
    )
    from teleop_drake.sweep import MAX_RUNS, ParseValues, SweepError
    from teleop_drake.tasks import TaskOf

    def Parse(option: str, text: str) -> list[Any]:
        try:
            return ParseValues(text)
        except SweepError as e:
            raise BadInput(f"{option} = {e}") from None

    overrides = (
        ChannelOverrides(args)
        + [
            f"{path}={getattr(args, option)}"
            for option in ("duration", "accuracy")
            if getattr(args, option) is not None
            for path in OVERRIDES[option]
        ]
        + args.set
    )
    grid: dict[str, list[Any]] = {}
    for item in args.vary:
        path, equals, text = item.partition("=")
        path = path.strip()
        if not equals or not path:
            raise BadInput(f"--vary = {item!r}: must be PATH=VALUES")
        if path in grid or getattr(args, _GRID_OPTIONS.get(path, ""), None):
            raise BadInput(f"--vary = {item!r}: must vary what no other option does")
        grid[path] = Parse(f"--vary {path}", text)
    for key in ("delay", "forward_delay", "return_delay"):
        text = getattr(args, key)
        if text is not None:
            grid[key] = Parse(f"--{key.replace('_', '-')}", text)

    if args.seeds is not None:
        if not 1 <= args.seeds <= MAX_RUNS:
            raise BadInput(f"--seeds = {args.seeds}: must be 1 to {MAX_RUNS}")
        grid["seed"] = list(range(args.seeds))

    controllers: list[Any] = []
    if args.controllers == "all":
        controllers = list(ARCHITECTURES)
    elif args.controllers is not None:
        controllers = Parse("--controllers", args.controllers)
    elif not any(
        item.partition("=")[0].strip() in ("controller", "controller.kind")
        for item in [*args.vary, *args.set]
    ):
        try:
            controllers = list(TaskOf(LoadScenario(args.scenario)).controllers)
        except ScenarioError:  # It may be good with its overrides.
            controllers = list(CONTROLLERS)
    return ({"controller": controllers} if controllers else {}) | grid, overrides


@contextmanager
def _DaskExecutor(address: str | None, is_quiet: bool) -> Iterator["Executor | None"]:
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
    result: "SweepResult", names: Sequence[str], folder: Path, plan: "SweepPlan"
) -> tuple[list[Path], str]:
    """Draws the metrics; returns the files, or why there are none.

    Args:
        result: The sweep.
        names: The metrics; empty: some, of those that any run has.
        folder: Where to.
        plan: What the sweep was.
    """
    import numpy as np

    from teleop_drake.figures.runs import SaveFigure
    from teleop_drake.figures.sweeps import PlotMap, PlotSeeds, PlotStability, PlotSweep
    from teleop_drake.sweep import SelectMetrics, VariesSeedsOnly

    metrics = list(names) or [
        metric
        for metric in SelectMetrics(result.scenario)
        if np.isfinite(result.Values(metric)).any()
    ]
    # Over the seeds alone, there is nothing to plot a metric against.
    plot = PlotSeeds if VariesSeedsOnly(result) else PlotSweep
    figures = {}
    try:
        for metric in metrics:
            figures[metric.replace(".", "_")] = plot(result, metric)
    except ValueError as e:
        return [], f"No figures ({e})"
    note = ""
    with suppress(ValueError):  # Only one key is varied.
        figures["stability"] = PlotStability(result)
        boundaries, note = _Boundaries(result, plan)
        figures["stability"] = PlotStability(result, boundaries)
        for metric in metrics:
            name = metric.replace(".", "_")
            figures[f"{name}_map"] = PlotMap(result, metric, boundaries)
    for name, figure in figures.items():
        SaveFigure(figure, folder / f"{name}.png")
    return [folder / f"{name}.png" for name in figures], note


def _Boundaries(result: "SweepResult", plan: "SweepPlan") -> tuple["Boundaries", str]:
    """Returns what the analysis says of each panel of a map, or why it says nothing."""
    from teleop_drake.figures.sweep_grid import SweepGrid
    from teleop_drake.sweep.boundary import FindBoundaries

    grid = SweepGrid(result)
    try:
        return {
            (i, j): FindBoundaries(
                plan, grid.x_key, grid.line_key, grid.line_values, others=others
            )
            for i, row in enumerate(grid.panel_points)
            for j, others in enumerate(row)
        }, ""
    except ValueError as error:
        return {}, f"No boundary of stability in the maps ({error})"
