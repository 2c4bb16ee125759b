"""The command `teleop-drake run`."""

import argparse

from teleop_drake.cli.exit_codes import INTERRUPTED
from teleop_drake.cli.options import (
    AddEngineOption,
    AddHtmlOption,
    AddRunOptions,
    AddScenarioOptions,
    LoadToRun,
)
from teleop_drake.cli.output import (
    CheckHtml,
    CheckJson,
    PrepareFolder,
    ToJson,
    WriteJson,
    WriteText,
)
from teleop_drake.cli.progress import Simulate
from teleop_drake.cli.tables import Headline, Table


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    AddScenarioOptions(parser)
    AddEngineOption(parser)
    AddHtmlOption(parser)
    AddRunOptions(
        parser,
        json_help="write the metrics as JSON; `-`: to stdout, and nothing else there",
        out_help="write recording (.npz), figure (.png) and metrics (.json) there",
        out_default=None,
    )


def Execute(args: argparse.Namespace) -> int:
    """Simulates the scenario, writes and prints what comes out."""
    scenario = LoadToRun(args)
    stem = f"{scenario.name}_{scenario.controller.kind}"
    CheckJson(args.json)
    CheckHtml(args.html)
    recording_path, figure_path, summary_path = PrepareFolder(
        args.out, f"{stem}.npz", f"{stem}.png", f"{stem}.json"
    )

    from teleop_drake.tasks.metrics import RunSummary

    recording = Simulate(scenario, args.quiet, args.engine)
    record = RunSummary(recording)
    written = []
    if args.out is not None:
        from teleop_drake.figures.runs import PlotRun, SaveFigure

        recording.Save(recording_path)
        SaveFigure(PlotRun(recording), figure_path)
        WriteText(summary_path, ToJson(record))
        written = [recording_path, figure_path, summary_path]
    if args.html is not None:
        recording.Animate().Save(args.html)
        written.append(args.html)
    if args.json is not None:
        WriteJson(args.json, record)
    if args.json != "-":
        print(Headline(recording))
        print(Table({record["controller"]: record}))
        if written:
            print("Written:", ", ".join(map(str, written)))
    return INTERRUPTED if recording.termination == "interrupted" else 0
