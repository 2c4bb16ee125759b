"""The command `teleop-drake`.

Exit codes: 0 done; 1 could not draw or write; 2 bad input, with one line on stderr
that names the field, the value and what is allowed; 130 interrupted, with what there
was by then.

Drake, numpy and matplotlib are imported by the commands that need them: help and bad
options cost no second.
"""

import argparse
import json
import os
import sys
import time
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_drake.files import IsDevice, Replacing, TemporaryPath

if TYPE_CHECKING:
    from teleop_drake.recording import Recording
    from teleop_drake.scenario import Scenario

_INTERRUPTED = 130

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
        name: str, command: Callable[[argparse.Namespace], int], summary: str
    ) -> argparse.ArgumentParser:
        subparser = commands.add_parser(
            name, help=summary, description=summary, allow_abbrev=False
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
        help="the controllers, the baseline first (default: all)",
    )
    _AddRunOptions(
        compare,
        json_help="write a list with the metrics of each run as JSON; `-`: to stdout, "
        "and nothing else there",
        out_help="write figure (.png) and recordings (.npz) there (default: out)",
        out_default="out",
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
    return parser


def _AddScenarioOptions(
    parser: argparse.ArgumentParser, *, has_controller: bool = True
) -> None:
    parser.add_argument(
        "scenario", metavar="SCENARIO", help="a built-in name or a YAML file"
    )
    if has_controller:
        parser.add_argument("--controller", metavar="KIND", help="controller.kind")
    parser.add_argument("--delay", metavar="S", help="delay each way, s")
    parser.add_argument("--forward-delay", metavar="S", help="forward delay, s")
    parser.add_argument("--return-delay", metavar="S", help="return delay, s")
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
    from teleop_drake.scenario import CONTROLLERS, LoadScenario, ScenarioNames

    print("Scenarios")
    for name in ScenarioNames():
        print(f"  {name:<18} {' '.join(LoadScenario(name).description.split())}")
    print("Controllers\n  " + ", ".join(CONTROLLERS))
    print("Robots\n  " + ", ".join(RobotModels()))
    return 0


def _Show(args: argparse.Namespace) -> int:
    from teleop_drake.scenario import ScenarioToYaml

    print(ScenarioToYaml(_Load(args)), end="")
    return 0


def _Run(args: argparse.Namespace) -> int:
    scenario = _Load(args)
    stem = f"{scenario.name}_{scenario.controller.kind}"
    _CheckJson(args.json)
    recording_path, figure_path, summary_path = _PrepareFolder(
        args.out, f"{stem}.npz", f"{stem}.png", f"{stem}.json"
    )

    from teleop_drake.metrics import RunSummary

    recording = _Simulate(scenario, args.quiet)
    record = RunSummary(recording)
    if args.out is not None:
        from teleop_drake.plotting import PlotRun, SaveFigure

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
    from teleop_drake.scenario import CONTROLLERS

    controllers = list(CONTROLLERS)
    if args.controllers is not None:
        controllers = [name.strip() for name in args.controllers.split(",")]
        if len(set(controllers)) < len(controllers):
            raise _BadInput(
                f"--controllers = {args.controllers!r}: must be different controllers"
            )
    scenarios = {kind: _Load(args, f"controller.kind={kind}") for kind in controllers}
    name = scenarios[controllers[0]].name
    _CheckJson(args.json)
    figure_path, *recording_paths = _PrepareFolder(
        args.out, f"{name}_comparison.png", *(f"{name}_{k}.npz" for k in controllers)
    )

    from teleop_drake.metrics import RunSummary
    from teleop_drake.plotting import PlotComparison, SaveFigure

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


def _Diagram(args: argparse.Namespace) -> int:
    if args.depth < 0:
        raise _BadInput(f"--depth = {args.depth}: must be 0 or positive")
    scenario = _Load(args)

    from teleop_drake.rendering import DiagramDot, WriteDiagram
    from teleop_drake.teleoperator import MakeTeleoperator

    teleoperator = MakeTeleoperator(scenario)
    if args.output is None:
        print(DiagramDot(teleoperator, max_depth=args.depth), end="")
        return 0
    try:
        WriteDiagram(teleoperator, args.output, max_depth=args.depth)
    except (ValueError, OSError) as e:
        raise _BadInput(f"--output: {e}") from None
    except RuntimeError as e:
        # Nothing here can lay out a diagram; the message says what to install.
        return _Fail(1, e)
    return 0


def _Load(args: argparse.Namespace, *more: str) -> "Scenario":
    """Returns the scenario with all overrides of the command line and `more`."""
    from teleop_drake.scenario import LoadScenario, ScenarioError

    overrides = []
    for option, paths in _OVERRIDES.items():
        value = getattr(args, option, None)
        if value is not None:
            overrides += [f"{path}={value}" for path in paths]
    try:
        return LoadScenario(args.scenario, [*overrides, *args.set, *more])
    except ScenarioError as e:
        raise _BadInput(e) from None


# Simulating.


def _Simulate(scenario: "Scenario", is_quiet: bool) -> "Recording":
    from teleop_drake.simulation import simulate

    if is_quiet:
        return simulate(scenario)
    with _Progress(scenario) as progress:
        return simulate(scenario, progress=progress)


@contextmanager
def _Progress(scenario: "Scenario") -> Iterator[Callable[[float], None]]:
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


# Showing.


def _Headline(recording: "Recording") -> str:
    scenario = recording.scenario
    line = (
        f"{scenario.name}, {scenario.controller.kind}: delay "
        f"{scenario.forward_channel.delay:g} s forward, "
        f"{scenario.return_channel.delay:g} s back, "
        f"{recording.time[-1]:g} s simulated, {recording.termination}"
    )
    return f"{line} ({recording.reason})" if recording.reason else line


def _Table(records: Mapping[str, Mapping[str, Any]]) -> str:
    """Returns the metrics of some runs: a row for each, a column for each run."""
    columns = {
        name: _Flatten(record["metrics"])
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
        unit = next((_UNITS[part] for part in row.split(".") if part in _UNITS), "")
        lines.append([row.replace("_", " ").replace(".", " "), *cells, unit])
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


def _Flatten(metrics: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns numbers by names such as `puncture.time` and `velocity_rms_error.x`."""
    flat: dict[str, Any] = {}
    for key, value in metrics.items():
        if isinstance(value, Mapping):
            flat |= _Flatten(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            axes = "xyz"[: len(value)]
            flat |= {f"{prefix}{key}.{a}": x for a, x in zip(axes, value, strict=True)}
        else:
            flat[prefix + key] = value
    return flat


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
