"""A run of a diagram, whichever engine does it."""

import signal
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import FrameType
from typing import NamedTuple

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, System

from teleop_drake.numerics.step_polynomials import Series
from teleop_drake.scenario.loading import MAX_STEPS
from teleop_drake.tasks.base import SpeedLimit
from teleop_drake.validation import ScenarioError

# Steps of a run, among them those that were tried in vain and events at one instant.
# Error control may want a few more than a run is forced to take.
_MOST_STEPS = 2 * MAX_STEPS

# In so many steps a run shows its pace.
_STRETCH = 10_000


class Job(NamedTuple):
    """What to run.

    Attributes:
        diagram: The model.
        context: Where the run begins. It is not changed.
        config: The solver.
        duration: How long, s.
        speed_limit: When to end early.
        progress: Called now and then with the simulated time in s.
        continues: Whether an earlier run has ended there, so that the initialization
            events have happened.
    """

    diagram: System
    context: Context
    config: SimulatorConfig
    duration: float
    speed_limit: SpeedLimit
    progress: Callable[[float], None] | None
    continues: bool = False

    @property
    def start(self) -> float:
        """When the run begins, s."""
        return float(self.context.get_time())

    @property
    def end(self) -> float:
        """When the run ends, s."""
        return self.start + self.duration


class Ending(NamedTuple):
    """How a run has ended.

    Attributes:
        termination: As in Recording, and so is the reason.
        reason: Why it did not complete.
    """

    termination: str
    reason: str = ""


COMPLETED = Ending("completed")
INTERRUPTED = Ending("interrupted", "interrupted by the user")
"""A run that was ended by Ctrl-C, whatever else was about to end it."""


@dataclass(kw_only=True)
class Outcome:
    """The outcome of a run.

    Attributes:
        engine: As in SolverStatistics.
        series: The times (N,), the signals by name (N, k), and the steps.
        steps: Number of steps taken.
        derivative_evaluations: Number of evaluations of the time derivatives.
        wall_time: Real time that it took, in s.
        ending: How it has ended.
        is_too_fast: Whether it ended because the tool was faster than allowed.
        systems: The systems of the model by their paths.
        make_final_context: Returns the Context at the end of the run; None if it has
            none, as in Recording.
    """

    engine: str
    series: Series
    steps: int
    derivative_evaluations: int
    wall_time: float
    ending: Ending
    is_too_fast: bool
    systems: Mapping[str, System]
    make_final_context: Callable[[], Context] | None = None


class Pace:
    """Refuses to go on with a run that would take steps without end.

    A loop may be so stiff that the solver takes ever so many steps of nanoseconds.

    Args:
        duration: How far the run should come, s.
        start: When it begins, s.
    """

    def __init__(self, duration: float, start: float = 0.0):
        self._duration = duration
        self._start = start
        self._num_steps = 0
        self._time = start

    def Check(self, num_steps: int, time: float) -> None:
        """Looks at how far a run has come, after 10 000 steps again.

        Args:
            time: How far it has come, s.

        Raises:
            ScenarioError: If it would take more than 2 000 000 steps, as it goes on.
        """
        steps = num_steps - self._num_steps
        if steps < _STRETCH:
            return
        gone = time - self._time
        ahead = self._start + self._duration - time
        if num_steps * gone + steps * ahead > _MOST_STEPS * gone:
            allowed = f"at most {time - self._start:.3g} s here"
            raise ScenarioError(
                f"duration = {self._duration:g}: must be {allowed}, "
                f"which took {num_steps} steps; the loop is so stiff, or has so many "
                f"events, that the last {steps} steps came {gone:.2g} s further, and "
                f"more than {_MOST_STEPS} would be needed"
            )
        self._num_steps = num_steps
        self._time = time


class Interruption:
    """Lets Ctrl-C end a run with the step, instead of anywhere in Python.

    There it could leave a state that is half written. A second Ctrl-C is a
    KeyboardInterrupt at once, for systems that never return.

    Attributes:
        has_come: Whether there was a first Ctrl-C.
    """

    def __init__(self) -> None:
        self.has_come = False
        self._is_watching = False

    def __enter__(self) -> "Interruption":
        handler = signal.default_int_handler
        self._is_watching = (
            # Only there are signals handled, or their handlers set.
            threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is handler
        )
        if self._is_watching:
            signal.signal(signal.SIGINT, self._Note)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._is_watching:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    def _Note(self, signal_number: int, frame: FrameType | None) -> None:
        self.has_come = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
