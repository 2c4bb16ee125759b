"""Progress of long work, on stderr."""

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from teleop_drake.cli.exit_codes import Failed

if TYPE_CHECKING:
    from teleop_drake.model.scenario import AnyScenario
    from teleop_drake.model.task_recording import TaskRecording


def Notice(text: object) -> None:
    """Prints a line for the user on stderr."""
    print(f"teleop-drake: {text}", file=sys.stderr, flush=True)


def TellLine(is_quiet: bool, line: str) -> None:
    """Prints a line about progress or a result on stderr, unless `is_quiet`."""
    if not is_quiet:
        print(line, file=sys.stderr, flush=True)


def Simulate(scenario: "AnyScenario", is_quiet: bool, engine: str) -> "TaskRecording":
    """Simulates a scenario, shows its progress unless `is_quiet`, returns a recording.

    Warnings, and why an engine cannot be used, are printed on stderr in any case.

    Raises:
        ScenarioError: If the scenario is invalid, or takes too many steps.
        Failed: If a block of the loop raises an error; it names the block.
    """
    from teleop_drake.loops.run.failures import FirstLine
    from teleop_drake.model.run.simulate import simulate
    from teleop_drake.model.scenario import ScenarioError

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
    """Yields a function that shows the progress and the time left on stderr.

    The function takes the number of finished runs and the number of all runs.
    """
    with ExitStack() as stack:
        bar: Any = None

        def Report(num_finished: int, num_runs: int) -> None:
            nonlocal bar
            if bar is None:  # A resumed sweep has finished some before.
                bar = _Bar(is_quiet, what, num_runs, initial=num_finished)
                stack.enter_context(bar)
            bar.update(num_finished - bar.n)

        yield Report


def _Bar(
    is_quiet: bool, unit: str, total: float, *, title: str = "", initial: int = 0
) -> Any:
    """Returns a bar of tqdm on stderr.

    A terminal shows it until the work is done; a file gets a line every 10 s.
    """
    from tqdm import tqdm

    is_terminal = sys.stderr.isatty()
    period = 0.2 if is_terminal else 10.0
    text = "{desc}{n:.4g} of {total:g} {unit}, {remaining} left"
    tqdm.monitor_interval = 0  # No monitor thread, because sweeps fork this process.
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
