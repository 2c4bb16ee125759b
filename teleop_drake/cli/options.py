"""Options that several commands share, and the scenario that they describe."""

import argparse
import functools
import inspect
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.loops.framework.validation import CheckChoice, Refuse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from pydrake.systems.framework import System

    from teleop_drake.model.scenario import AnyScenario
    from teleop_drake.model.scenario.overrides import Override


# The channel of a measured trace, which is repeated if it is shorter than the run.
_TRACE_CHANNEL = {
    "kind": "network",
    "delay": 0.0,
    "sample_period": 0.01,
    "trace_end": "repeat",
}

# Options that set a field of the scenario. `--set` is applied after them.
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
    """Adds the argument SCENARIO and the options that set fields of the scenario.

    Args:
        has_controller: Whether to add --controller.
        is_sweep: Whether the help calls the delays VALUES.
        has_diagrams: Whether SCENARIO may also be a function that makes a Diagram.
    """
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


def Names(text: str) -> list[str]:
    """Returns the names in a text such as A,B."""
    return [name.strip() for name in text.split(",")]


def RefuseOptions(
    args: argparse.Namespace, names: "Iterable[str]", allowed: str
) -> None:
    """Refuses options that are given, because they would have no effect.

    Args:
        names: The names of the options in `args`.
        allowed: Why they must be left out, such as "left out with --seeds".
    """
    for name in names:
        value = getattr(args, name, None)
        if value not in (None, [], "auto"):
            option = name.removesuffix("_column").replace("_", "-")
            Refuse(f"--{option}", value, allowed)


class _Collect(argparse.Action):
    """Appends names to those of the same option before, or replaces its default."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        before = getattr(namespace, self.dest)
        known = [] if before is self.default else before
        setattr(namespace, self.dest, [*known, *values])


NAMES: dict[str, Any] = {"action": _Collect, "type": Names, "metavar": "A,B,..."}
"""Keywords of add_argument() for an option with names, which may be repeated."""


def AddFormatOption(parser: argparse.ArgumentParser, default: str = "png") -> None:
    """Adds --format."""
    parser.add_argument(
        "--format",
        **NAMES,
        default=default,
        help=f"of figures: png, svg, pdf or several of them (default: {default})",
    )


def AddFigureOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of figures, of the page --html and of the metrics table."""
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
        **NAMES,
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
    """Returns the formats of --format, each once.

    Raises:
        ScenarioError: If a format is unknown.
    """
    from teleop_drake.loops.framework.files import FIGURE_FORMATS

    for name in args.format:
        CheckChoice("--format", name, FIGURE_FORMATS)
    return list(dict.fromkeys(args.format))


def FigureOptionsOf(args: argparse.Namespace) -> dict[str, Any]:
    """Returns the keyword arguments of PlotRun() and PlotComparison().

    Raises:
        ScenarioError: If --window is not FROM:TO with 0 <= FROM < TO.
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
    return {"signals": args.signals, "time": time, "columns": args.columns}


def CheckSignals(args: argparse.Namespace, scenario: "AnyScenario") -> None:
    """Refuses names in --signals that a run of the scenario does not record.

    Raises:
        ScenarioError: Naming the first one.
    """
    if args.signals is None:
        return
    from teleop_drake.model.run.simulate import MakeDiagram
    from teleop_drake.model.signals import NamedSignals

    known = NamedSignals(MakeDiagram(scenario).GetSystems())
    for name in args.signals:
        CheckChoice("--signals", name, known)


def ControllersOf(args: argparse.Namespace) -> list[str]:
    """Returns the names in --controllers or in --controller; empty without both.

    Raises:
        ScenarioError: If a name occurs twice, or both options are given.
    """
    from teleop_drake.model.scenario import ARCHITECTURES

    one = getattr(args, "controller", None)
    several = args.controllers
    if several is None:
        return [] if one is None else [one]
    if one is not None:
        Refuse("--controller", one, "left out with --controllers")
    names: list[str] = []
    for name in several:
        names += ARCHITECTURES if name == "all" else [name]
    if len(set(names)) < len(names):
        Refuse("--controllers", ",".join(several), "different controllers")
    return names


def AddGridOptions(
    parser: argparse.ArgumentParser, *, has_controllers: bool = True
) -> None:
    """Adds --controllers, --vary and --seeds."""
    if has_controllers:
        parser.add_argument(
            "--controllers",
            **NAMES,
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
    """Returns the grid of --vary and --seeds; see MakeGrid().

    Args:
        controllers: The controllers to vary; may be empty.
        more: Further varied paths, each with its values as text.

    Raises:
        ScenarioError: If an item of --vary has no path, or the grid is invalid.
    """
    from teleop_drake.study.sweep.values import MakeGrid

    varied = [SplitVary(item) for item in args.vary]
    return MakeGrid(controllers or None, [*varied, *more], args.seeds)


def SplitVary(
    item: str, allowed: str = "PATH=VALUES", *, option: str = "--vary"
) -> tuple[str, str]:
    """Returns the path and the values, both as text, of an option's item.

    Args:
        item: The item, such as "forward_channel.delay=0.1,0.2".
        allowed: The form of an item, for the error message.
        option: The option's name, for the error message.
    """
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
        more: Further overrides, which are applied last.
        is_run: Whether it will be simulated; then its number of steps is checked.

    Raises:
        ScenarioError: If the scenario is not valid, or would take too long to simulate.
    """
    from teleop_drake.model.scenario import CheckSteps, LoadScenario
    from teleop_drake.model.tasks import TaskOf

    scenario = LoadScenario(args.scenario, [*OverridesOf(args), *more])
    # Loading checks each field, but not the values that are computed from several.
    TaskOf(scenario).Check(scenario)
    if is_run:
        CheckSteps(scenario)
    return scenario


def MakerOf(args: argparse.Namespace) -> "Callable[[], System] | None":
    """Returns the function that SCENARIO names as module:Make; None for a scenario.

    The function raises a ScenarioError if it fails, or if it returns no System.

    Raises:
        BadInput: If an option is given that only scenarios have.
        ScenarioError: If there is no such function, or it requires arguments.
    """
    from teleop_drake.model.kinds import ImportOwn

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
    return _Checked(maker, args.scenario)


def _Checked(maker: "Callable[[], Any]", name: str) -> "Callable[[], System]":
    """Returns a function that refuses a maker that fails or returns no System.

    Args:
        name: The maker as module:Make, for the message.
    """
    from pydrake.systems.framework import System

    @functools.wraps(maker)
    def Make() -> System:
        try:
            system = maker()
        except (Exception, SystemExit) as e:  # Drake exits if a contract is violated.
            at = traceback.extract_tb(e.__traceback__)[-1]
            reason = f"{type(e).__name__}: {e}; {Path(at.filename).name}:{at.lineno}"
            raise BadInput(
                f"SCENARIO = {name!r}: must be a function that returns a Diagram "
                f"({reason})"
            ) from e
        if not isinstance(system, System):
            kind = type(system).__name__
            Refuse("SCENARIO", name, f"a function that returns a Diagram, not a {kind}")
        return system

    return Make


def ChannelOverrides(
    args: argparse.Namespace, *, imports: bool = True
) -> "list[Override]":
    """Returns the overrides of --channel; empty without this option.

    Args:
        imports: Whether to import a user-defined channel, whose relative file names
            are then resolved.

    Raises:
        ScenarioError: If --channel is neither a YAML file, a trace nor a kind.
    """
    given = getattr(args, "channel", None)
    if given is None:
        return []
    from teleop_drake.model.channels.kinds import CHANNEL_KINDS
    from teleop_drake.model.kinds import FileOf, IsOwn, WithFile
    from teleop_drake.model.scenario.yaml_text import ParseFile

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
                file = FileOf(fields.get(name))
                if file is not None:
                    fields[name] = WithFile(fields[name], str(folder / file))
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
        names: The options to convert, in addition to --channel and --set.
        imports: As in ChannelOverrides().
    """
    overrides = ChannelOverrides(args, imports=imports)
    for option in names:
        value = getattr(args, option, None)
        if value is not None:
            overrides.append(f"{OVERRIDES[option]}={value}")
    return [*overrides, *FieldsOf(args)]


def FieldsOf(args: argparse.Namespace) -> "list[Override]":
    """Returns the overrides of --set, including those in its YAML files."""
    from teleop_drake.model.scenario.yaml_text import ParseFile

    fields: list[Override] = []
    for text in args.set:
        is_file = "=" not in text and Path(text).suffix in (".yaml", ".yml")
        fields += ParseFile(Path(text)).items() if is_file else [text]
    return fields
