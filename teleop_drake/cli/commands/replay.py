"""The command `teleop-drake replay`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli import options
from teleop_drake.cli.exit_codes import INTERRUPTED, BadInput
from teleop_drake.cli.output import HTML, CheckFile, OpenInBrowser
from teleop_drake.cli.progress import Simulate
from teleop_drake.loops.framework.validation import Refuse

if TYPE_CHECKING:
    from teleop_drake.model.task_recording import TaskRecording

_MAX_SHOWN = 4
"""The largest number of runs on a page; more would be too small to be seen."""


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    options.AddScenarioOptions(parser)
    parser.add_argument(
        "more",
        nargs="*",
        metavar="FILE.npz",
        help="recordings, as `run --out` and `compare` write them: instead of a "
        "scenario, one below the other",
    )
    parser.add_argument(
        "--controllers",
        **options.NAMES,
        help="simulate with each of these controllers, four at most, and show them one "
        "below the other",
    )
    options.AddEngineOption(parser)
    parser.add_argument(
        "--out",
        metavar="FILE.html",
        help="write the page, which opens without a network (default: open it)",
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def Execute(args: argparse.Namespace) -> int:
    """Replays recordings, or simulates a scenario and replays its runs."""
    CheckFile(args.out, "--out", *HTML)
    has_files = args.scenario.endswith(".npz")
    num_shown = 1 + len(args.more) if has_files else len(options.ControllersOf(args))
    if num_shown > _MAX_SHOWN:
        raise BadInput(
            f"replay of {num_shown} runs: must be of {_MAX_SHOWN} at most, to be seen; "
            "name them: --controllers A,B,..."
        )
    recordings = (_FromFiles if has_files else _Simulated)(args)
    ends = [recording.termination for recording in recordings.values()]
    is_interrupted = "interrupted" in ends and not has_files
    if is_interrupted and args.out is None:
        return INTERRUPTED

    from teleop_drake.study.figures.scene import MakeReplay

    replay = MakeReplay(recordings)
    if args.out is None:
        OpenInBrowser(replay.html, "replay.html")
    else:
        replay.Save(args.out)
        print(f"Written: {args.out}")
    return INTERRUPTED if is_interrupted else 0


def _Simulated(args: argparse.Namespace) -> "dict[str, TaskRecording]":
    """Simulates a scenario; returns its runs, keyed by the controller in words."""
    if args.more:
        Refuse("FILE.npz", args.more[0], "left out after a scenario")
    kinds = [[f"controller.kind={kind}"] for kind in options.ControllersOf(args)]
    scenarios = [options.Load(args, *kind, is_run=True) for kind in kinds or [[]]]
    recordings: dict[str, TaskRecording] = {}
    for scenario in scenarios:
        recording = Simulate(scenario, args.quiet, args.engine)
        recordings[scenario.controller.kind.replace("_", " ")] = recording
        if recording.termination == "interrupted":
            break
    return recordings


def _FromFiles(args: argparse.Namespace) -> "dict[str, TaskRecording]":
    """Returns recordings by controller, or by file if two have the same controller."""
    from teleop_drake.model.task_recording import CheckTaskRecording, LoadRecording

    names = (*options.OVERRIDES, "controllers", "set")
    options.RefuseOptions(args, names, "left out with a recording")
    files = [args.scenario, *args.more]
    recordings = []
    for file in files:
        try:
            run = CheckTaskRecording("recording", LoadRecording(file))
            recordings.append(run)
        except OSError as e:
            Refuse("FILE.npz", file, f"a file that can be read ({e.strerror})")
        except ValueError as e:
            raise BadInput(f"FILE.npz = {e}") from None
    kinds = [x.scenario.controller.kind.replace("_", " ") for x in recordings]
    stems = [Path(file).stem for file in files]
    labels = next((x for x in (kinds, stems, files) if len(set(x)) == len(x)), None)
    if labels is None:
        Refuse("FILE.npz", files[-1], "different files")
    return dict(zip(labels, recordings, strict=True))
