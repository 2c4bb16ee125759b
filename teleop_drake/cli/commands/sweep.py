"""The command `teleop-drake sweep`."""

import argparse
import multiprocessing
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli import options
from teleop_drake.cli.dask import DaskExecutor
from teleop_drake.cli.exit_codes import (
    DONE,
    FAILED,
    Fail,
    Failed,
    Interrupted,
)
from teleop_drake.cli.output import CheckJson, WriteJson
from teleop_drake.cli.progress import Notice, SweepProgress
from teleop_drake.cli.tables import SeedsTable, SweepTable

if TYPE_CHECKING:
    from teleop_drake.study.figures.sweep_grid import SweepGrid
    from teleop_drake.study.figures.sweep_maps import Boundaries
    from teleop_drake.study.sweep import SweepPlan, TaskSweepResult
    from teleop_drake.study.sweep.study import Study


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.epilog = (
        "VALUES are START:STOP:COUNT or A,B,... in YAML. A sweep that was interrupted, "
        "or killed, goes on with --resume. In the place of SCENARIO a study may stand: "
        "a built-in one, or a file with the keys scenarios, controllers, grid, seeds, "
        "overrides, engine and metrics. It takes none of the options for these, and "
        "has a folder for each scenario."
    )
    options.AddScenarioOptions(parser, has_controller=False, is_sweep=True)
    options.AddGridOptions(parser)
    parser.add_argument(
        "--metrics",
        **options.NAMES,
        help="metrics to draw, for example collision.peak_force or a whole group such "
        "as puncture (default: a few; runs.csv has all)",
    )
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
        help="simulate on the cluster of this Dask scheduler, for example "
        "tcp://host:8786",
    )
    parser.add_argument(
        "--resume", action="store_true", help="do only what is missing in --out"
    )
    options.AddEngineOption(parser)
    options.AddFormatOption(parser)
    options.AddRunOptions(
        parser,
        json_help="write a list with the records of all runs as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write runs.jsonl, runs.csv and figures there (default: out)",
        out_default="out",
    )


# Options that are refused with a study, because its keys take their place.
_OF_A_SCENARIO = (
    *("delay", "forward_delay", "return_delay", "channel", "duration", "accuracy"),
    *("set", "controllers", "vary", "seeds", "metrics", "engine"),
)


def Execute(args: argparse.Namespace) -> int:
    """Simulates all runs of a sweep or a study, and draws them."""
    from teleop_drake.study.sweep import SelectMetrics

    if args.dask is not None:
        allowed = "left out with --dask, which has workers"
        options.RefuseOptions(args, ["jobs"], allowed)
    CheckJson(args.json)
    formats = options.FormatsOf(args)
    study = StudyOf(args)
    metrics = {
        name: SelectMetrics(plan.scenario, study.metrics or [])
        for name, plan in study.plans.items()
    }
    with _Drawing() as drawing:
        results = _Simulate(args, study)
        for name, result in results.items():
            folder = Path(args.out, name)
            plan = study.plans[name]
            report = partial(
                _Report, result, metrics[name], folder, plan, formats, args.separate
            )
            text = drawing(report)
            if args.json != "-":
                print(text)
    if args.json is not None:
        records = {name: result.records for name, result in results.items()}
        WriteJson(args.json, records.get("", records))
    return max(_ExitCode(result) for result in results.values())


def _Simulate(args: argparse.Namespace, study: "Study") -> "dict[str, TaskSweepResult]":
    """Runs the sweeps of a study; returns their results, keyed by sweep."""
    from teleop_drake.study.sweep import Execution, RunSweeps

    progress = "no runs"

    def Report(finished: int, runs: int) -> None:
        nonlocal progress
        progress = f"{finished} of {runs} runs"
        show(finished, runs)

    try:
        with DaskExecutor(args.dask) as executor, SweepProgress(args.quiet) as show:
            execution = Execution(
                executor=executor,
                jobs=args.jobs,
                out=args.out,
                resume=args.resume,
                progress=Report,
                notice=Notice,
            )
            return RunSweeps(study.plans, execution)
    except RuntimeError as error:  # The executor or the worker processes failed.
        raise Failed(f"{error}; --resume does the rest") from None
    except KeyboardInterrupt:
        raise Interrupted(
            f"interrupted; {progress} are in {args.out}, --resume does the rest"
        ) from None


def StudyOf(args: argparse.Namespace) -> "Study":
    """Returns the study that SCENARIO names, or a study of this scenario only.

    The only sweep of the latter has an empty name, so that it has no subfolder.

    Raises:
        ScenarioError: If a study is given with an option whose place its keys take.
    """
    from teleop_drake.study.sweep.study import IsStudy, LoadStudy, Study

    if not IsStudy(args.scenario):
        return Study(plans={"": PlanOf(args)}, metrics=args.metrics)
    options.RefuseOptions(args, _OF_A_SCENARIO, "left out with a study, which has it")
    return LoadStudy(args.scenario)


def PlanOf(args: argparse.Namespace) -> "SweepPlan":
    """Returns the plan of a scenario's sweep; seeds vary fastest, then the delays."""
    from teleop_drake.model.scenario import CONTROLLERS, LoadScenario, ScenarioError
    from teleop_drake.model.scenario.overrides import ParseOverrides
    from teleop_drake.model.tasks import ComparedControllers
    from teleop_drake.study.sweep import PlanSweep

    delays = [
        (key, getattr(args, key))
        for key in ("delay", "forward_delay", "return_delay")
        if getattr(args, key) is not None
    ]
    given = [options.SplitVary(item)[0] for item in args.vary]
    given += [path for path, _ in ParseOverrides(options.FieldsOf(args))]
    controllers = options.ControllersOf(args)
    if not controllers and not {*given} & {"controller", "controller.kind"}:
        try:
            controllers = ComparedControllers(LoadScenario(args.scenario))
        except ScenarioError:  # The overrides may make it valid.
            controllers = list(CONTROLLERS)
    return PlanSweep(
        args.scenario,
        options.GridOf(args, controllers, *delays),
        overrides=options.OverridesOf(args, ("duration", "accuracy")),
        engine=args.engine,
    )


def _Report(
    result: "TaskSweepResult",
    metrics: Sequence[str],
    folder: Path,
    plan: "SweepPlan",
    formats: Sequence[str],
    is_separate: bool,
) -> str:
    """Draws a sweep; returns a text with its results and the written files."""
    from teleop_drake.study.sweep import VariesSeedsOnly

    figures, note = _Draw(result, metrics, folder, plan, formats, is_separate)
    statuses = [record["status"] for record in result.records]
    counts = ", ".join(
        f"{statuses.count(status)} {status}"
        for status in ("completed", "diverged", "failed")
    )
    table = SeedsTable if VariesSeedsOnly(result) else SweepTable
    names = ("runs.jsonl", "runs.csv", "statistics.csv", "differences.csv")
    tables = [folder / name for name in names if (folder / name).exists()]
    lines = [
        f"{result.scenario.name}: {len(statuses)} runs, {counts}",
        table(result, metrics),
        note,
        f"Written: {', '.join(map(str, [*tables, *figures]))}",
    ]
    return "\n".join(filter(None, lines))


def _ExitCode(result: "TaskSweepResult") -> int:
    """Returns the exit code of a sweep; prints an error if all of its runs failed."""
    if any(record["status"] != "failed" for record in result.records):
        return DONE
    count = len(result.records)
    first = result.records[0]["reason"]
    return Fail(FAILED, f"{result.scenario.name}: all {count} runs failed: {first}")


@contextmanager
def _Drawing() -> Iterator[Callable[[Callable[[], str]], str]]:
    """Yields a function that calls its argument, on Linux in a fork of this process.

    The fork imports Matplotlib while this process simulates. A process with other
    Python threads does not fork, because that would not be safe.
    """
    if sys.platform != "linux" or threading.active_count() > 1:
        yield lambda call: call()
        return
    from teleop_drake.study.sweep.workers import Worker

    with warnings.catch_warnings():
        # Python 3.12 warns about threads of any kind; those of BLAS survive a fork.
        warnings.simplefilter("ignore", DeprecationWarning)
        worker = Worker(multiprocessing.get_context("fork"), _PrepareToDraw)
    try:
        yield worker.Do
    finally:
        worker.End()


def _PrepareToDraw() -> None:
    """Imports the figures; draws one, which loads fonts and the parser of formulas."""
    from io import BytesIO

    from matplotlib.figure import Figure

    import teleop_drake.study.figures.sweeps  # noqa: F401

    figure = Figure(figsize=(1, 1))
    figure.text(0, 0, r"$\mathdefault{0.1}$")
    figure.savefig(BytesIO(), format="png", dpi=10)


def _Draw(
    result: "TaskSweepResult",
    names: Sequence[str],
    folder: Path,
    plan: "SweepPlan",
    formats: Sequence[str],
    is_separate: bool,
) -> tuple[list[Path], str]:
    """Draws the metrics; returns the files, and a note on what could not be drawn."""
    from teleop_drake.study.figures.saving import SaveFigure
    from teleop_drake.study.figures.sweep_grid import MAX_PANELS, SweepGrid
    from teleop_drake.study.figures.sweeps import PlotSweep

    metrics = list(names) or result.Metrics()
    # Curves of the metrics, in one figure or in one for each metric.
    try:
        grid = SweepGrid(result)
        is_separate |= len(grid.panel_points) * len(metrics) > MAX_PANELS
        groups: dict[str, Sequence[str]] = {"metrics": metrics} if metrics else {}
        if is_separate:
            groups = {metric.replace(".", "_"): [metric] for metric in metrics}
        figures = {name: PlotSweep(result, *group) for name, group in groups.items()}
    except ValueError as e:
        return [], f"No figures ({e})"
    note = ""
    # With two varied fields, maps too, with the stability boundaries of the analysis.
    if grid.has_two_keys:
        from teleop_drake.study.figures.sweep_maps import PlotMap, PlotStability

        boundaries, note = _Boundaries(grid, plan)
        figures["stability"] = PlotStability(result, boundaries)
        for name, group in groups.items():
            figures[f"{name}_map"] = PlotMap(result, *group, boundaries=boundaries)
    written = []
    for name, figure in figures.items():
        for suffix in formats:
            written.append(folder / f"{name}.{suffix}")
            SaveFigure(figure, written[-1])
    return written, note


def _Boundaries(grid: "SweepGrid", plan: "SweepPlan") -> tuple["Boundaries", str]:
    """Returns the stability boundaries of each panel of a map, and notes on them.

    If the analysis is not possible, there are no boundaries, and the note has the
    reason.
    """
    from teleop_drake.study.sweep.boundary import FindBoundaries

    try:
        found = [
            FindBoundaries(
                plan, grid.x_key, grid.line_key, grid.line_values, others=others
            )
            for others in grid.panel_points
        ]
    except ValueError as error:
        return [], f"No boundary of stability in the maps ({error})"
    notes = dict.fromkeys(x.note for drawn in found for x in drawn if x.note)
    return found, "\n".join(notes)
