"""The command `teleop-drake compare`."""

import argparse
from typing import TYPE_CHECKING

from teleop_drake.cli.exit_codes import INTERRUPTED, BadInput
from teleop_drake.cli.options import (
    AddEngineOption,
    AddHtmlOption,
    AddRunOptions,
    AddScenarioOptions,
    ControllersOf,
    Load,
    LoadToRun,
    OverridesOf,
)
from teleop_drake.cli.output import CheckHtml, CheckJson, PrepareFolder, WriteJson
from teleop_drake.cli.progress import Simulate, SweepProgress
from teleop_drake.cli.tables import NO_INTERVALS, Headline, SeedsTable, Table

if TYPE_CHECKING:
    from teleop_drake.recording import Recording


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    AddScenarioOptions(parser, has_controller=False)
    parser.add_argument(
        "--controllers",
        metavar="A,B,...",
        help="the controllers, the baseline first; `all`: every architecture "
        "(default: the thesis's two)",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        metavar="N",
        help="N runs of each, with the seeds 0 to N - 1 of the network channels: "
        "medians, shares and differences with intervals",
    )
    AddEngineOption(parser)
    AddHtmlOption(parser)
    AddRunOptions(
        parser,
        json_help="write a list with the metrics of each run as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write figure (.png) and recordings (.npz) there (default: out)",
        out_default="out",
    )


def Execute(args: argparse.Namespace) -> int:
    """Simulates the scenario with each controller and puts them side by side."""
    from teleop_drake.tasks import TaskOf

    controllers = list(TaskOf(Load(args)).controllers)
    if not controllers:
        raise BadInput(
            f"scenario = {args.scenario!r}: must be a teleoperation to compare its "
            "controllers; tracking has one only"
        )
    if args.controllers is not None:
        controllers = ControllersOf(args.controllers)
    if args.seeds is not None:
        if args.html is not None:
            raise BadInput(f"--html = {args.html!r}: must be left out with --seeds")
        return _CompareOverSeeds(args, controllers)
    scenarios = {
        kind: LoadToRun(args, f"controller.kind={kind}") for kind in controllers
    }
    name = scenarios[controllers[0]].name
    CheckJson(args.json)
    CheckHtml(args.html)
    figure_path, *recording_paths = PrepareFolder(
        args.out, f"{name}_comparison.png", *(f"{name}_{k}.npz" for k in controllers)
    )

    from teleop_drake.figures.runs import PlotComparison, SaveFigure
    from teleop_drake.tasks.metrics import RunSummary

    recordings: dict[str, Recording] = {}
    for (kind, scenario), path in zip(scenarios.items(), recording_paths, strict=True):
        recordings[kind] = Simulate(scenario, args.quiet, args.engine)
        recordings[kind].Save(path)
        if recordings[kind].termination == "interrupted":
            break
    records = {kind: RunSummary(recording) for kind, recording in recordings.items()}
    SaveFigure(PlotComparison(recordings), figure_path)
    if args.html is not None:
        from teleop_drake.figures.scene import MakeReplay

        names = {kind.replace("_", " "): x for kind, x in recordings.items()}
        MakeReplay(names).Save(args.html)
    if args.json is not None:
        WriteJson(args.json, list(records.values()))
    if args.json != "-":
        for recording in recordings.values():
            print(Headline(recording))
        print(Table(records))
        written = [figure_path, *recording_paths[: len(recordings)]]
        written += [args.html] if args.html is not None else []
        print("Written:", ", ".join(map(str, written)))
    is_interrupted = recordings[kind].termination == "interrupted"
    return INTERRUPTED if is_interrupted else 0


def _CompareOverSeeds(args: argparse.Namespace, controllers: list[str]) -> int:
    """Simulates the scenario with each controller over the same seeds."""
    from teleop_drake.sweep import MAX_RUNS, PlanSweep, SweepError

    if not 2 <= args.seeds <= MAX_RUNS:
        raise BadInput(f"--seeds = {args.seeds}: must be 2 to {MAX_RUNS}")
    CheckJson(args.json)
    try:
        plan = PlanSweep(
            args.scenario,
            {"controller": controllers, "seed": range(args.seeds)},
            overrides=OverridesOf(args),
            engine=args.engine,
        )
    except (ValueError, SweepError) as e:  # ScenarioError is a ValueError.
        raise BadInput(e) from None
    (figure_path,) = PrepareFolder(args.out, f"{plan.scenario.name}_seeds.png")

    import numpy as np

    from teleop_drake.figures.runs import SaveFigure
    from teleop_drake.figures.sweeps import PlotSeeds
    from teleop_drake.sweep import HasIntervals, RunSweep, SelectMetrics

    with SweepProgress(args.quiet) as show:
        result = RunSweep(plan, progress=show)
    metrics = [
        metric
        for metric in SelectMetrics(plan.scenario)
        if np.isfinite(result.Values(metric)).any()
    ]
    SaveFigure(PlotSeeds(result, *metrics), figure_path)
    if args.json is not None:
        WriteJson(args.json, result.records)
    if args.json != "-":
        if not HasIntervals():
            print(NO_INTERVALS)
        print(SeedsTable(result, metrics))
        print("Written:", figure_path)
    return 0
