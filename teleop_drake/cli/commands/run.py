"""The command `teleop-drake run`."""

import argparse

from teleop_drake.cli import options, output
from teleop_drake.cli.exit_codes import INTERRUPTED
from teleop_drake.cli.progress import Simulate
from teleop_drake.cli.tables import Headline, Table
from teleop_drake.loops.framework.files import FileStem


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    options.AddScenarioOptions(parser)
    options.AddEngineOption(parser)
    options.AddFigureOptions(parser)
    parser.add_argument(
        "--csv",
        metavar="FILE",
        help="write the signals as a table: time_s, then a column a component",
    )
    options.AddRunOptions(
        parser,
        json_help="write the metrics as JSON; `-`: to stdout, and nothing else there",
        out_help="write recording (.npz), figures and metrics (.json) there",
        out_default=None,
    )


def Execute(args: argparse.Namespace) -> int:
    """Simulates the scenario; writes and prints the results."""
    # Bad input is refused before anything is simulated.
    scenario = options.Load(args, is_run=True)
    options.CheckSignals(args, scenario)
    stem = f"{scenario.name}_{FileStem(scenario.controller.kind)}"
    output.CheckJson(args.json)
    output.CheckFile(args.html, "--html", *output.HTML)
    output.CheckFile(args.csv, "--csv")
    formats = options.FormatsOf(args)
    drawing = options.FigureOptionsOf(args)
    recording_path, summary_path, *figure_paths = output.PrepareFolder(
        args.out,
        *(f"{stem}.npz", f"{stem}.json"),
        *(f"{stem}.{suffix}" for suffix in formats),
    )

    from teleop_drake.model.tasks.metrics import RunSummary

    # Files are written on request only.
    recording = Simulate(scenario, args.quiet, args.engine)
    record = RunSummary(recording)
    written = []
    if args.out is not None:
        from teleop_drake.study.figures.network import Networks, PlotNetwork
        from teleop_drake.study.figures.runs import PlotRun, SaveFigure

        recording.Save(recording_path)
        output.WriteText(summary_path, output.ToJson(record))
        written = [recording_path, *figure_paths, summary_path]
        SaveFigure(PlotRun(recording, **drawing), *figure_paths)
        if Networks(recording):
            paths = [path.with_stem(f"{path.stem}_network") for path in figure_paths]
            SaveFigure(PlotNetwork(recording, columns=args.columns), *paths)
            written += paths
    if args.html is not None:
        from teleop_drake.study.figures.scene import MakeReplay

        MakeReplay(recording).Save(args.html)
        written.append(args.html)
    if args.csv is not None:
        recording.WriteCsv(args.csv)
        written.append(args.csv)
    runs = {record["controller"]: recording}
    table = Table(runs, [record], is_verbose=args.verbose)
    output.Tell(args, record, Headline(recording), table, written=written)
    return INTERRUPTED if recording.termination == "interrupted" else 0
