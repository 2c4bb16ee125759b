"""Options that several commands share, and the scenario that they describe."""

import argparse
import inspect
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.validation import CheckChoice, Choices, Refuse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from pydrake.systems.framework import System

    from teleop_drake.scenario import AnyScenario
    from teleop_drake.scenario.overrides import Override


# The channel of a trace. What is shorter than the run begins again.
_TRACE_CHANNEL = {
    "kind": "network",
    "delay": 0.0,
    "sample_period": 0.01,
    "trace_end": "repeat",
}

# Options that stand for fields of the scenario. `--set` comes after them.
OVERRIDES = {
    "controller": "controller",
    "delay": "delay",
    "forward_delay": "forward_delay",
    "return_delay": "return_delay",
    "duration": "duration",
    "accuracy": "simulator.accuracy",
}


def AddScenarioOptions(
    parser: argparse.ArgumentParser,
    *,
    has_controller: bool = True,
    is_sweep: bool = False,
    has_diagrams: bool = False,
) -> None:
    """Adds the scenario and the options that stand for its fields."""
    parser.add_argument(
        "scenario",
        metavar="SCENARIO",
        help="a built-in name or a YAML file; a file that names kinds of its own "
        "(module:Class) is a program, to be trusted like one"
        + ", or module:Make, a function that makes a Diagram"
        * has_diagrams,
    )
    delay = "VALUES" if is_sweep else "S"
    if has_controller:
        parser.add_argument("--controller", metavar="KIND", help="controller.kind")
    parser.add_argument("--delay", metavar=delay, help="delay each way, s")
    parser.add_argument("--forward-delay", metavar=delay, help="forward delay, s")
    parser.add_argument("--return-delay", metavar=delay, help="return delay, s")
    parser.add_argument(
        "--channel",
        metavar="FILE|KIND",
        help="both channels: YAML with the fields of a channel, a measured trace (CSV, "
        "or what ping printed) for packets every 10 ms, or a kind, for example lte",
    )
    parser.add_argument("--duration", metavar="S", help="simulated time, s")
    parser.add_argument("--accuracy", metavar="X", help="simulator.accuracy")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PATH=VALUE|FILE",
        help="any other field, for example environment.layers.bone.stiffness=300, or "
        "a YAML file of paths and values, such as the gains.yaml of `tune`; "
        "repeatable; later ones win",
    )


def AddRunOptions(
    parser: argparse.ArgumentParser,
    *,
    json_help: str,
    out_help: str,
    out_default: str | None,
) -> None:
    """Adds --json, --out and --quiet."""
    parser.add_argument("--json", metavar="FILE", help=json_help)
    parser.add_argument("--out", metavar="DIR", default=out_default, help=out_help)
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def AddFormatOption(parser: argparse.ArgumentParser, default: str = "png") -> None:
    """Adds --format."""
    parser.add_argument(
        "--format",
        default=default,
        metavar="A,B,...",
        help=f"of figures: png, svg, pdf or several of them (default: {default})",
    )


def AddFigureOptions(parser: argparse.ArgumentParser) -> None:
    """Adds what figures, --html and the table show of runs."""
    AddFormatOption(parser)
    parser.add_argument(
        "--columns",
        type=int,
        choices=(1, 2),
        default=2,
        help="columns of a printed page that figures span (default: 2)",
    )
    parser.add_argument(
        "--signals",
        metavar="A,B,...",
        help="what figures show, for example tool_velocity,environment_force",
    )
    parser.add_argument(
        "--window",
        metavar="FROM:TO",
        help="part of the time that figures show, s",
    )
    parser.add_argument(
        "--html",
        metavar="FILE",
        help="write a page that plays the robot in 3-D, as `teleop-drake replay` does",
    )
    parser.add_argument(
        "--verbose",
        action="store_true",
        help="print all metrics, and what the solver did",
    )


def FormatsOf(args: argparse.Namespace) -> list[str]:
    """Returns the formats that --format asks for.

    Raises:
        BadInput: If one is none.
    """
    from teleop_drake.files import FIGURE_FORMATS

    formats = [name.strip() for name in args.format.split(",")]
    for name in formats:
        if name not in FIGURE_FORMATS:
            Refuse("--format", args.format, Choices(name, FIGURE_FORMATS))
    return list(dict.fromkeys(formats))


def FigureOptionsOf(args: argparse.Namespace) -> dict[str, Any]:
    """Returns the options of a figure as PlotRun() and PlotComparison() take them.

    Raises:
        BadInput: If the window is none.
    """
    time = None
    if args.window is not None:
        try:
            begin, end = map(float, args.window.split(":"))
        except ValueError:
            begin = end = 0.0
        if not 0 <= begin < end:
            Refuse("--window", args.window, "FROM:TO, times in s, the later one behind")
        time = (begin, end)
    signals = None
    if args.signals is not None:
        signals = [name.strip() for name in args.signals.split(",")]
    return {"signals": signals, "time": time, "columns": args.columns}


def CheckSignals(args: argparse.Namespace, scenario: "AnyScenario") -> None:
    """Refuses names in --signals that a run of the scenario does not record.

    Raises:
        BadInput: Naming the first one.
    """
    if args.signals is None:
        return
    from teleop_drake.signals import NamedSignals
    from teleop_drake.simulation import MakeDiagram

    known = NamedSignals(MakeDiagram(scenario).GetSystems())
    for name in FigureOptionsOf(args)["signals"]:
        CheckChoice("--signals", name, known)


def ControllersOf(args: argparse.Namespace) -> list[str]:
    """Returns the names that --controllers has, or else --controller; maybe none.

    Raises:
        BadInput: If a name stands there twice, or both options are given.
    """
    from teleop_drake.scenario import ARCHITECTURES

    one = getattr(args, "controller", None)
    several = args.controllers
    if several is None:
        return [] if one is None else [one]
    if one is not None:
        Refuse("--controller", one, "left out with --controllers")
    names: list[str] = []
    for part in several.split(","):
        name = part.strip()
        names += ARCHITECTURES if name == "all" else [name]
    if len(set(names)) < len(names):
        Refuse("--controllers", several, "different controllers")
    return names


def AddGridOptions(
    parser: argparse.ArgumentParser, *, has_controllers: bool = True
) -> None:
    """Adds --controllers, --vary and --seeds."""
    if has_controllers:
        parser.add_argument(
            "--controllers",
            metavar="A,B,...",
            help="controller.kind, the baseline first, or module:Law of your own; "
            "`all`: every architecture (default: the thesis's two)",
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
        help="N runs of each, with the seeds 0 to N - 1 of the network channels: "
        "medians, shares and differences between controllers with intervals",
    )


def GridOf(
    args: argparse.Namespace, controllers: list[str], *more: tuple[str, str]
) -> dict[str, list[Any]]:
    """Returns the grid that --vary and --seeds ask for, see MakeGrid().

    Args:
        controllers: Those that are varied, if any.
        more: Further paths and the text of their values.

    Raises:
        BadInput: If --vary has no path.
        ScenarioError: If it is none.
    """
    from teleop_drake.sweep.values import MakeGrid

    varied = [SplitVary(item) for item in args.vary]
    return MakeGrid(controllers or None, [*varied, *more], args.seeds)


def SplitVary(
    item: str, allowed: str = "PATH=VALUES", *, option: str = "--vary"
) -> tuple[str, str]:
    """Returns the path and the values that an item of an option has, as text."""
    path, equals, text = item.partition("=")
    if not equals or not path.strip():
        Refuse(option, item, allowed)
    return path.strip(), text


def AddEngineOption(parser: argparse.ArgumentParser) -> None:
    """Adds --engine."""
    parser.add_argument(
        "--engine",
        choices=("drake", "compiled", "auto"),
        default="auto",
        help="what runs it: Drake's Simulator, or machine code, which is compiled "
        "once; auto: machine code where possible (default: auto)",
    )


def Load(args: argparse.Namespace, *more: str, is_run: bool = False) -> "AnyScenario":
    """Returns the scenario with all overrides of the command line.

    Args:
        is_run: Whether it is going to be simulated.

    Raises:
        ScenarioError: If the scenario is not valid, or would take too long to simulate.
    """
    from teleop_drake.scenario import CheckSteps, LoadScenario
    from teleop_drake.tasks import TaskOf

    scenario = LoadScenario(args.scenario, [*OverridesOf(args), *more])
    # Loading checks each parameter, but not what derives from others.
    TaskOf(scenario).Check(scenario)
    if is_run:
        CheckSteps(scenario)
    return scenario


def MakerOf(args: argparse.Namespace) -> "Callable[[], System] | None":
    """Returns the function that the scenario names as module:Make; None: it is a file.

    Raises:
        BadInput: If there is no such function, or an option is for scenarios only.
    """
    from teleop_drake.kinds import ImportOwn

    if ":" not in args.scenario or Path(args.scenario).exists():
        return None
    if OverridesOf(args) != [f"duration={args.duration}"] * (args.duration is not None):
        allowed = "left out, because a Diagram takes no options of a scenario"
        raise BadInput(f"options of {args.scenario!r}: must be {allowed}")
    maker = ImportOwn(args.scenario, "SCENARIO")
    try:
        inspect.signature(maker).bind()
    except (TypeError, ValueError):
        allowed = "a function without arguments that returns a Diagram"
        Refuse("SCENARIO", args.scenario, allowed)
    return cast("Callable[[], System]", maker)


def ChannelOverrides(
    args: argparse.Namespace, *, imports: bool = True
) -> "list[Override]":
    """Returns the overrides that --channel stands for, none without it.

    Args:
        imports: Whether to look up, and so to import, a channel of the user's own.

    Raises:
        BadInput: If it is none of what it may be.
    """
    given = getattr(args, "channel", None)
    if given is None:
        return []
    from teleop_drake.blocks.channels import CHANNEL_KINDS
    from teleop_drake.kinds import IsOwn
    from teleop_drake.scenario.yaml_text import ParseFile

    path = Path(given)
    folder = Path()
    fields: dict[str, Any] = {"kind": given}
    try:
        if path.suffix in (".yaml", ".yml"):
            fields = ParseFile(path)
            folder = path.parent
        elif path.is_file():
            fields = _TRACE_CHANNEL | {"trace": given}
        kind = fields.get("kind", "transport")
        if imports or not IsOwn(kind):
            for name in CHANNEL_KINDS.Find(kind, "kind").file_fields:
                if isinstance(fields.get(name), str):
                    fields[name] = str(folder / fields[name])
    except ValueError as e:
        reason = e if path.exists() or not path.suffix else "no such file"
        Refuse("--channel", given, f"a YAML file, a trace or a kind ({reason})")
    return [("channel", fields)]


def OverridesOf(
    args: argparse.Namespace,
    names: "Iterable[str]" = OVERRIDES,
    *,
    imports: bool = True,
) -> "list[Override]":
    """Returns the overrides of the command line.

    Args:
        names: The options that are overrides, besides --channel and --set.
        imports: As in ChannelOverrides().
    """
    overrides = ChannelOverrides(args, imports=imports)
    for option in names:
        value = getattr(args, option, None)
        if value is not None:
            overrides.append(f"{OVERRIDES[option]}={value}")
    return [*overrides, *FieldsOf(args)]


def FieldsOf(args: argparse.Namespace) -> "list[Override]":
    """Returns the fields of --set and their values, also those of its files."""
    from teleop_drake.scenario.overrides import OverridesOfFile

    fields: list[Override] = []
    for text in args.set:
        is_file = "=" not in text and Path(text).suffix in (".yaml", ".yml")
        fields += OverridesOfFile(Path(text)) if is_file else [text]
    return fields
