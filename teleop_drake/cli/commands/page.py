"""The commands `teleop-drake page` and `teleop-drake drive`."""

import argparse

from teleop_drake.cli import options
from teleop_drake.cli.exit_codes import FAILED, BadInput, Fail
from teleop_drake.cli.output import HTML, CheckFile, OpenInBrowser
from teleop_drake.cli.progress import TellLine
from teleop_drake.loops.framework.validation import Refuse


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of both commands."""
    has_hand = parser.prog.endswith(" drive")
    options.AddScenarioOptions(parser, has_diagrams=not has_hand)
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE.html",
        help="the page to write instead of opening it",
    )
    parser.add_argument(
        "--controllers",
        **options.NAMES,
        help="controllers side by side; `all`: every architecture (default: those that "
        "the task compares)",
    )
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="KEY=LO:HI",
        help="a number of the scenario that has a slider; KEY=A,B,...: values that can "
        "be chosen, as surgeon.kind=sine,trapezoid; of a Diagram a parameter, an "
        "initial state as plant.theta(0), or delay; repeatable",
    )
    parser.add_argument("--quiet", action="store_true", help="print no notes")
    parser.set_defaults(has_hand=has_hand)


def Execute(args: argparse.Namespace) -> int:
    """Writes the page; opens it in the browser if no file is given."""
    CheckFile(args.output, "--output", *HTML)
    maker = options.MakerOf(args)
    if maker is None:
        options.Load(args, is_run=True)
    kinds = options.ControllersOf(args)

    from teleop_drake.loops.engine.flatten import UnsupportedSystem
    from teleop_drake.study.page.page import MakePage

    try:
        page = MakePage(
            args.scenario if maker is None else maker,
            controllers=kinds or None,
            vary=dict(map(_Range, args.vary)) or None,
            overrides=options.OverridesOf(args) if maker is None else (),
            duration=_Duration(args.duration),
            has_hand=args.has_hand,
        )
    except UnsupportedSystem as e:
        raise BadInput(e) from None
    except RuntimeError as e:
        # The diagram cannot be laid out; the message names the remedy.
        return Fail(FAILED, e)
    for note in page.notes:
        TellLine(args.quiet, f"Note: {note}")
    if args.output is None:
        OpenInBrowser(page.html, f"{args.command_name}.html")
    else:
        page.Save(args.output)
        print(f"Written: {args.output}")
    return 0


def _Duration(text: str | None) -> float:
    """Returns the duration of a diagram's runs, s."""
    from teleop_drake.loops.page.diagram_page import DURATION

    try:
        return DURATION if text is None else float(text)
    except ValueError:
        Refuse("--duration", text, "a number (s)")


def _Range(text: str) -> tuple[str, list[float] | list[str]]:
    """Returns the key of --vary with its range or with the values to choose from."""
    key, _, values = text.partition("=")
    if "," in values:
        return key, values.split(",")
    try:
        low, high = map(float, values.split(":"))
    except ValueError:
        Refuse("--vary", text, "KEY=LO:HI or KEY=A,B,...")
    return key, [low, high]
