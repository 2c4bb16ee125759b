"""The command `teleop-drake sweep`."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_drake.cli.exit_codes import FAILED, INTERRUPTED, BadInput, Fail
from teleop_drake.cli.options import (
    OVERRIDES,
    AddEngineOption,
    AddFormatOption,
    AddRunOptions,
    AddScenarioOptions,
    ChannelOverrides,
    FormatsOf,
)
from teleop_drake.cli.output import CheckJson, WriteJson
from teleop_drake.cli.progress import SweepProgress
from teleop_drake.cli.sweeping import (
    AddSweepOptions,
    DaskExecutor,
    ExitCode,
    ReportSweep,
)

if TYPE_CHECKING:
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
    AddSweepOptions(parser)
    AddEngineOption(parser)
    AddFormatOption(parser)
    AddRunOptions(
        parser,
        json_help="write a list with the records of all runs as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write runs.jsonl, runs.csv and figures there (default: out)",
        out_default="out",
    )


# What a study says itself, by the option that says it of a scenario.
_OF_A_SCENARIO = {
    name: f"--{name.replace('_', '-')}"
    for name in (
        *("delay", "forward_delay", "return_delay", "channel", "duration", "accuracy"),
        *("set", "controllers", "vary", "seeds", "metrics"),
    )
}


def Execute(args: argparse.Namespace) -> int:
    """Simulates all runs of a sweep, or a part of them, and draws them."""
    from teleop_drake.scenario import ScenarioError
    from teleop_drake.sweep import SelectMetrics, SweepError
    from teleop_drake.sweep.study import MergeStudy, ParsePart, RunStudy

    _CheckOptions(args)
    CheckJson(args.json)
    formats = FormatsOf(args)
    num_finished = num_runs = 0

    def Notice(text: str) -> None:
        print(f"teleop-drake: {text}", file=sys.stderr)

    try:
        part = None if args.shard is None else ParsePart(args.shard)
        study = _Study(args)
        metrics = {
            name: SelectMetrics(plan.scenario, study.metrics) if study.metrics else []
            for name, plan in study.plans.items()
        }
        if args.merge is not None:
            results = MergeStudy(study, args.out, args.merge, notice=Notice)
        else:
            with (
                DaskExecutor(args.dask, args.quiet) as executor,
                SweepProgress(args.quiet) as show,
            ):

                def Report(finished: int, runs: int) -> None:
                    nonlocal num_finished, num_runs
                    num_finished, num_runs = finished, runs
                    show(finished, runs)

                results = RunStudy(
                    study,
                    args.out,
                    part=part,
                    executor=executor,
                    jobs=args.jobs,
                    resume=args.resume,
                    progress=Report,
                    notice=Notice,
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
    is_silent = args.json == "-"
    if part is not None:
        if not is_silent:
            print(f"Part {args.shard} is done. When all are: --merge {args.out}")
        return 0
    for name, result in results.items():
        ReportSweep(
            result,
            study.plans[name],
            metrics[name],
            Path(args.out, name),
            is_silent=is_silent,
            is_separate=args.separate,
            formats=formats,
        )
    if args.json is not None:
        records = {name: result.records for name, result in results.items()}
        WriteJson(args.json, records.get("", records))
    return max(ExitCode(result) for result in results.values())


def _CheckOptions(args: argparse.Namespace) -> None:
    """Refuses options that exclude each other."""
    if args.jobs is not None and args.dask is not None:
        raise BadInput("--jobs: must be left out with --dask, which has workers")
    if args.shard is not None and args.json is not None:
        raise BadInput("--json: must be left out with --shard; --merge has all records")
    if args.merge is not None:
        for option in ("shard", "jobs", "dask", "resume"):
            if getattr(args, option):
                raise BadInput(f"--{option}: must be left out where parts are merged")


def _Study(args: argparse.Namespace) -> "Study":
    """Returns the study that is named, or one of the scenario, in no folder of its own.

    Raises:
        BadInput: If the study has an option of a scenario.
    """
    from teleop_drake.sweep import PlanSweep
    from teleop_drake.sweep.study import IsStudy, LoadStudy, Study

    if IsStudy(args.scenario):
        given = [x for name, x in _OF_A_SCENARIO.items() if getattr(args, name)]
        if args.engine != "auto":
            given.append("--engine")
        for option in given:
            raise BadInput(f"{option}: must be left out with a study, which says it")
        return LoadStudy(args.scenario)
    grid, overrides = Grid(args)
    plan = PlanSweep(args.scenario, grid, overrides=overrides, engine=args.engine)
    metrics = args.metrics and [name.strip() for name in args.metrics.split(",")]
    return Study(plans={"": plan}, metrics=metrics)


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
