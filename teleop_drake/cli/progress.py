"""Progress of long work, on stderr."""

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from teleop_drake.cli.exit_codes import Failed

if TYPE_CHECKING:
    from teleop_drake.recording import Recording
    from teleop_drake.scenario import AnyScenario


def Notice(text: object) -> None:
    """Prints a line for the user on stderr."""
    print(f"teleop-drake: {text}", file=sys.stderr, flush=True)


def TellLine(is_quiet: bool, line: str) -> None:
    """Prints what is made now, or what is found, on stderr, unless it is quiet."""
    if not is_quiet:
        print(line, file=sys.stderr, flush=True)


def Simulate(scenario: "AnyScenario", is_quiet: bool, engine: str) -> "Recording":
    """Returns the recording of a run; shows its progress unless it is quiet.

    Warnings, and why an engine cannot be used, go to stderr all the same.

    Raises:
        ScenarioError: If the scenario is not valid, or comes no further.
        Failed: If a block of the loop raises an error; it names the block.
    """
    from teleop_drake.scenario import ScenarioError
    from teleop_drake.simulation import simulate
    from teleop_drake.simulation.failures import FirstLine

    try:
        name = f"{scenario.name}, {scenario.controller.kind}: "
        with (
            warnings.catch_warnings(record=True, action="always") as warned,
            _Bar(is_quiet, "s", scenario.duration, title=name) as bar,
        ):
            recording = simulate(
                scenario,
                progress=lambda time: bar.update(time - bar.n),
                engine=engine,
            )
    except (ScenarioError, OSError):
        raise
    except Exception as error:
        raise Failed(
            f"the run failed: {type(error).__name__}: {FirstLine(error)}"
        ) from error
    notes = [x.message for x in warned if x.category is UserWarning]
    for note in (*notes, *recording.notes):
        Notice(note)
    return recording


@contextmanager
def SweepProgress(
    is_quiet: bool, what: str = "runs"
) -> Iterator[Callable[[int, int], None]]:
    """Yields a function that shows the finished runs and the time left on stderr."""
    with ExitStack() as stack:
        bar: Any = None

        def Report(num_finished: int, num_runs: int) -> None:
            nonlocal bar
            if bar is None:  # An interrupted sweep has finished some before.
                bar = _Bar(is_quiet, what, num_runs, initial=num_finished)
                stack.enter_context(bar)
            bar.update(num_finished - bar.n)

        yield Report


def _Bar(
    is_quiet: bool, unit: str, total: float, *, title: str = "", initial: int = 0
) -> Any:
    """Returns a bar of tqdm on stderr.

    A terminal has it while the work goes on; a file gets a line every 10 s.
    """
    from tqdm import tqdm

    is_terminal = sys.stderr.isatty()
    period = 0.2 if is_terminal else 10.0
    text = "{desc}{n:.4g} of {total:g} {unit}, {remaining} left"
    tqdm.monitor_interval = 0  # No thread: sweeps fork.
    return tqdm(
        total=total,
        unit=unit,
        disable=is_quiet,
        delay=period,
        mininterval=period,
        miniters=0,
        smoothing=0,
        leave=False,
        dynamic_ncols=True,
        bar_format=text + (" {bar}" if is_terminal else "\n"),
        desc=title,
        initial=initial,
    )
