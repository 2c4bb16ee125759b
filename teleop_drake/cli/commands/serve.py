"""The commands `teleop-drake serve` and `teleop-drake operate`."""

import argparse
from typing import Any

from teleop_drake.cli import options, output


class _MakeKey(argparse.Action):
    """Writes a key instead of serving."""

    def __call__(self, parser: Any, namespace: Any, file: Any, *_: Any) -> None:
        from teleop_drake.link.packets import NewKey

        NewKey(file)
        parser.exit(message=f"Written: {file}\n")


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    options.AddScenarioOptions(parser)
    add, is_robot = parser.add_argument, parser.prog.endswith("serve")
    if is_robot:
        add("--new-key", action=_MakeKey, metavar="FILE", help="write a key, and end")
    name, where = ("--listen", "this") if is_robot else ("--connect", "the robot's")
    add(name, metavar="HOST:PORT", required=True, help=f"address of {where} side")
    add("--key", metavar="FILE", required=True, help="the key of both sides")
    add("--period", type=float, metavar="S", default=0.001, help="between packets, s")
    add("--limit", type=float, metavar="S", default=0.5, help="most round trip, s")
    options.AddRunOptions(
        parser,
        json_help="write what was measured as JSON there; `-`, default: to stdout",
        out_help="write recording, traces, prediction, figure and JSON there",
        out_default=None,
    )


def Execute(args: argparse.Namespace) -> int:
    """Runs a side of the loop, and checks the prediction against it."""
    scenario = options.Load(args, is_run=True)
    output.CheckJson(args.json)
    is_robot = args.command_name == "serve"
    name = "robot" if is_robot else "operator"
    (summary,) = output.PrepareFolder(args.out, f"{name}.json")

    from teleop_drake.link.prediction import SaveRun
    from teleop_drake.link.side import OperateRemotely, Say, ServeRobot

    run, place = (ServeRobot, "listen") if is_robot else (OperateRemotely, "connect")
    given: Any = {x: getattr(args, x) for x in (place, "key", "period", "limit")}
    side = run(scenario, say=(lambda line: None) if args.quiet else Say, **given)
    report = side.Report() if args.out is None else SaveRun(side, summary.parent)
    if args.out is not None:
        output.WriteText(summary, output.ToJson(report))
    output.WriteJson(args.json or "-", report)
    return 0 if report["termination"] == "completed" else 1
