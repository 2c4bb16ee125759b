"""The command `teleop-drake compare`: a sweep that draws trajectories."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli import options, output
from teleop_drake.cli.exit_codes import INTERRUPTED
from teleop_drake.cli.progress import Simulate, SweepProgress
from teleop_drake.cli.tables import MAX_COLUMNS, Headline, SeedsTable, Table
from teleop_drake.loops.framework.files import FileStem
from teleop_drake.loops.framework.validation import Refuse

if TYPE_CHECKING:
    from teleop_drake.model.task_recording import TaskRecording
    from teleop_drake.study.sweep import SweepPlan


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.epilog = (
        "VALUES are START:STOP:COUNT or A,B,... in YAML. Values that are varied are "
        "those of the scenario's own controller, or with --controllers of each."
    )
    options.AddScenarioOptions(parser, has_controller=False)
    options.AddGridOptions(parser)
    options.AddEngineOption(parser)
    options.AddFigureOptions(parser)
    options.AddRunOptions(
        parser,
        json_help="write a list with the metrics of each run as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write figure (.png) and recordings (.npz) there (default: out)",
        out_default="out",
    )


def Execute(args: argparse.Namespace) -> int:
    """Compares a scenario's controllers, or values of its fields."""
    from teleop_drake.model.scenario.overrides import ParseOverrides
    from teleop_drake.model.tasks import ComparedControllers
    from teleop_drake.study.sweep import PlanSweep

    compared = ComparedControllers(options.Load(args))
    if not compared:
        allowed = "a teleoperation to compare its controllers; tracking has one only"
        Refuse("scenario", args.scenario, allowed)
    controllers = options.ControllersOf(args) or ([] if args.vary else compared)
    if args.seeds is not None:
        options.RefuseOptions(args, ("vary", "html"), "left out with --seeds")
        if args.seeds < 2:
            Refuse("--seeds", args.seeds, "2 or more")
    output.CheckJson(args.json)
    output.CheckFile(args.html, "--html", *output.HTML)
    overrides = [  # The controllers that are compared replace a given one.
        (path, value)
        for path, value in ParseOverrides(options.OverridesOf(args))
        if not controllers or path != "controller.kind"
    ]
    grid = options.GridOf(args, controllers)
    plan = PlanSweep(args.scenario, grid, overrides=overrides, engine=args.engine)
    return (_CompareRuns if args.seeds is None else _CompareOverSeeds)(args, plan)


def _CompareRuns(args: argparse.Namespace, plan: "SweepPlan") -> int:
    """Simulates each point of the grid once; writes and prints the comparison."""
    formats = options.FormatsOf(args)
    drawing = options.FigureOptionsOf(args)
    names = _Names(plan)
    scenarios = [plan.Load(point) for point in plan.points]
    for scenario in scenarios:
        options.CheckSignals(args, scenario)
    # The output files are checked before anything is simulated.
    name = scenarios[0].name
    paths = output.PrepareFolder(
        args.out,
        *(f"{name}_comparison.{suffix}" for suffix in formats),
        *(f"{name}_{stem}.npz" for stem in names),
    )
    figure_paths = paths[: len(formats)]
    recording_paths = paths[len(formats) :]

    from teleop_drake.model.tasks.metrics import RunSummary
    from teleop_drake.study.figures.runs import PlotComparison, SaveFigure

    recordings: dict[str, TaskRecording] = {}
    for scenario, label, path in zip(
        scenarios, names.values(), recording_paths, strict=True
    ):
        recordings[label] = Simulate(scenario, args.quiet, args.engine)
        recordings[label].Save(path)
        if recordings[label].termination == "interrupted":
            break
    # The figure, the page and the table show all runs, or those until an interruption.
    records = [RunSummary(recording) for recording in recordings.values()]
    shown = {label.replace("_", " "): x for label, x in recordings.items()}
    SaveFigure(PlotComparison(shown, **drawing), *figure_paths)
    if args.html is not None:
        from teleop_drake.study.figures.scene import MakeReplay

        MakeReplay(shown).Save(args.html)
    texts = [Table(recordings, records, is_verbose=args.verbose)]
    if len(recordings) <= MAX_COLUMNS:  # The rows of more runs show the endings.
        texts = [*map(Headline, recordings.values()), *texts]
    written = [*figure_paths, *recording_paths[: len(recordings)]]
    written += [args.html] if args.html is not None else []
    output.Tell(args, records, *texts, written=written)
    is_interrupted = recordings[label].termination == "interrupted"
    return INTERRUPTED if is_interrupted else 0


def _Names(plan: "SweepPlan") -> dict[str, str]:
    """Returns the label of each run, keyed by the end of the name of its files.

    If other fields vary but the controller does not, labels omit the controller, which
    the headlines show.
    """
    from teleop_drake.study.figures.labels import LabelOfValue

    has_controllers = len(plan.axes.get("controller", ())) > 1 or len(plan.axes) == 1
    names = {}
    for point in plan.points:
        stems = []
        labels = []
        for key, value in point.items():
            if key == "controller":
                stems.append(value)
                labels += [value] * has_controllers
            else:
                shown = value if isinstance(value, str) else json.dumps(value)
                stems.append(f"{key.split('.')[-1]}={shown}")
                labels.append(LabelOfValue(key, value))
        names["_".join(map(FileStem, stems))] = ", ".join(labels)
    return names


def _CompareOverSeeds(args: argparse.Namespace, plan: "SweepPlan") -> int:
    """Simulates the scenario with each controller over the same seeds."""
    stem = f"{plan.scenario.name}_seeds"
    figure_paths = output.PrepareFolder(
        args.out, *(f"{stem}.{suffix}" for suffix in options.FormatsOf(args))
    )

    from teleop_drake.study.figures.runs import SaveFigure
    from teleop_drake.study.figures.sweeps import PlotSweep
    from teleop_drake.study.sweep import Execution, RunSweep, WriteTables

    with SweepProgress(args.quiet) as show:
        result = RunSweep(plan, Execution(progress=show))
    metrics = result.Metrics()
    figure = PlotSweep(result, *metrics)
    SaveFigure(figure, *figure_paths)
    written = [*figure_paths, *WriteTables(result, Path(args.out), f"{stem}_")]
    output.Tell(args, result.records, SeedsTable(result, metrics), written=written)
    return 0
