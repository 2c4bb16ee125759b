"""The command `teleop-drake drive`."""

import argparse
import logging
import secrets
import sys
import time as clock
from collections.abc import Callable
from typing import TYPE_CHECKING

from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.cli.options import (
    AddEngineOption,
    AddScenarioOptions,
    LoadToRun,
    OverridesOf,
)
from teleop_drake.cli.output import PrepareFolder, WriteText
from teleop_drake.cli.server import Gate, PortOf
from teleop_drake.cli.tables import Align

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat

    from teleop_drake.driving import Drive
    from teleop_drake.driving.controls import MeshcatControls
    from teleop_drake.scenario import Scenario

_LOOK_PERIOD = 0.05

# Lower ones are the system's.
_LOWEST_PORT = 1024


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    AddScenarioOptions(parser)
    parser.add_argument(
        "--port",
        metavar="N",
        help="serve the page there (default: the first free port from 7000 on)",
    )
    parser.add_argument(
        "--host",
        default="localhost",
        metavar="ADDRESS",
        help="serve the page to whom this address reaches; 0.0.0.0: to the whole "
        "network, a lecture room for example (default: localhost, to this machine)",
    )
    parser.add_argument(
        "--wait",
        type=float,
        metavar="S",
        help="how long to wait for a browser; 0: begin at once (default: for ever)",
    )
    parser.add_argument(
        "--gamepad",
        action="store_true",
        help="drive with the browser's gamepad only, and wait for one",
    )
    parser.add_argument(
        "--rate",
        type=float,
        default=1.0,
        metavar="X",
        help="simulated seconds in a second (default: 1)",
    )
    AddEngineOption(parser)
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="write each segment there: recording (.npz), what the hand did (.csv) and "
        "the scenario that repeats it (.yaml)",
    )
    parser.add_argument("--quiet", action="store_true", help="print the scores only")


def Execute(args: argparse.Namespace) -> int:
    """Drives, prints the scores, and writes what was driven."""
    from teleop_drake.driving.settings import LoadDriven

    LoadToRun(args)
    try:
        scenario = LoadDriven(args.scenario, OverridesOf(args))
    except ValueError as e:
        raise BadInput(e) from None
    _Check(args)
    PrepareFolder(args.out, *_Names(1))
    meshcat, place = _MakeMeshcat()
    url = Gate(place, args.host, PortOf(args.port, _LOWEST_PORT)).url

    def Say(line: str) -> None:
        if not args.quiet:
            print(line, file=sys.stderr, flush=True)

    drive = _MakeDrive(args, scenario, meshcat, url, Say)
    _Interruptibly(drive, args, Say)
    _Report(drive, args, Say)
    return 0


def _Check(args: argparse.Namespace) -> None:
    """Refuses options that are out of their range."""
    if not args.rate > 0:
        raise BadInput(f"--rate = {args.rate:g}: must be > 0")
    if args.wait is not None and not args.wait >= 0:
        raise BadInput(f"--wait = {args.wait:g}: must be >= 0 (s)")


def _Names(number: int) -> tuple[str, str, str]:
    """Returns the names of a segment's files."""
    stem = f"drive_{number:02d}"
    return f"{stem}.npz", f"{stem}.csv", f"{stem}.yaml"


def _MakeMeshcat() -> tuple["Meshcat", tuple[str, int]]:
    """Returns a page without anything on it, and where it is served.

    Meshcat answers everybody. So it is where no other page looks for it, and browsers
    come to it through a Gate.
    """
    from pydrake.geometry import Meshcat, MeshcatParams

    host = "127.0.0.1"
    if sys.platform == "linux":  # There all of 127.0.0.0/8 is this machine.
        host = ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])
    # It would say where it listens, which comes later with more words.
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.WARNING)
    try:
        meshcat = Meshcat(MeshcatParams(host=host, port=0))
    finally:
        log.setLevel(level)
    return meshcat, (host, meshcat.port())


def _MakeDrive(
    args: argparse.Namespace,
    scenario: "Scenario",
    meshcat: "Meshcat",
    url: str,
    say: Callable[[str], None],
) -> "Drive":
    """Returns the drive, after a browser, and perhaps a gamepad, is there."""
    from teleop_drake.driving import Drive, MakeControls, MakeView

    controls = MakeControls(meshcat, scenario, needs_gamepad=args.gamepad)
    view = MakeView(meshcat, scenario)
    view.Begin(scenario)
    say(f"Open {url}. Ctrl-C or Q ends it.")
    _WaitForHand(args, meshcat, url, controls)
    return Drive(
        args.scenario,
        OverridesOf(args),
        hand=controls,
        view=view,
        duration=None if args.duration is None else scenario.duration,
        rate=args.rate,
        engine=args.engine,
        say=say,
    )


def _WaitForHand(
    args: argparse.Namespace,
    meshcat: "Meshcat",
    url: str,
    controls: "MeshcatControls",
) -> None:
    """Waits for a browser, and for its gamepad if only that commands.

    Raises:
        BadInput: If none comes in time.
    """
    if args.wait == 0 and not args.gamepad:
        return
    begin = clock.monotonic()
    while True:
        has_browser = meshcat.GetNumActiveConnections() > 0
        if has_browser and (controls.HasGamepad() or not args.gamepad):
            return
        if args.wait is not None and clock.monotonic() - begin >= args.wait:
            break
        clock.sleep(_LOOK_PERIOD)
    if not has_browser:
        raise BadInput(
            f"--wait = {args.wait:g}: must be a time in s in which a browser opens "
            f"{url}; none did"
        )
    raise BadInput(
        "--gamepad: must be given with a gamepad that the browser knows; press one of "
        "its buttons while the page is shown"
    )


def _Interruptibly(
    drive: "Drive", args: argparse.Namespace, say: Callable[[str], None]
) -> None:
    """Drives; Ctrl-C ends it as the time does."""
    from teleop_drake.driving.drive import IsOfPage

    try:
        drive.Run()
    except KeyboardInterrupt:
        # Between two segments; within one simulate() notes it.
        return
    except RuntimeError as error:
        if not IsOfPage(error):
            raise
        say(f"Ended: {error}.")
    if any(segment.was_late for segment in drive.segments):
        slowest = min(segment.rate for segment in drive.segments)
        say(
            f"This machine did not keep up: {slowest:.3g} simulated seconds a second "
            f"instead of {args.rate:g}. `--rate {0.8 * slowest:.2g}`, a longer "
            "simulator.max_step_size or fewer packets help."
        )


def _Report(
    drive: "Drive", args: argparse.Namespace, say: Callable[[str], None]
) -> None:
    """Prints the scores and writes the files."""
    from teleop_drake.driving.drive import AsRecorded
    from teleop_drake.driving.score import Scores
    from teleop_drake.scenario import ScenarioToYaml

    if not drive.segments:
        print("Nothing was driven.")
        return
    print(Align(Scores(drive.segments)))
    if args.out is None:
        return
    for number, segment in enumerate(drive.segments, start=1):
        recording_path, hand_path, scenario_path = PrepareFolder(
            args.out, *_Names(number)
        )
        recording = AsRecorded(segment, hand_path.name)
        axes = ",".join(f"v_{k + 1}" for k in range(segment.scenario.num_axes))
        rows = [",".join(map(repr, row)) for row in segment.command.tolist()]
        WriteText(hand_path, "\n".join([f"time,{axes}", *rows]) + "\n")
        WriteText(scenario_path, ScenarioToYaml(recording.scenario))
        recording.Save(recording_path)
    say(f"Written: {len(drive.segments)} segments to {args.out}")
