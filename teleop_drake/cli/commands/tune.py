"""The command `teleop-drake tune`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli import options
from teleop_drake.cli.commands.sweep import StudyOf
from teleop_drake.cli.exit_codes import DONE, BadInput, Interrupted
from teleop_drake.cli.output import CheckJson, Tell
from teleop_drake.cli.progress import Notice, SweepProgress
from teleop_drake.cli.tables import Align

if TYPE_CHECKING:
    from teleop_drake.study.sweep.study import Study
    from teleop_drake.study.sweep.tuning import TuningResult


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.epilog = (
        "SCENARIO may be a study: then its runs are the training runs. VALUES are "
        "START:STOP:COUNT or A,B,... in YAML. Gains are accepted if all training runs "
        "run to their end; a time that a run does not reach counts as its duration. "
        "Each metric is taken in multiples of what the scenario's own gains give, as a "
        "mean over the runs."
    )
    options.AddScenarioOptions(parser, is_sweep=True)
    options.AddGridOptions(parser, has_controllers=False)
    add = parser.add_argument
    add(
        "--gains",
        **options.NAMES,
        required=True,
        help="one to six fields to search, repeatable; for example G1,Lambda=0.1:2 or "
        "controller.four_channel.C2; without a range a tenth to ten times the "
        "scenario's own value",
    )
    add(
        "--minimize",
        action="append",
        required=True,
        metavar="METRIC[:WEIGHT]",
        help="a metric as in runs.csv, or felt_stiffness_loss, the share of the "
        "environment's stiffness that is not felt at 1 rad/s; repeatable; without "
        "weights: a Pareto front",
    )
    add(
        "--held-out",
        action="append",
        default=[],
        metavar="KEY=VALUES|STUDY",
        help="runs that the search does not see: other values of delay, seed or any "
        "field, or a study; repeatable",
    )
    help_ = "longer round trip with which every loop has to be stable by analysis, s"
    add("--margin", type=float, metavar="S", help=help_)
    help_ = "how many sets of gains to try (default: 64)"
    add("--evaluations", type=int, default=64, metavar="N", help=help_)
    help_ = "seed of the search (default: 0)"
    add("--seed", type=int, default=0, metavar="N", help=help_)
    add("--jobs", type=int, metavar="N", help="as for `sweep`")
    add("--resume", action="store_true", help="go on with the search in --out")
    options.AddRunOptions(
        parser,
        json_help="write the rows of tuning.csv as JSON; `-`: to stdout, and nothing "
        "else there",
        out_help="write gains.yaml, tuning.csv and all runs there (default: out)",
        out_default="out",
    )
    # Options of `sweep` that StudyOf() reads.
    parser.set_defaults(controllers=None, metrics=None, engine="auto")


def Execute(args: argparse.Namespace) -> int:
    """Searches for gains, and writes them."""
    if args.controller is None:
        raise BadInput("--controller: must name what is tuned")
    CheckJson(args.json)
    from teleop_drake.study.sweep import Execution
    from teleop_drake.study.sweep.study import IsStudy
    from teleop_drake.study.sweep.tuning import PlanTuning, RunTuning

    controller = args.controller
    if IsStudy(args.scenario):  # It defines all but the controller.
        args.controller = None
    training = StudyOf(args)
    plan = PlanTuning(
        training,
        controller=controller,
        gains=args.gains,
        minimize=args.minimize,
        held_out=_HeldOut(args.held_out),
        margin=args.margin,
        evaluations=args.evaluations,
        seed=args.seed,
    )

    if not args.quiet:
        for path, (low, high) in plan.ranges.items():
            Notice(f"{path} is searched from {low:g} to {high:g}")
    try:
        with SweepProgress(args.quiet) as show:
            execution = Execution(
                jobs=args.jobs,
                out=args.out,
                resume=args.resume,
                progress=show,
                notice=Notice,
            )
            result = RunTuning(plan, execution)
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted; --resume goes on with {args.out}") from None
    written = result.Write(Path(args.out))
    tables = [_Table(result)]
    if result.held_out:
        tables.append(_HeldOutTable(result))
    Tell(args, result.Table(), *tables, written=written)
    return DONE


def _HeldOut(items: list[str]) -> "Study | dict[str, str]":
    """Returns the study of the held-out runs, or their values keyed by path."""
    from teleop_drake.study.sweep.study import IsStudy, LoadStudy

    if len(items) == 1 and IsStudy(items[0]):
        return LoadStudy(items[0])
    allowed = "KEY=VALUES of a scenario, or one study"
    return dict(options.SplitVary(item, allowed, option="--held-out") for item in items)


def _Table(result: "TuningResult") -> str:
    """Returns a table of gains with their metrics in the training runs.

    Its rows are the scenario's own gains and those of the front.
    """
    plan = result.plan
    names = [path.rpartition(".")[2] for path in plan.ranges]
    lines = [["", *names, *(f"{metric} (relative)" for metric in plan.weights)]]
    for i, trial in enumerate([result.own, *result.front]):
        gains = [f"{x:g}" for x in trial.gains.values()] or ["-"] * len(names)
        scores = [f"{x:.4g}" for x in result.Scores(trial)]
        lines.append([result.Title(i), *gains, *scores])
    table = Align(lines)
    if result.own.reason:
        table += f"\nown: not accepted ({result.own.reason})"
    return table


def _HeldOutTable(result: "TuningResult") -> str:
    """Returns a table of the held-out runs, a row for each set of gains and scenario.

    Mean and largest value are those over the bounded runs: these reach their end and
    have every metric.
    """
    from teleop_drake.model.tasks.metrics import MetricUnits

    units: dict[str, str] = {}
    for sweep in result.plan.held_out.values():
        units |= MetricUnits(sweep.scenario)
    titles = []
    for metric in result.plan.weights:
        unit = f" [{units[metric]}]" if units.get(metric) else ""
        titles += [f"{metric}{unit}: mean", "largest"]
    lines = [["held out", "scenario", "bounded", *titles]]
    for row in result.Table():
        if row["runs"] != "held out":
            continue
        bounded = f"{row['bounded']} of {row['count']}"
        cells = [str(row["gains"]), str(row["scenario"]), bounded]
        for metric in result.plan.weights:
            for statistic in ("mean", "worst"):
                value = row[f"{metric} {statistic}"]
                cells.append("-" if value is None else f"{value:.4g}")
        lines.append(cells)
    return Align(lines)
