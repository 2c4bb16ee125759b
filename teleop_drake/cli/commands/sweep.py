"""The command `teleop-drake sweep`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli import options
from teleop_drake.cli.exit_codes import DONE, FAILED, INTERRUPTED, BadInput, Fail
from teleop_drake.cli.output import CheckJson, WriteJson
from teleop_drake.cli.progress import SweepProgress
from teleop_drake.cli.tables import SeedsTable

if TYPE_CHECKING:
    from teleop_drake.figures.sweeps import Boundaries, SweepGrid
    from teleop_drake.sweep import SweepPlan, SweepResult
    from teleop_drake.sweep.study import Study


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
        metavar="A,B,...",
        help="metrics to draw, for example collision.peak_force or a whole group such "
        "as puncture (default: a few; runs.csv has all)",
    )
    parser.add_argument(
        "--shard",
        metavar="I/N",
        help="do the I-th of N parts of the runs, as a job of an array",
    )
    parser.add_argument(
        "--merge",
        nargs="+",
        metavar="DIR",
        help="simulate nothing; put the parts in these folders together in --out",
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


# What a study says itself.
_OF_A_SCENARIO = (
    *("delay", "forward_delay", "return_delay", "channel", "duration", "accuracy"),
    *("set", "controllers", "vary", "seeds", "metrics"),
)


def Execute(args: argparse.Namespace) -> int:
    """Simulates all runs of a sweep, or a part of them, and draws them."""
    from teleop_drake.sweep import SelectMetrics, TableNames
    from teleop_drake.sweep.study import MergeStudy, ParsePart, RunStudy

    _CheckOptions(args)
    CheckJson(args.json)
    formats = options.FormatsOf(args)
    progress = (0, 0)

    def Notice(text: str) -> None:
        print(f"teleop-drake: {text}", file=sys.stderr)

    def Report(finished: int, runs: int) -> None:
        nonlocal progress
        progress = finished, runs
        show(finished, runs)

    part = None if args.shard is None else ParsePart(args.shard)
    study = StudyOf(args)
    metrics = {
        name: SelectMetrics(plan.scenario, study.metrics) if study.metrics else []
        for name, plan in study.plans.items()
    }
    try:
        with SweepProgress(args.quiet) as show:
            if args.merge is not None:
                results = MergeStudy(study, args.out, args.merge, notice=Notice)
            else:
                results = RunStudy(
                    study,
                    args.out,
                    part=part,
                    jobs=args.jobs,
                    resume=args.resume,
                    progress=Report,
                    notice=Notice,
                )
    except RuntimeError as e:  # No worker process can start.
        return Fail(FAILED, f"{e}; --resume does the rest")
    except KeyboardInterrupt:
        finished, runs = progress
        message = f"interrupted; {finished} of {runs} runs are in {args.out}, "
        return Fail(INTERRUPTED, message + "--resume does the rest")
    if part is not None:
        if args.json != "-":
            print(f"Part {args.shard} is done. When all are: --merge {args.out}")
        return DONE
    for name, result in results.items():
        folder = Path(args.out, name)
        figures, note = _Draw(
            result, metrics[name], folder, study.plans[name], formats, args.separate
        )
        if args.json != "-":
            _Print(result, metrics[name])
            if note:
                print(note)
            tables = [folder / x for x in ("runs.jsonl", *TableNames(result))]
            print("Written:", ", ".join(map(str, [*tables, *figures])))
    if args.json is not None:
        records = {name: result.records for name, result in results.items()}
        WriteJson(args.json, records.get("", records))
    return max(_ExitCode(result) for result in results.values())


def _CheckOptions(args: argparse.Namespace) -> None:
    """Refuses options that exclude each other."""
    if args.shard is not None and args.json is not None:
        raise BadInput("--json: must be left out with --shard; --merge has all records")
    if args.merge is not None:
        for option in ("shard", "jobs", "resume"):
            if getattr(args, option):
                raise BadInput(f"--{option}: must be left out where parts are merged")


def StudyOf(args: argparse.Namespace) -> "Study":
    """Returns the study that is named, or one of the scenario, in no folder of its own.

    Raises:
        BadInput: If the study has an option of a scenario.
    """
    from teleop_drake.sweep.study import IsStudy, LoadStudy, Study

    metrics = args.metrics and [name.strip() for name in args.metrics.split(",")]
    if not IsStudy(args.scenario):
        return Study(plans={"": PlanOf(args)}, metrics=metrics)
    given = [name for name in _OF_A_SCENARIO if getattr(args, name)]
    for name in [*given, *(["engine"] if args.engine != "auto" else [])]:
        option = "--" + name.replace("_", "-")
        raise BadInput(f"{option}: must be left out with a study, which says it")
    return LoadStudy(args.scenario)


def PlanOf(args: argparse.Namespace) -> "SweepPlan":
    """Returns the plan of a scenario's sweep. Seeds vary fastest, then the delays."""
    from teleop_drake.scenario import CONTROLLERS, LoadScenario, ScenarioError
    from teleop_drake.sweep import PlanSweep
    from teleop_drake.tasks import TaskOf

    overrides = options.ChannelOverrides(args)
    for option in ("duration", "accuracy"):
        if getattr(args, option) is not None:
            overrides.append(f"{options.OVERRIDES[option][0]}={getattr(args, option)}")
    delays = [
        (key, getattr(args, key))
        for key in ("delay", "forward_delay", "return_delay")
        if getattr(args, key) is not None
    ]
    given = {item.partition("=")[0].strip() for item in [*args.vary, *args.set]}
    controllers = options.ControllersOf(args)
    if not controllers and not given & {"controller", "controller.kind"}:
        try:
            controllers = list(TaskOf(LoadScenario(args.scenario)).controllers)
        except ScenarioError:  # It may be good with its overrides.
            controllers = list(CONTROLLERS)
    return PlanSweep(
        args.scenario,
        options.GridOf(args, controllers, *delays),
        overrides=[*overrides, *args.set],
        engine=args.engine,
    )


def _Print(result: "SweepResult", metrics: Sequence[str]) -> None:
    """Prints how a sweep ended."""
    from teleop_drake.sweep import VariesSeedsOnly

    statuses = [record["status"] for record in result.records]
    counts = ", ".join(
        f"{statuses.count(status)} {status}"
        for status in ("completed", "diverged", "failed")
    )
    print(f"{result.scenario.name}: {len(statuses)} runs, {counts}")
    if VariesSeedsOnly(result):
        print(SeedsTable(result, metrics))


def _ExitCode(result: "SweepResult") -> int:
    """Returns the exit code of a sweep; says so if none of its runs succeeded."""
    if any(record["status"] != "failed" for record in result.records):
        return DONE
    count, first = len(result.records), result.records[0]["reason"]
    return Fail(FAILED, f"{result.scenario.name}: all {count} runs failed: {first}")


def _Draw(
    result: "SweepResult",
    names: Sequence[str],
    folder: Path,
    plan: "SweepPlan",
    formats: Sequence[str],
    is_separate: bool,
) -> tuple[list[Path], str]:
    """Draws the metrics; returns the files, or why there are none."""
    from teleop_drake.figures.runs import SaveFigure
    from teleop_drake.figures.sweeps import (
        MAX_PANELS,
        PlotMap,
        PlotSeeds,
        PlotStability,
        PlotSweep,
        SweepGrid,
    )
    from teleop_drake.sweep import VariesSeedsOnly

    metrics = list(names) or result.Metrics()
    # Over the seeds alone, there is nothing to plot a metric against.
    plot = PlotSeeds if VariesSeedsOnly(result) else PlotSweep
    try:
        grid = None if VariesSeedsOnly(result) else SweepGrid(result)
        rows, columns = grid.shape[:2] if grid else (1, 1)
        is_separate |= rows * columns * len(metrics) > MAX_PANELS
        groups: dict[str, Sequence[str]] = {"metrics": metrics} if metrics else {}
        if is_separate:
            groups = {metric.replace(".", "_"): [metric] for metric in metrics}
        figures = {name: plot(result, *group) for name, group in groups.items()}
    except ValueError as e:
        return [], f"No figures ({e})"
    note = ""
    if grid and grid.has_two_keys:
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
    """Returns what the analysis says of each panel of a map, or why it says nothing."""
    from teleop_drake.sweep.boundary import FindBoundaries

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
