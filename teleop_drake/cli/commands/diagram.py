"""The command `teleop-drake diagram`."""

import argparse
from typing import TYPE_CHECKING

from teleop_drake.cli.exit_codes import FAILED, BadInput, Fail
from teleop_drake.cli.options import AddScenarioOptions, Load, MakerOf

if TYPE_CHECKING:
    from pydrake.systems.framework import System


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
    """Draws the block diagram of the scenario, or of a function that makes one."""
    if args.depth < 0:
        raise BadInput(f"--depth = {args.depth}: must be 0 or positive")
    maker = MakerOf(args)
    diagram = _DiagramOfScenario(args) if maker is None else maker()

    from teleop_drake.figures.block_diagram import DiagramDot, WriteDiagram

    if args.output is None:
        print(DiagramDot(diagram, max_depth=args.depth), end="")
        return 0
    try:
        WriteDiagram(diagram, args.output, max_depth=args.depth)
    except (ValueError, OSError) as e:
        raise BadInput(f"--output: {e}") from None
    except RuntimeError as e:
        # Nothing here can lay out a diagram; the message says what to install.
        return Fail(FAILED, e)
    return 0


def _DiagramOfScenario(args: argparse.Namespace) -> "System":
    """Returns the diagram of the scenario."""
    scenario = Load(args)

    from teleop_drake.simulation import MakeDiagram

    return MakeDiagram(scenario)
