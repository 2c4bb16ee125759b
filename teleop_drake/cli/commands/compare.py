"""The command `teleop-drake compare`."""

import argparse
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli.exit_codes import INTERRUPTED, BadInput
from teleop_drake.cli.options import (
    AddEngineOption,
    AddFigureOptions,
    AddHtmlOption,
    AddRunOptions,
    AddScenarioOptions,
    CheckSignals,
    ControllersOf,
    FigureOptionsOf,
    FormatsOf,
    Load,
    LoadToRun,
    OverridesOf,
)
from teleop_drake.cli.output import CheckHtml, CheckJson, PrepareFolder, WriteJson
from teleop_drake.cli.progress import Simulate, SweepProgress
from teleop_drake.cli.tables import Headline, SeedsTable, Table

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
        "--vary",
        metavar="PATH=VALUES",
        help="instead of controllers compare values, for example "
        "delay=0.05,0.1,0.2; with --controllers both",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        metavar="N",
        help="N runs of each, with the seeds 0 to N - 1 of the network channels: "
        "medians, shares and differences with intervals",
    )
    AddEngineOption(parser)
    AddFigureOptions(parser)
    AddHtmlOption(parser)
    AddRunOptions(
        parser,
        json_help="write a list with the metrics of each run as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write figure (.png) and recordings (.npz) there (default: out)",
        out_default="out",
    )


def Execute(args: argparse.Namespace) -> int:
    """Puts the controllers of a scenario, or values of a field, side by side."""
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
        for option in ("vary", "html"):
            value = getattr(args, option)
            if value is not None:
                raise BadInput(f"--{option} = {value!r}: must be left out with --seeds")
        return _CompareOverSeeds(args, controllers)
    return _CompareRuns(args, _Cases(args, controllers))


def _CompareRuns(args: argparse.Namespace, cases: dict[str, "_Case"]) -> int:
    """Simulates each case once and puts them side by side."""
    formats, options = FormatsOf(args), FigureOptionsOf(args)
    scenarios = {
        case.label: LoadToRun(args, *case.overrides) for case in cases.values()
    }
    for scenario in scenarios.values():
        CheckSignals(args, scenario)
    name = next(iter(scenarios.values())).name
    CheckJson(args.json)
    CheckHtml(args.html)
    paths = PrepareFolder(
        args.out,
        *(f"{name}_comparison.{suffix}" for suffix in formats),
        *(f"{name}_{stem}.npz" for stem in cases),
    )
    figure_paths, recording_paths = paths[: len(formats)], paths[len(formats) :]

    from teleop_drake.figures.runs import PlotComparison, SaveFigure
    from teleop_drake.tasks.metrics import RunSummary

    recordings: dict[str, Recording] = {}
    for (label, scenario), path in zip(scenarios.items(), recording_paths, strict=True):
        recordings[label] = Simulate(scenario, args.quiet, args.engine)
        recordings[label].Save(path)
        if recordings[label].termination == "interrupted":
            break
    records = [RunSummary(recording) for recording in recordings.values()]
    names = {label.replace("_", " "): x for label, x in recordings.items()}
    try:
        figure = PlotComparison(names, **options)
    except (KeyError, ValueError) as e:
        raise BadInput(e) from None
    for path in figure_paths:
        SaveFigure(figure, path)
    if args.html is not None:
        from teleop_drake.figures.scene import MakeReplay

        MakeReplay(names).Save(args.html)
    if args.json is not None:
        WriteJson(args.json, records)
    if args.json != "-":
        for recording in recordings.values():
            print(Headline(recording))
        print(Table(recordings, records))
        written = [*figure_paths, *recording_paths[: len(recordings)]]
        written += [args.html] if args.html is not None else []
        print("Written:", ", ".join(map(str, written)))
    is_interrupted = recordings[label].termination == "interrupted"
    return INTERRUPTED if is_interrupted else 0


@dataclass(frozen=True)
class _Case:
    """One of the runs that are compared: what it is called, and how it differs."""

    label: str
    overrides: list[str]


def _Cases(args: argparse.Namespace, controllers: list[str]) -> dict[str, _Case]:
    """Returns the runs that are compared, by the ends of the names of their files.

    A value that is varied is one of every controller; if none is asked for, of the
    scenario's own.
    """
    if args.vary is None:
        return {kind: _Case(kind, [f"controller.kind={kind}"]) for kind in controllers}
    from teleop_drake.figures.style import LabelOfValue
    from teleop_drake.scenario.tree import DumpYaml
    from teleop_drake.sweep import ALIASES, ParseValues, SweepError

    key, equals, text = args.vary.partition("=")
    key = key.strip()
    if not equals or not key:
        raise BadInput(f"--vary = {args.vary!r}: must be PATH=VALUES")
    try:
        values = ParseValues(text)
    except SweepError as e:
        raise BadInput(f"--vary {key} = {e}") from None
    cases = {}
    for kind in controllers if args.controllers is not None else [""]:
        for value in values:
            shown = (
                DumpYaml(value, default_flow_style=True).removesuffix("...\n").strip()
            )
            overrides = [f"controller.kind={kind}"] if kind else []
            overrides += [f"{path}={shown}" for path in ALIASES.get(key, (key,))]
            label = LabelOfValue(key, value)
            stem = re.sub(r"[^\w.=-]+", "_", f"{key.split('.')[-1]}={shown}")
            # What is the same of all is left to the headlines.
            named = kind if len(controllers) > 1 else ""
            cases["_".join(filter(None, [kind, stem]))] = _Case(
                ", ".join(filter(None, [named, label])), overrides
            )
    return cases


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
    figure_paths = PrepareFolder(
        args.out,
        *(f"{plan.scenario.name}_seeds.{suffix}" for suffix in FormatsOf(args)),
    )

    import numpy as np

    from teleop_drake.figures.runs import SaveFigure
    from teleop_drake.figures.sweeps import PlotSeeds
    from teleop_drake.sweep import (
        RunSweep,
        SelectMetrics,
        WriteTables,
    )

    with SweepProgress(args.quiet) as show:
        result = RunSweep(plan, progress=show)
    metrics = [
        metric
        for metric in SelectMetrics(plan.scenario)
        if np.isfinite(result.Values(metric)).any()
    ]
    figure = PlotSeeds(result, *metrics)
    for path in figure_paths:
        SaveFigure(figure, path)
    tables = WriteTables(result, Path(args.out), f"{plan.scenario.name}_seeds_")
    if args.json is not None:
        WriteJson(args.json, result.records)
    if args.json != "-":
        print(SeedsTable(result, metrics))
        print("Written:", ", ".join(map(str, [*figure_paths, *tables])))
    return 0
