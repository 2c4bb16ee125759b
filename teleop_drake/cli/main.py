"""The command `teleop-drake`.

Exit codes: 0 done; 1 could not draw or write; 2 bad input, with one line on stderr
that names the field, the value and what is allowed; 130 interrupted, with what there
was by then.

Drake, numpy and matplotlib are imported by the commands that need them: help and bad
options cost no second.
"""

import argparse
import codecs
import io
import json
import math
import os
import sys
import time
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_drake.files import IsDevice, Replacing, TemporaryPath

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from teleop_drake.recording import Recording
    from teleop_drake.scenario import AnyScenario
    from teleop_drake.sweep import SweepResult

_INTERRUPTED = 130

# Below this, in rad/s, nobody asks whether a mode is neutral.
_LEAST_UNRESOLVED = 1e-3

# More stable intervals than this do not fit a table; JSON has all.
_MAX_INTERVALS = 3

# Options that stand for fields of the scenario. `--set` comes after them.
_OVERRIDES = {
    "controller": ["controller.kind"],
    "delay": ["forward_channel.delay", "return_channel.delay"],
    "forward_delay": ["forward_channel.delay"],
    "return_delay": ["return_channel.delay"],
    "duration": ["duration"],
    "accuracy": ["simulator.accuracy"],
}

# Unit of each metric of RunSummary, by the last part of its name.
_UNITS = {
    "start_velocity_overshoot": "m/s",
    "time": "s",
    "velocity": "m/s",
    "force": "N",
    "velocity_overshoot": "m/s",
    "initial_impact_force": "N",
    "peak_force": "N",
    "rebound_velocity": "m/s",
    "settling_time": "s",
    "velocity_rms_error": "m/s",
    "force_rms_error": "N",
    "control_force_peak": "N",
    "control_force_variation": "N",
    "diverged_at": "s",
    "max_error": "m",
    "rms_error": "m",
    "disturbance_rms_error": "N",
    "wall_time_s": "s",
}


class _BadInput(Exception):
    """Its text is the one line that the user gets to see."""


class _Parser(argparse.ArgumentParser):
    """Reports a bad option on one line, without the usage."""

    def error(self, message: str) -> typing.NoReturn:
        raise _BadInput(message)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command `teleop-drake` and returns its exit code.

    Args:
        argv: The arguments after the command's name; None: those of the process.
    """
    _PrepareStreams()
    if sys.stdout is None:
        return _Fail(1, "standard output is closed")
    try:
        args = _MakeParser().parse_args(argv)
        exit_code = args.command(args)
        sys.stdout.flush()
        return exit_code
    except _BadInput as e:
        return _Fail(2, e)
    except KeyboardInterrupt:
        return _Fail(_INTERRUPTED, "interrupted")
    except BrokenPipeError:
        # The reader, `head` perhaps, has seen enough. Python would complain when it
        # flushes stdout at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as e:  # The disk is full, say: all else was checked beforehand.
        return _Fail(1, e)


def _PrepareStreams() -> None:
    """Makes sure that all can be printed, whatever stdout and stderr are."""
    if sys.stderr is None:  # Closed: print() would take stdout instead.
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    codecs.register_error("teleop-drake", _InAscii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="teleop-drake")


def _InAscii(error: UnicodeError) -> tuple[str | bytes, int]:
    """Returns what is printed instead of characters that a stream does not know."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text, end = codecs.backslashreplace_errors(error)
    return (text.replace(r"\xb1", "+-") if isinstance(text, str) else text), end


def _Fail(exit_code: int, message: object) -> int:
    line = " ".join(str(message).split())
    print(f"teleop-drake: error: {line}", file=sys.stderr)
    return exit_code


def _MakeParser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="teleop-drake",
        description="Haptic teleoperation under communication delay.",
        epilog="`teleop-drake COMMAND --help` has the options of a command.",
        allow_abbrev=False,
    )
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", required=True, dest="command_name"
    )

    def add(
        name: str,
        command: Callable[[argparse.Namespace], int],
        summary: str,
        epilog: str | None = None,
    ) -> argparse.ArgumentParser:
        subparser = commands.add_parser(
            name, help=summary, description=summary, epilog=epilog, allow_abbrev=False
        )
        subparser.set_defaults(command=command)
        return subparser

    add("list", _List, "List the built-in scenarios, the controllers and the robots.")

    show = add("show", _Show, "Print the resolved scenario as YAML.")
    _AddScenarioOptions(show)

    run = add("run", _Run, "Simulate a scenario and print its metrics.")
    _AddScenarioOptions(run)
    _AddRunOptions(
        run,
        json_help="write the metrics as JSON; `-`: to stdout, and nothing else there",
        out_help="write recording (.npz), figure (.png) and metrics (.json) there",
        out_default=None,
    )

    compare = add("compare", _Compare, "Compare controllers: a table and a figure.")
    _AddScenarioOptions(compare, has_controller=False)
    compare.add_argument(
        "--controllers",
        metavar="A,B,...",
        help="the controllers, the baseline first; `all`: every architecture "
        "(default: the thesis's two)",
    )
    _AddRunOptions(
        compare,
        json_help="write a list with the metrics of each run as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write figure (.png) and recordings (.npz) there (default: out)",
        out_default="out",
    )

    sweep = add(
        "sweep",
        _Sweep,
        "Simulate a scenario for many delays, controllers and other values.",
        epilog="VALUES are START:STOP:COUNT or A,B,... in YAML. A sweep that was "
        "interrupted, or killed, goes on with --resume.",
    )
    _AddScenarioOptions(sweep, has_controller=False, is_sweep=True)
    sweep.add_argument(
        "--controllers",
        metavar="A,B,...",
        help="controller.kind; `all`: every architecture (default: the thesis's two)",
    )
    sweep.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="PATH=VALUES",
        help="values of any other field, for example "
        "environment.layers.bone.stiffness=100:400:7; repeatable",
    )
    sweep.add_argument(
        "--seeds",
        type=int,
        metavar="N",
        help="N runs of each, with the seeds 0 to N - 1 of both network channels",
    )
    sweep.add_argument(
        "--metrics",
        metavar="A,B,...",
        help="metrics to draw, for example collision.peak_force or a whole group such "
        "as puncture (default: a few; runs.csv has all)",
    )
    sweep.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help="processes that simulate (default: one per processor)",
    )
    sweep.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="simulate on the cluster of this Dask scheduler instead, for example "
        "tcp://host:8786",
    )
    sweep.add_argument(
        "--resume", action="store_true", help="do only what is missing in --out"
    )
    _AddRunOptions(
        sweep,
        json_help="write a list with the records of all runs as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write runs.jsonl, runs.csv and figures (.png) there (default: out)",
        out_default="out",
    )

    analyze = add(
        "analyze",
        _Analyze,
        "Find the delays at which the loop is stable, and why it fails at others.",
        epilog="All delays found are round trips: forward and return delay together, "
        "of which only the sum matters.",
    )
    _AddScenarioOptions(analyze)
    analyze.add_argument(
        "--max-delay",
        metavar="S",
        help="longest round-trip delay to report on, s (default: 2)",
    )
    analyze.add_argument(
        "--vary",
        metavar="PATH=START:STOP:COUNT",
        help="chart the stable delays over a number of the scenario, for example "
        "environment.layers.bone.stiffness=10:400:40, or over the position of the tool "
        "along x, position=0.86:1.2:35",
    )
    _AddRunOptions(
        analyze,
        json_help="write the margins as JSON; `-`: to stdout, and nothing else there",
        out_help="write Bode, Nyquist, stability and transparency plots (.png) and "
        "margins (.json) there",
        out_default=None,
    )

    diagram = add("diagram", _Diagram, "Draw the block diagram of a scenario.")
    _AddScenarioOptions(diagram)
    diagram.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="FILE.svg, .png, .pdf or .dot (default: DOT text to stdout)",
    )
    diagram.add_argument(
        "--depth",
        type=int,
        default=1,
        metavar="N",
        help="levels of nested diagrams to open (default: 1, the loop)",
    )

    reproduce = add(
        "reproduce",
        _Reproduce,
        "Simulate the thesis again: its figures, a ledger of its claims, a report.",
    )
    reproduce.add_argument(
        "--out",
        metavar="DIR",
        default="out",
        help="write figures (.png and .svg), ledger (.json and .csv) and report.html "
        "there (default: out)",
    )
    reproduce.add_argument(
        "--only",
        metavar="A,B,...",
        help="only these figures, for example 4.1,5.7: no ledger and no report",
    )
    reproduce.add_argument(
        "--jobs",
        type=int,
        default=2,
        metavar="N",
        help="processes that simulate (default: 2)",
    )
    reproduce.add_argument("--quiet", action="store_true", help="show no progress")
    return parser


def _AddScenarioOptions(
    parser: argparse.ArgumentParser,
    *,
    has_controller: bool = True,
    is_sweep: bool = False,
) -> None:
    parser.add_argument(
        "scenario", metavar="SCENARIO", help="a built-in name or a YAML file"
    )
    delay = "VALUES" if is_sweep else "S"
    if has_controller:
        parser.add_argument("--controller", metavar="KIND", help="controller.kind")
    parser.add_argument("--delay", metavar=delay, help="delay each way, s")
    parser.add_argument("--forward-delay", metavar=delay, help="forward delay, s")
    parser.add_argument("--return-delay", metavar=delay, help="return delay, s")
    parser.add_argument("--duration", metavar="S", help="simulated time, s")
    parser.add_argument("--accuracy", metavar="X", help="simulator.accuracy")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PATH=VALUE",
        help="any other field, for example environment.layers.bone.stiffness=300; "
        "repeatable; later ones win",
    )


def _AddRunOptions(
    parser: argparse.ArgumentParser,
    *,
    json_help: str,
    out_help: str,
    out_default: str | None,
) -> None:
    parser.add_argument("--json", metavar="FILE", help=json_help)
    parser.add_argument("--out", metavar="DIR", default=out_default, help=out_help)
    parser.add_argument("--quiet", action="store_true", help="show no progress")


# Commands.


def _List(args: argparse.Namespace) -> int:
    from teleop_drake.robots import RobotModels
    from teleop_drake.scenario import (
        ARCHITECTURES,
        CONTROLLERS,
        TRACKING_CONTROLLERS,
        LoadScenario,
        ScenarioNames,
    )

    print("Scenarios")
    width = max(map(len, ScenarioNames()))
    for name in ScenarioNames():
        print(f"  {name:<{width}} {' '.join(LoadScenario(name).description.split())}")
    print("Controllers\n  " + ", ".join(CONTROLLERS + TRACKING_CONTROLLERS))
    others = [kind for kind in ARCHITECTURES if kind not in CONTROLLERS]
    print("Other architectures\n  " + ", ".join(others))
    print("Robots\n  " + ", ".join(RobotModels()))
    return 0


def _Show(args: argparse.Namespace) -> int:
    from teleop_drake.scenario import ScenarioToYaml

    print(ScenarioToYaml(_Load(args)), end="")
    return 0


def _Run(args: argparse.Namespace) -> int:
    scenario = _LoadToRun(args)
    stem = f"{scenario.name}_{scenario.controller.kind}"
    _CheckJson(args.json)
    recording_path, figure_path, summary_path = _PrepareFolder(
        args.out, f"{stem}.npz", f"{stem}.png", f"{stem}.json"
    )

    from teleop_drake.tasks.metrics import RunSummary

    recording = _Simulate(scenario, args.quiet)
    record = RunSummary(recording)
    if args.out is not None:
        from teleop_drake.figures.runs import PlotRun, SaveFigure

        recording.Save(recording_path)
        SaveFigure(PlotRun(recording), figure_path)
        _WriteText(summary_path, _ToJson(record))
    if args.json is not None:
        _WriteJson(args.json, record)
    if args.json != "-":
        print(_Headline(recording))
        print(_Table({record["controller"]: record}))
        if args.out is not None:
            print(f"Written: {recording_path}, {figure_path}, {summary_path}")
    return _INTERRUPTED if recording.termination == "interrupted" else 0


def _Compare(args: argparse.Namespace) -> int:
    from teleop_drake.scenario import ARCHITECTURES, CONTROLLERS, Scenario

    if not isinstance(_Load(args), Scenario):
        raise _BadInput(
            f"scenario = {args.scenario!r}: must be a teleoperation to compare its "
            "controllers; tracking has one only"
        )
    controllers = list(CONTROLLERS)
    if args.controllers == "all":
        controllers = list(ARCHITECTURES)
    elif args.controllers is not None:
        controllers = [name.strip() for name in args.controllers.split(",")]
        if len(set(controllers)) < len(controllers):
            raise _BadInput(
                f"--controllers = {args.controllers!r}: must be different controllers"
            )
    scenarios = {
        kind: _LoadToRun(args, f"controller.kind={kind}") for kind in controllers
    }
    name = scenarios[controllers[0]].name
    _CheckJson(args.json)
    figure_path, *recording_paths = _PrepareFolder(
        args.out, f"{name}_comparison.png", *(f"{name}_{k}.npz" for k in controllers)
    )

    from teleop_drake.figures.runs import PlotComparison, SaveFigure
    from teleop_drake.tasks.metrics import RunSummary

    recordings: dict[str, Recording] = {}
    for (kind, scenario), path in zip(scenarios.items(), recording_paths, strict=True):
        recordings[kind] = _Simulate(scenario, args.quiet)
        recordings[kind].Save(path)
        if recordings[kind].termination == "interrupted":
            break
    records = {kind: RunSummary(recording) for kind, recording in recordings.items()}
    SaveFigure(PlotComparison(recordings), figure_path)
    if args.json is not None:
        _WriteJson(args.json, list(records.values()))
    if args.json != "-":
        for recording in recordings.values():
            print(_Headline(recording))
        print(_Table(records))
        written = [figure_path, *recording_paths[: len(recordings)]]
        print("Written:", ", ".join(map(str, written)))
    is_interrupted = recordings[kind].termination == "interrupted"
    return _INTERRUPTED if is_interrupted else 0


def _Sweep(args: argparse.Namespace) -> int:
    from teleop_drake.scenario import ScenarioError
    from teleop_drake.sweep import PlanSweep, RunSweep, SelectMetrics, SweepError

    if args.jobs is not None and args.dask is not None:
        raise _BadInput("--jobs: must be left out with --dask, which has workers")
    _CheckJson(args.json)
    num_finished = num_runs = 0
    try:
        grid, overrides = _Grid(args)
        plan = PlanSweep(args.scenario, grid, overrides=overrides)
        metrics = []
        if args.metrics is not None:
            names = [name.strip() for name in args.metrics.split(",")]
            metrics = SelectMetrics(plan.scenario, names)
        with (
            _DaskExecutor(args.dask, args.quiet) as executor,
            _SweepProgress(args.quiet) as show,
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
        raise _BadInput(e) from None
    except RuntimeError as e:  # The executor gave up.
        return _Fail(1, f"{e}; --resume does the rest")
    except KeyboardInterrupt:
        return _Fail(
            _INTERRUPTED,
            f"interrupted; {num_finished} of {num_runs} runs are in {args.out}, "
            "--resume does the rest",
        )
    figures, note = _DrawSweep(result, metrics, Path(args.out))
    if args.json is not None:
        _WriteJson(args.json, result.records)
    if args.json != "-":
        statuses = [record["status"] for record in result.records]
        counts = ", ".join(
            f"{statuses.count(status)} {status}"
            for status in ("completed", "diverged", "failed")
        )
        print(f"{plan.scenario.name}: {len(statuses)} runs, {counts}")
        if note:
            print(note)
        written = [Path(args.out) / "runs.jsonl", Path(args.out) / "runs.csv", *figures]
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


def _Grid(args: argparse.Namespace) -> tuple[dict[str, list[Any]], list[str]]:
    """Returns the grid of a sweep and the overrides for all its runs.

    Seeds vary fastest, then the delays.
    """
    from teleop_drake.scenario import (
        ARCHITECTURES,
        CONTROLLERS,
        LoadScenario,
        Scenario,
        ScenarioError,
    )
    from teleop_drake.sweep import MAX_RUNS, ParseValues, SweepError

    def Parse(option: str, text: str) -> list[Any]:
        try:
            return ParseValues(text)
        except SweepError as e:
            raise _BadInput(f"{option} = {e}") from None

    overrides = [
        f"{path}={getattr(args, option)}"
        for option in ("duration", "accuracy")
        if getattr(args, option) is not None
        for path in _OVERRIDES[option]
    ] + args.set
    grid: dict[str, list[Any]] = {}
    for item in args.vary:
        path, equals, text = item.partition("=")
        path = path.strip()
        if not equals or not path:
            raise _BadInput(f"--vary = {item!r}: must be PATH=VALUES")
        if path in grid or getattr(args, _GRID_OPTIONS.get(path, ""), None):
            raise _BadInput(f"--vary = {item!r}: must vary what no other option does")
        grid[path] = Parse(f"--vary {path}", text)
    for key in ("delay", "forward_delay", "return_delay"):
        text = getattr(args, key)
        if text is not None:
            grid[key] = Parse(f"--{key.replace('_', '-')}", text)

    if args.seeds is not None:
        if not 1 <= args.seeds <= MAX_RUNS:
            raise _BadInput(f"--seeds = {args.seeds}: must be 1 to {MAX_RUNS}")
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
            is_teleoperation = isinstance(LoadScenario(args.scenario), Scenario)
        except ScenarioError:  # It may be good with its overrides.
            is_teleoperation = True
        controllers = list(CONTROLLERS) if is_teleoperation else []
    return ({"controller": controllers} if controllers else {}) | grid, overrides


def _Analyze(args: argparse.Namespace) -> int:
    from teleop_drake.analysis.stability import (
        MAX_DELAY,
        AnalyzeStability,
        ChartStability,
    )
    from teleop_drake.analysis.transparency import AnalyzeTransparency

    scenario = _Load(args)
    max_delay = MAX_DELAY
    if args.max_delay is not None:
        try:
            max_delay = float(args.max_delay)
        except ValueError:
            max_delay = math.nan
        if not 0 < max_delay < math.inf:
            raise _BadInput(
                f"--max-delay = {args.max_delay!r}: must be a finite number > 0 (s)"
            )
    key, values = _VariedNumber(args.vary)
    _CheckJson(args.json)
    stem = f"{scenario.name}_{scenario.controller.kind}"
    figures = ["bode", "nyquist", "stable_delays", "transparency"]
    figures += ["chart"] * bool(key)
    *figure_paths, summary_path = _PrepareFolder(
        args.out, *(f"{stem}_{name}.png" for name in figures), f"{stem}_analysis.json"
    )
    chart = None
    try:
        analysis = AnalyzeStability(scenario, max_delay=max_delay)
        transparency = [
            AnalyzeTransparency(
                analysis.scenario,
                point.model.point,
                forward_delay=analysis.forward_delay,
                return_delay=analysis.return_delay,
            )
            for point in analysis.points
        ]
        if key:
            with _SweepProgress(args.quiet, "values") as show:
                chart = ChartStability(
                    args.scenario,
                    key,
                    values,
                    overrides=_OverridesOf(args),
                    max_delay=max_delay,
                    progress=show,
                )
    except ValueError as e:
        raise _BadInput(e) from None
    record = analysis.ToRecord()
    record["transparency"] = [point.ToRecord() for point in transparency]
    if chart is not None:
        record["chart"] = chart.ToRecord()
    if args.out is not None:
        from teleop_drake.figures.analysis import (
            PlotBode,
            PlotNyquist,
            PlotStabilityChart,
            PlotStableDelays,
            PlotTransparency,
        )
        from teleop_drake.figures.runs import SaveFigure

        made = [
            PlotBode(analysis),
            PlotNyquist(analysis),
            PlotStableDelays(analysis),
            PlotTransparency(transparency),
        ]
        if chart is not None:
            made.append(PlotStabilityChart(chart))
        for figure, path in zip(made, figure_paths, strict=True):
            SaveFigure(figure, path)
        _WriteText(summary_path, _ToJson(record))
    if args.json is not None:
        _WriteJson(args.json, record)
    if args.json != "-":
        print(_AnalysisTable(record))
        if chart is not None:
            print()
            print(_ChartTable(record["chart"]))
        if args.out is not None:
            written = [*figure_paths, summary_path]
            print("Written:", ", ".join(map(str, written)))
    return 0


def _VariedNumber(item: str | None) -> tuple[str, list[float]]:
    """Returns the key and the values of `analyze --vary`; without it, no key."""
    from teleop_drake.sweep import ParseValues, SweepError

    if item is None:
        return "", []
    path, equals, text = item.partition("=")
    if not equals or not path.strip():
        raise _BadInput(f"--vary = {item!r}: must be PATH=START:STOP:COUNT")
    try:
        values = ParseValues(text)
    except SweepError as e:
        raise _BadInput(f"--vary {path.strip()} = {e}") from None
    if not all(isinstance(x, int | float) and math.isfinite(x) for x in values):
        raise _BadInput(f"--vary {path.strip()} = {text!r}: must be finite numbers")
    if len(set(values)) < 2:
        raise _BadInput(f"--vary {path.strip()} = {text!r}: must be two values or more")
    return path.strip(), [float(x) for x in values]


def _Diagram(args: argparse.Namespace) -> int:
    if args.depth < 0:
        raise _BadInput(f"--depth = {args.depth}: must be 0 or positive")
    scenario = _Load(args)

    from teleop_drake.figures.block_diagram import DiagramDot, WriteDiagram
    from teleop_drake.simulation import MakeDiagram

    diagram = MakeDiagram(scenario)
    if args.output is None:
        print(DiagramDot(diagram, max_depth=args.depth), end="")
        return 0
    try:
        WriteDiagram(diagram, args.output, max_depth=args.depth)
    except (ValueError, OSError) as e:
        raise _BadInput(f"--output: {e}") from None
    except RuntimeError as e:
        # Nothing here can lay out a diagram; the message says what to install.
        return _Fail(1, e)
    return 0


def _Reproduce(args: argparse.Namespace) -> int:
    if args.jobs < 1:
        raise _BadInput(f"--jobs = {args.jobs}: must be 1 or more")

    from teleop_drake.thesis.report import Reproduce, SelectFigures

    only = None
    if args.only is not None:
        only = [number.strip() for number in args.only.split(",")]
    try:
        SelectFigures(only)
    except ValueError as e:
        raise _BadInput(f"--only: {e}") from None
    _PrepareFolder(args.out, "report.html")

    def Report(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    try:
        paths = Reproduce(
            Path(args.out),
            only=only,
            jobs=args.jobs,
            progress=None if args.quiet else Report,
        )
    except RuntimeError as e:
        # Nothing here can lay out a diagram; the message says what to install.
        return _Fail(1, e)
    print(f"Written: {len(paths)} files in {args.out}, the last is {paths[-1].name}")
    return 0


def _Load(args: argparse.Namespace, *more: str) -> "AnyScenario":
    """Returns the scenario with all overrides of the command line and `more`."""
    from teleop_drake.architectures import CheckArchitecture
    from teleop_drake.scenario import LoadScenario, Scenario

    try:
        scenario = LoadScenario(args.scenario, [*_OverridesOf(args), *more])
        if isinstance(scenario, Scenario):
            CheckArchitecture(scenario)
    except ValueError as e:  # ScenarioError is one.
        raise _BadInput(e) from None
    return scenario


def _LoadToRun(args: argparse.Namespace, *more: str) -> "AnyScenario":
    """Returns the scenario as _Load does, if it can be simulated in acceptable time."""
    from teleop_drake.scenario import CheckSteps

    scenario = _Load(args, *more)
    try:
        CheckSteps(scenario)
    except ValueError as e:
        raise _BadInput(e) from None
    return scenario


def _OverridesOf(args: argparse.Namespace) -> list[str]:
    """Returns the overrides of the command line as PATH=VALUE."""
    overrides = []
    for option, paths in _OVERRIDES.items():
        value = getattr(args, option, None)
        if value is not None:
            overrides += [f"{path}={value}" for path in paths]
    return [*overrides, *args.set]


# Simulating.


def _Simulate(scenario: "AnyScenario", is_quiet: bool) -> "Recording":
    from teleop_drake.simulation import simulate

    if is_quiet:
        return simulate(scenario)
    with _Progress(scenario) as progress:
        return simulate(scenario, progress=progress)


@contextmanager
def _Progress(scenario: "AnyScenario") -> Iterator[Callable[[float], None]]:
    """Yields a function that shows the simulated time on stderr.

    It begins after 2 s of real time. A terminal gets one line that changes, a file
    gets a line every 10 s.
    """
    is_terminal = sys.stderr.isatty()
    period = 0.2 if is_terminal else 10.0
    next_report = time.monotonic() + 2.0
    is_shown = False

    def Report(simulated_time: float) -> None:
        nonlocal next_report, is_shown
        if time.monotonic() < next_report:
            return
        next_report = time.monotonic() + period
        is_shown = True
        text = (
            f"{scenario.name}, {scenario.controller.kind}: "
            f"{simulated_time:.1f} of {scenario.duration:g} s"
        )
        print(
            f"\r{text}" if is_terminal else text,
            end="" if is_terminal else "\n",
            file=sys.stderr,
            flush=True,
        )

    try:
        yield Report
    finally:
        if is_shown and is_terminal:
            print(file=sys.stderr)


@contextmanager
def _SweepProgress(
    is_quiet: bool, what: str = "runs"
) -> Iterator[Callable[[int, int], None]]:
    """Yields a function that shows the finished runs and the time left on stderr.

    A terminal gets one line that changes, a file gets a line every 10 s.
    """
    is_terminal = sys.stderr.isatty()
    start = time.monotonic()
    next_report = start if is_terminal else start + 10.0
    num_before: int | None = None

    def Report(num_finished: int, num_runs: int) -> None:
        nonlocal num_before, next_report
        now = time.monotonic()
        if num_before is None:  # What an earlier, interrupted sweep has done.
            num_before = num_finished
        if is_quiet or now < next_report:
            return
        next_report = now + (0.2 if is_terminal else 10.0)
        text = f"{num_finished} of {num_runs} {what}"
        if num_finished > num_before:
            seconds_each = (now - start) / (num_finished - num_before)
            left = timedelta(seconds=round(seconds_each * (num_runs - num_finished)))
            text += f", {left} left"
        print(
            f"\r{text:<50}" if is_terminal else text,
            end="" if is_terminal else "\n",
            file=sys.stderr,
            flush=True,
        )

    try:
        yield Report
    finally:
        if is_terminal and not is_quiet and num_before is not None:
            print(file=sys.stderr)


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
        raise _BadInput(
            f"--dask = {address!r}: must be left out, or the package distributed "
            "installed (pip install 'teleop-drake[dask]')"
        ) from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as e:
        raise _BadInput(
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
    result: "SweepResult", names: Sequence[str], folder: Path
) -> tuple[list[Path], str]:
    """Draws the metrics; returns the files, or why there are none.

    Args:
        result: The sweep.
        names: The metrics; empty: some, of those that any run has.
        folder: Where to.
    """
    import numpy as np

    from teleop_drake.figures.runs import SaveFigure
    from teleop_drake.figures.sweeps import PlotStability, PlotSweep
    from teleop_drake.sweep import SelectMetrics

    metrics = list(names) or [
        metric
        for metric in SelectMetrics(result.scenario)
        if np.isfinite(result.Values(metric)).any()
    ]
    figures = {}
    try:
        for metric in metrics:
            figures[metric.replace(".", "_")] = PlotSweep(result, metric)
    except ValueError as e:
        return [], f"No figures ({e})"
    with suppress(ValueError):  # Only one key is varied.
        figures["stability"] = PlotStability(result)
    for name, figure in figures.items():
        SaveFigure(figure, folder / f"{name}.png")
    return [folder / f"{name}.png" for name in figures], ""


# Showing.


def _Headline(recording: "Recording") -> str:
    from teleop_drake.scenario import Scenario

    scenario = recording.scenario
    line = f"{scenario.name}, {scenario.controller.kind}: "
    if isinstance(scenario, Scenario):
        line += (
            f"delay {scenario.forward_channel.delay:g} s forward, "
            f"{scenario.return_channel.delay:g} s back, "
        )
    line += f"{recording.time[-1]:g} s simulated, {recording.termination}"
    return f"{line} ({recording.reason})" if recording.reason else line


def _Table(records: Mapping[str, Mapping[str, Any]]) -> str:
    """Returns the metrics of some runs: a row for each, a column for each run."""
    from teleop_drake.sweep import CHANNEL_METRICS, FlattenMetrics

    units = _UNITS | CHANNEL_METRICS
    columns = {
        name: FlattenMetrics(record["metrics"])
        | FlattenMetrics(record.get("channels", {}))
        | {
            key: record["solver"][key]
            for key in ("steps", "derivative_evaluations", "wall_time_s")
        }
        for name, record in records.items()
    }
    # A group such as `puncture` is null where there was none.
    rows: dict[str, None] = {}
    for column in columns.values():
        rows |= dict.fromkeys(column)
    groups = {row.split(".")[0] for row in rows if "." in row}
    lines = [["", *columns, ""]]
    for row in rows:
        if row in groups:
            continue
        cells = [_Cell(column.get(row)) for column in columns.values()]
        unit = next((units[part] for part in row.split(".") if part in units), "")
        lines.append([row.replace("_", " ").replace(".", " "), *cells, unit])
    return _Align(lines)


def _AnalysisTable(record: Mapping[str, Any]) -> str:
    """Returns the margins of `analyze`: a row for each operating point."""
    points = record["operating_points"]
    delay = record["forward_delay"] + record["return_delay"]
    lines = [
        [
            "",
            "x [m]",
            "crossovers [rad/s]",
            "phase margin [deg]",
            "delay margin [s]",
            "stable delays [s]",
            f"root at {delay:g} s [1/s]",
            "",
        ]
    ]
    for point in points:
        intervals = [
            f"{begin:.4g}-{end:.4g}" + ("+" if end == record["max_delay"] else "")
            for begin, end in point["stable_delays"]
        ]
        if len(intervals) > _MAX_INTERVALS:
            intervals = [*intervals[:_MAX_INTERVALS], "..."]
        phase, root = point["phase_margin"], point["rightmost_root"]
        lines.append(
            [
                point["name"],
                f"{point['position'][0]:.5g}",
                ", ".join(f"{w:.4g}" for w in point["gain_crossovers"] if w) or "-",
                "-" if phase is None else f"{math.degrees(phase):.1f}",
                _Cell(point["delay_margin"]),
                ", ".join(intervals) or "none",
                "-" if root is None else _Root(*root),
                ("stable" if point["stable"] else "UNSTABLE")
                + ("" if point["certain"] else ", uncertain"),
            ]
        )
    text = [
        f"{record['scenario']}, {record['controller']}: delay "
        f"{record['forward_delay']:.6g} s forward, {record['return_delay']:.6g} s "
        f"back; round-trip delays up to {record['max_delay']:g} s",
        _Align(lines),
    ]
    text += _Verdict(points, delay)
    text += _Certainty(points)
    if all(point["absolutely_stable"] is not None for point in record["transparency"]):
        text.append(_AbsoluteStability(record["transparency"]))
    return "\n".join(text + record["notes"])


def _AbsoluteStability(points: Sequence[Mapping[str, Any]]) -> str:
    """Returns a sentence: whether surgeon and environment could be any passive ones."""
    failing = [point["name"] for point in points if not point["absolutely_stable"]]
    if not failing:
        return (
            "Stable with every passive surgeon and environment: Llewellyn's parameter "
            "is 1 or more everywhere."
        )
    return (
        "Not stable with every passive surgeon and environment: Llewellyn's parameter "
        f"falls below 1 ({', '.join(failing)})."
    )


def _Verdict(points: Sequence[Mapping[str, Any]], delay: float) -> list[str]:
    """Returns sentences: where the loop fails first and why, and what it does now."""
    text = []
    limits = [point for point in points if point["delay_margin"] is not None]
    if limits:
        least = min(limits, key=lambda point: point["delay_margin"])
        margin = least["delay_margin"]
        frequency = least["gain_crossovers"][least["crossing_delays"].index(margin)]
        text.append(
            f"It fails first in {least['name']}, at {margin:.4g} s: the delay turns "
            f"the phase at {frequency:.4g} rad/s by all of its margin, "
            f"{math.degrees(least['phase_margin']):.1f} deg."
        )
    for point in points:
        root = point["rightmost_root"]
        if not point["stable"] and root is not None and root[0] > 0:
            motion = f"a motion of {root[1]:.4g} rad/s" if root[1] else "a drift"
            text.append(
                f"At {delay:g} s, in {point['name']}, {motion} doubles every "
                f"{math.log(2) / root[0]:.3g} s."
            )
    return text


def _Certainty(points: Sequence[Mapping[str, Any]]) -> list[str]:
    """Returns sentences: what the linear model is not accurate enough to tell."""
    text = []
    slow = [point for point in points if point["unresolved_below"] > _LEAST_UNRESOLVED]
    if slow:
        sizes = ", ".join(f"{x['unresolved_below']:.2g} ({x['name']})" for x in slow)
        text.append(
            f"Neutral, within the accuracy of the model there: what is slower than "
            f"{sizes} rad/s."
        )
    for point in points:
        root, error = point["rightmost_root"], point["root_error"]
        if root is not None and not point["certain"]:
            doubt = "not known" if error is None else f"known to ± {error:.2g}"
            text.append(
                f"Uncertain in {point['name']}: the root's real part is {doubt} 1/s."
            )
    return text


def _Root(real: float, imaginary: float) -> str:
    """Returns a characteristic root, or both of a pair."""
    return f"{real:.4g}" + (f" ± {imaginary:.4g}j" if imaginary else "")


# What stands in the place of a delay margin.
_MARGIN_WORDS = {
    "stable": "at every delay",
    "unstable": "at every delay that was looked at",
    "windows": "unstable without delay, and stable at some larger ones",
    "absent": "the tool does not come to this layer",
}


def _ChartTable(chart: Mapping[str, Any]) -> str:
    """Returns the delay margins of `analyze --vary`: a row for each value."""
    names: dict[str, None] = {}
    for analysis in chart["analyses"]:
        names |= dict.fromkeys(p["name"] for p in analysis["operating_points"])
    lines = [[chart["key"], *(f"{name} [s]" for name in names), ""]]
    for value, analysis in zip(chart["values"], chart["analyses"], strict=True):
        points = {p["name"]: p for p in analysis["operating_points"]}
        cells = [_Margin(points.get(name)) for name in names]
        lines.append([f"{value:g}", *cells, ""])
    shown = {cell for line in lines[1:] for cell in line[1:]}
    words = [f"{word}: {text}" for word, text in _MARGIN_WORDS.items() if word in shown]
    return "\n".join(["Delay margins", _Align(lines), *words])


def _Margin(point: Mapping[str, Any] | None) -> str:
    """Returns the delay margin at an operating point, or why it has none."""
    if point is None:
        return "absent"
    if point["delay_margin"] is not None:
        return _Cell(point["delay_margin"])
    intervals = point["stable_delays"]
    if not intervals:
        return "unstable"
    return "stable" if intervals[0][0] == 0 else "windows"


def _Align(lines: Sequence[Sequence[str]]) -> str:
    """Returns columns: the first and the last to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            [
                line[0].ljust(widths[0]),
                *(c.rjust(w) for c, w in zip(line[1:-1], widths[1:-1], strict=True)),
                line[-1],
            ]
        ).rstrip()
        for line in lines
    )


def _Cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if isinstance(value, int) else f"{value:.5g}"


# Writing. Every file appears complete or not at all.


def _PrepareFolder(folder: str | None, *names: str) -> list[Path]:
    """Returns paths in a folder, after making it and checking that they can be written.

    Without a folder nothing is going to be written.
    """
    paths = [Path(folder or "") / name for name in names]
    if folder is None:
        return paths
    try:
        os.makedirs(folder, exist_ok=True)
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or e
        raise _BadInput(
            f"--out = {folder!r}: must be a folder that can be written ({reason})"
        ) from None
    for path in paths:
        _CheckWritable(path, f"--out = {folder!r}")
    return paths


def _CheckJson(file: str | None) -> None:
    if file is not None and file != "-":
        _CheckWritable(Path(file), f"--json = {file!r}")


def _CheckWritable(path: Path, option: str) -> None:
    """Refuses a path at which no file can be written, by trying."""
    try:
        if path.is_dir():
            raise IsADirectoryError(None, "Is a directory")
        if IsDevice(path):
            with open(path, "a"):
                return
        temporary = TemporaryPath(path)
        temporary.touch()
        temporary.unlink()
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or e
        raise _BadInput(
            f"{option}: must be where {path.name!r} can be written ({reason})"
        ) from None


def _WriteText(path: Path, text: str) -> None:
    with Replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _ToJson(value: Any) -> str:
    # NaN is not JSON; RunSummary has none.
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def _WriteJson(file: str, value: Any) -> None:
    if file == "-":
        print(_ToJson(value), end="")
    else:
        _WriteText(Path(file), _ToJson(value))
