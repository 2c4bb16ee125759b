"""The command `teleop-drake study`."""

import argparse
import sys
from pathlib import Path

from teleop_drake.cli.exit_codes import FAILED, INTERRUPTED, BadInput, Fail
from teleop_drake.cli.output import CheckJson, WriteJson
from teleop_drake.cli.progress import SweepProgress
from teleop_drake.cli.sweeping import (
    AddSweepOptions,
    DaskExecutor,
    ExitCode,
    ReportSweep,
)


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.epilog = (
        "The file has the keys scenarios, controllers, grid, seeds, overrides, engine "
        "and metrics. `study FILE --shard I/N` for each I, on any machines, and then "
        "`study FILE merge`, make what `study FILE` makes."
    )
    parser.add_argument("file", metavar="FILE", help="a YAML file or a built-in study")
    parser.add_argument(
        "action",
        nargs="?",
        choices=("run", "merge"),
        default="run",
        help="run: simulate (the default); merge: put the parts in --out together",
    )
    parser.add_argument(
        "--shard", metavar="I/N", help="do the I-th of N parts, as a job of an array"
    )
    AddSweepOptions(parser)
    parser.add_argument(
        "--out",
        metavar="DIR",
        default="out",
        help="write a folder for each scenario there (default: out)",
    )
    parser.add_argument(
        "--json",
        metavar="FILE",
        help="write the records of all runs, by scenario, as JSON; `-`: to stdout, and "
        "nothing else there",
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def Execute(args: argparse.Namespace) -> int:
    """Does a study or a part of it, or merges its parts."""
    from teleop_drake.scenario import ScenarioError
    from teleop_drake.sweep import SelectMetrics, SweepError
    from teleop_drake.sweep.study import LoadStudy, MergeStudy, ParsePart, RunStudy

    _CheckOptions(args)
    CheckJson(args.json)

    def Notice(text: str) -> None:
        print(f"teleop-drake: {text}", file=sys.stderr)

    try:
        part = None if args.shard is None else ParsePart(args.shard)
        study = LoadStudy(args.file)
        metrics = {
            name: SelectMetrics(plan.scenario, study.metrics) if study.metrics else []
            for name, plan in study.plans.items()
        }
        if args.action == "merge":
            results = MergeStudy(study, args.out, notice=Notice)
        else:
            with (
                DaskExecutor(args.dask, args.quiet) as executor,
                SweepProgress(args.quiet) as show,
            ):
                results = RunStudy(
                    study,
                    args.out,
                    part=part,
                    executor=executor,
                    jobs=args.jobs,
                    resume=args.resume,
                    progress=show,
                    notice=Notice,
                )
    except (ScenarioError, SweepError) as e:
        raise BadInput(e) from None
    except RuntimeError as e:  # The executor gave up.
        return Fail(FAILED, f"{e}; --resume does the rest")
    except KeyboardInterrupt:
        return Fail(INTERRUPTED, "interrupted; --resume does the rest")
    if part is not None:
        if args.json != "-":
            print(f"Part {args.shard} is done. When all are: study {args.file} merge")
        return 0
    for name, result in results.items():
        folder = Path(args.out, name)
        ReportSweep(
            result,
            study.plans[name],
            metrics[name],
            folder,
            is_silent=args.json == "-",
            is_separate=args.separate,
        )
    if args.json is not None:
        WriteJson(args.json, {name: r.records for name, r in results.items()})
    return max(ExitCode(result) for result in results.values())


def _CheckOptions(args: argparse.Namespace) -> None:
    """Refuses options that exclude each other."""
    if args.jobs is not None and args.dask is not None:
        raise BadInput("--jobs: must be left out with --dask, which has workers")
    if args.shard is not None and args.json is not None:
        raise BadInput("--json: must be left out with --shard; merge has all records")
    if args.action == "merge":
        for option in ("shard", "jobs", "dask", "resume"):
            if getattr(args, option):
                raise BadInput(f"--{option}: must be left out where parts are merged")
