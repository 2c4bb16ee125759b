"""The commands `teleop-drake serve` and `teleop-drake operate`."""

import argparse
from pathlib import Path
from typing import Any

from teleop_drake.cli import options, output
from teleop_drake.cli.exit_codes import BadInput


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
        json_help="write what was measured as JSON; `-`: to stdout",
        out_help="write recording, traces, prediction, figure and JSON there",
        out_default=None,
    )


def Execute(args: argparse.Namespace) -> int:
    """Runs a side of the loop, and checks the prediction against it."""
    scenario = options.Load(args, is_run=True)
    output.CheckJson(args.json)
    name = "robot" if args.command_name == "serve" else "operator"
    names = [f"{name}_prediction.png", f"{name}.json"]
    picture, summary = output.PrepareFolder(args.out, *names)

    from teleop_drake.link.prediction import Compare, Predict, SaveRun
    from teleop_drake.link.side import OperateRemotely, ServeRobot

    run: Any = OperateRemotely if name == "operator" else ServeRobot
    place = "connect" if name == "operator" else "listen"
    given = {place: getattr(args, place), "period": args.period, "limit": args.limit}
    try:
        side = run(scenario, key=args.key, **given)
    except ValueError as error:
        raise BadInput(error) from None
    report, written = side.Report(), []
    if args.out is not None:
        written = [*SaveRun(side, Path(args.out)), summary]
        try:
            predicted = Predict(side, Path(args.out))
            report["prediction"] = Compare(side, predicted, picture)
            written.append(picture)
        except ValueError as error:  # It ended too early.
            side.Say(f"no prediction: {error}")
        output.WriteText(summary, output.ToJson(report))
    if args.json is not None:
        output.WriteJson(args.json, report)
    if args.json != "-":
        print("\n".join(_Lines(report)))
        if written:
            print("Written:", ", ".join(map(str, written)))
    return 0 if report["termination"] == "completed" else 1


def _Lines(report: dict[str, Any]) -> list[str]:
    trip = {name: f"{1e3 * x:.3g} ms" for name, x in report["round_trip"].items()}
    lines = [
        "{scenario}, {controller}, the {side}'s side: {termination} at {duration:g} s, "
        "{reason}".format(**report).removesuffix(", "),
        f"Rate {1 / report['mean_period']:.4g} Hz, jitter {1e3 * report['jitter']:.3g} "
        f"ms, at most {1e3 * report['largest_lateness']:.3g} ms late, "
        f"{report['missed_periods']} periods missed",
        "Round trip: " + ", ".join(f"{name} {x}" for name, x in trip.items()),
    ]
    for name, apart in report.get("prediction", {}).items():
        lines.append(f"Predicted {name}: at most {1e3 * apart:g} ms early or late")
    if "prediction" in report and report["outages"]:
        lines.append("The prediction knows nothing of forces that fade.")
    return lines
