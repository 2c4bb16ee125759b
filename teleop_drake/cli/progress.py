"""Progress of long work, on stderr."""

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING

from teleop_drake.cli.exit_codes import Failed

if TYPE_CHECKING:
    from teleop_drake.recording import Recording
    from teleop_drake.scenario import AnyScenario


def Simulate(scenario: "AnyScenario", is_quiet: bool, engine: str) -> "Recording":
    """Returns the recording of a run; shows its progress unless it is quiet.

    Args:
        scenario: What to simulate.
        is_quiet: Whether to show no progress; what is left out is said all the same.
        engine: As simulate() takes it. Why it cannot be used goes to stderr.

    Raises:
        Failed: If a block of the loop raises an error; it names the block.
    """
    from teleop_drake.scenario import ScenarioError
    from teleop_drake.simulation import simulate
    from teleop_drake.simulation.failures import FirstLine

    try:
        with _Notes():
            if is_quiet:
                recording = simulate(scenario, engine=engine)
            else:
                with _Progress(scenario) as progress:
                    recording = simulate(scenario, progress=progress, engine=engine)
    except (ScenarioError, OSError):
        raise
    except Exception as error:
        raise Failed(
            f"the run failed: {type(error).__name__}: {FirstLine(error)}"
        ) from error
    for note in recording.notes:
        print(f"teleop-drake: {note}", file=sys.stderr)
    return recording


@contextmanager
def _Notes() -> Iterator[None]:
    """Turns the package's warnings into lines on stderr."""
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        yield
    for note in notes:
        if note.category is UserWarning:
            print(f"teleop-drake: {note.message}", file=sys.stderr)


@contextmanager
def _Progress(scenario: "AnyScenario") -> Iterator[Callable[[float], None]]:
    """Yields a function that shows the simulated time on stderr.

    It begins after 2 s of real time. A terminal gets one line that changes, a file
    gets a line every 10 s.
    """
    is_terminal = sys.stderr.isatty()
    period = 0.2 if is_terminal else 10.0
    next_report = time.monotonic() + 2.0
    is_shown = False

    def Report(simulated_time: float) -> None:
        nonlocal next_report, is_shown
        if time.monotonic() < next_report:
            return
        next_report = time.monotonic() + period
        is_shown = True
        text = (
            f"{scenario.name}, {scenario.controller.kind}: "
            f"{simulated_time:.1f} of {scenario.duration:g} s"
        )
        print(
            f"\r{text}" if is_terminal else text,
            end="" if is_terminal else "\n",
            file=sys.stderr,
            flush=True,
        )

    try:
        yield Report
    finally:
        if is_shown and is_terminal:
            print(file=sys.stderr)


@contextmanager
def SweepProgress(
    is_quiet: bool, what: str = "runs"
) -> Iterator[Callable[[int, int], None]]:
    """Yields a function that shows the finished runs and the time left on stderr.

    A terminal gets one line that changes, a file gets a line every 10 s.
    """
    is_terminal = sys.stderr.isatty()
    start = time.monotonic()
    next_report = start if is_terminal else start + 10.0
    num_before: int | None = None

    def Report(num_finished: int, num_runs: int) -> None:
        nonlocal num_before, next_report
        now = time.monotonic()
        if num_before is None:  # What an earlier, interrupted sweep has done.
            num_before = num_finished
        if is_quiet or now < next_report:
            return
        next_report = now + (0.2 if is_terminal else 10.0)
        text = f"{num_finished} of {num_runs} {what}"
        if num_finished > num_before:
            seconds_each = (now - start) / (num_finished - num_before)
            left = timedelta(seconds=round(seconds_each * (num_runs - num_finished)))
            text += f", {left} left"
        print(
            f"\r{text:<50}" if is_terminal else text,
            end="" if is_terminal else "\n",
            file=sys.stderr,
            flush=True,
        )

    try:
        yield Report
    finally:
        if is_terminal and not is_quiet and num_before is not None:
            print(file=sys.stderr)
