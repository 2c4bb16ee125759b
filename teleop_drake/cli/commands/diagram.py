"""The command `teleop-drake diagram`."""

import argparse

from teleop_drake.cli.exit_codes import FAILED, BadInput, Fail
from teleop_drake.cli.options import AddScenarioOptions, Load, MakerOf
from teleop_drake.loops.framework.validation import Refuse


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    AddScenarioOptions(parser, has_diagrams=True)
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="FILE.svg, .png, .pdf (needs the extra `pdf`), .dot, or .html, in which "
        "boxes open at a click (default: DOT text to stdout)",
    )
    parser.add_argument(
        "--depth",
        type=int,
        default=1,
        metavar="N",
        help="levels of nested diagrams to open (default: 1, the loop)",
    )


def Execute(args: argparse.Namespace) -> int:
    """Draws the diagram of a scenario, or the one that a function makes."""
    if args.depth < 0:
        Refuse("--depth", args.depth, "0 or positive")
    from teleop_drake.loops.draw.block_diagram import DiagramDot, WriteDiagram
    from teleop_drake.model.run.simulate import MakeDiagram

    maker = MakerOf(args)
    diagram = MakeDiagram(Load(args)) if maker is None else maker()
    if args.output is None:
        print(DiagramDot(diagram, max_depth=args.depth), end="")
        return 0
    try:
        WriteDiagram(diagram, args.output, max_depth=args.depth)
    except (ValueError, OSError) as e:
        raise BadInput(f"--output: {e}") from None
    except RuntimeError as e:
        # The diagram cannot be laid out; the message names the remedy.
        return Fail(FAILED, e)
    return 0
