"""The commands `teleop-drake serve` and `teleop-drake operate`."""

import argparse
from collections.abc import Mapping
from functools import partial
from typing import Any

from teleop_drake.cli import options, output
from teleop_drake.loops.framework.validation import Refuse


class _MakeKey(argparse.Action):
    """The action of --new-key, which writes a key and exits instead of serving."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        file: Any,
        option: str | None = None,
    ) -> None:
        from teleop_drake.study.link.packets import NewKey

        try:
            NewKey(file)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            allowed = f"a new file that can be written ({reason})"
            Refuse("--new-key", file, allowed)
        parser.exit(message=f"Written: {file}\n")


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    options.AddScenarioOptions(parser)
    add = parser.add_argument
    if parser.prog.endswith("serve"):
        add("--new-key", action=_MakeKey, metavar="FILE", help="write a key, and end")
        place = "--listen"
        place_help = "address of this side"
    else:
        place = "--connect"
        place_help = "address of the robot's side"
    add(place, dest="address", metavar="HOST:PORT", required=True, help=place_help)
    add("--key", metavar="FILE", required=True, help="the key of both sides")
    add("--period", type=float, metavar="S", default=0.001, help="between packets, s")
    add("--limit", type=float, metavar="S", default=0.5, help="most round trip, s")
    options.AddRunOptions(
        parser,
        json_help="write what was measured as JSON there; `-`: to stdout, and nothing "
        "else there",
        out_help="write recording, traces, prediction, figure and JSON there, and a "
        "log from the first tick on, which is there even if the side is killed",
        out_default=None,
    )


def Execute(args: argparse.Namespace) -> int:
    """Runs one side of the loop; with --out, compares it with a prediction."""
    scenario = options.Load(args, is_run=True)
    output.CheckJson(args.json)
    is_robot = args.command_name == "serve"
    name = "robot" if is_robot else "operator"
    summary, log = output.PrepareFolder(args.out, f"{name}.json", f"{name}_log.csv")
    has_folder = args.out is not None

    from teleop_drake.study.link.remote import OperateRemotely, ServeRobot
    from teleop_drake.study.link.side import Say

    run = partial(OperateRemotely, connect=args.address)
    if is_robot:
        run = partial(ServeRobot, listen=args.address)
    side = run(
        scenario,
        key=args.key,
        period=args.period,
        limit=args.limit,
        say=(lambda _: None) if args.quiet else Say,
        log_file=log if has_folder else None,
    )

    from teleop_drake.study.link.prediction import SaveRun

    report = SaveRun(side, summary.parent) if has_folder else side.Report()
    if has_folder:
        output.WriteText(summary, output.ToJson(report))
    output.Tell(args, report, *_Lines(report))
    return 0 if report["termination"] == "completed" else 1


def _Lines(report: Mapping[str, Any]) -> list[str]:
    """Returns two lines: how a side ended, and the round trips that it measured."""
    ending = report["termination"]
    ending += f" ({report['reason']})" if report["reason"] else ""
    trips = report["round_trip_s"]
    lines = [
        f"{report['scenario']}, {report['controller']}: {report['side']}, "
        f"{report['duration_s']:g} s, {ending}",
        f"round trip {1e3 * trips['median']:.3g} ms in the median, "
        f"{1e3 * trips['most']:.3g} ms at most; {len(report['outages_s'])} outages",
    ]
    if "prediction" in report:
        largest = max(report["prediction"].values())
        lines[1] += f"; the prediction differs by {largest:.1e} of a signal's size"
    return lines
