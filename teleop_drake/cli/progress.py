"""Progress of long work, on stderr."""

import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING

from teleop_drake.cli.exit_codes import BadInput, Failed

if TYPE_CHECKING:
    from teleop_drake.recording import Recording
    from teleop_drake.scenario import AnyScenario


# For how long nothing is shown, in s of real time.
_PATIENCE = 2.0


def Simulate(scenario: "AnyScenario", is_quiet: bool, engine: str) -> "Recording":
    """Returns the recording of a run; shows its progress unless it is quiet.

    Args:
        scenario: What to simulate.
        is_quiet: Whether to show no progress; what is left out is said all the same.
        engine: As simulate() takes it. Why it cannot be used goes to stderr.

    Raises:
        BadInput: If the scenario is not valid, or comes no further.
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
    except ScenarioError as error:  # It would take steps without end, say.
        raise BadInput(error) from None
    except OSError:
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


class _Progress:
    """Shows on stderr what a run is doing; a context manager.

    It begins after 2 s of real time. A terminal gets one line that changes, a file
    gets a line every 10 s.

    Args:
        scenario: What is run.
    """

    def __init__(self, scenario: "AnyScenario"):
        self._scenario = scenario
        self._is_terminal = sys.stderr.isatty()
        self._period = 0.2 if self._is_terminal else 10.0
        self._next_report = time.monotonic() + _PATIENCE
        self._is_shown = False
        self._timer: threading.Timer | None = None

    def __enter__(self) -> "_Progress":
        return self

    def __exit__(self, *exception: object) -> None:
        self._StopTimer()
        if self._is_shown and self._is_terminal:
            print(file=sys.stderr)

    def __call__(self, simulated_time: float) -> None:
        """Shows the simulated time.

        Args:
            simulated_time: In s.
        """
        self._StopTimer()
        if time.monotonic() >= self._next_report:
            self._next_report = time.monotonic() + self._period
            self._Show(f"{simulated_time:.1f} of {self._scenario.duration:g} s")

    def Say(self, text: str) -> None:
        """Shows a text, if what it is about takes its time.

        Args:
            text: What is done until the next call.
        """
        self._StopTimer()
        self._timer = threading.Timer(_PATIENCE, self._Show, [text])
        self._timer.daemon = True
        self._timer.start()

    def _StopTimer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _Show(self, text: str) -> None:
        self._is_shown = True
        text = f"{self._scenario.name}, {self._scenario.controller.kind}: {text}"
        print(
            f"\r{text:<60}" if self._is_terminal else text,
            end="" if self._is_terminal else "\n",
            file=sys.stderr,
            flush=True,
        )


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
