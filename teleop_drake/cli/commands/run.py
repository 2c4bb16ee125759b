"""The command `teleop-drake run`."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_drake.cli.exit_codes import INTERRUPTED, BadInput
from teleop_drake.cli.options import (
    AddEngineOption,
    AddFigureOptions,
    AddHtmlOption,
    AddRunOptions,
    AddScenarioOptions,
    CheckSignals,
    FigureOptionsOf,
    FormatsOf,
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

if TYPE_CHECKING:
    from teleop_drake.recording import Recording


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    AddScenarioOptions(parser)
    AddEngineOption(parser)
    AddFigureOptions(parser)
    AddHtmlOption(parser)
    AddRunOptions(
        parser,
        json_help="write the metrics as JSON; `-`: to stdout, and nothing else there",
        out_help="write recording (.npz), figures and metrics (.json) there",
        out_default=None,
    )


def Execute(args: argparse.Namespace) -> int:
    """Simulates the scenario, writes and prints what comes out."""
    scenario = LoadToRun(args)
    CheckSignals(args, scenario)
    stem = f"{scenario.name}_{scenario.controller.kind}"
    CheckJson(args.json)
    CheckHtml(args.html)
    formats, options = FormatsOf(args), FigureOptionsOf(args)
    recording_path, summary_path, *figure_paths = PrepareFolder(
        args.out,
        *(f"{stem}.npz", f"{stem}.json"),
        *(f"{stem}.{suffix}" for suffix in formats),
    )

    from teleop_drake.tasks.metrics import RunSummary

    recording = Simulate(scenario, args.quiet, args.engine)
    record = RunSummary(recording)
    written = []
    if args.out is not None:
        recording.Save(recording_path)
        WriteText(summary_path, ToJson(record))
        written = [recording_path, *figure_paths, summary_path]
        written += _Draw(recording, figure_paths, options)
    if args.html is not None:
        recording.Animate().Save(args.html)
        written.append(args.html)
    if args.json is not None:
        WriteJson(args.json, record)
    if args.json != "-":
        print(Headline(recording))
        print(Table({record["controller"]: recording}, [record]))
        if written:
            print("Written:", ", ".join(map(str, written)))
    return INTERRUPTED if recording.termination == "interrupted" else 0


def _Draw(
    recording: "Recording", paths: Sequence[Path], options: Mapping[str, Any]
) -> list[Path]:
    """Draws a run, and its networks if it has any.

    Returns:
        The figures of the networks.

    Raises:
        BadInput: If what is to be shown is not there.
    """
    from teleop_drake.figures.network import HasNetwork, PlotNetwork
    from teleop_drake.figures.runs import PlotRun, SaveFigure

    try:
        figure = PlotRun(recording, **options)
    except (KeyError, ValueError) as e:
        raise BadInput(e) from None
    for path in paths:
        SaveFigure(figure, path)
    if not HasNetwork(recording):
        return []
    network = PlotNetwork(recording, columns=options["columns"])
    network_paths = [path.with_stem(f"{path.stem}_network") for path in paths]
    for path in network_paths:
        SaveFigure(network, path)
    return network_paths
