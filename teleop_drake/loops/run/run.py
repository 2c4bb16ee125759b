"""A run of a diagram: its specification and its outcome, for both engines."""

import math
import signal
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, NamedTuple

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, OutputPort, System

from teleop_drake.loops.framework.solver import MAX_STEPS
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.loops.numerics.step_polynomials import Series
from teleop_drake.loops.run.recording import Event

if TYPE_CHECKING:
    from teleop_drake.loops.engine.run import CompiledRun

# The most steps of a run, including rejected steps and events at one instant. Error
# control may take more steps than a scenario forces, of which MAX_STEPS are allowed.
_MOST_STEPS = 2 * MAX_STEPS

# The pace of a run is measured over so many steps.
_STRETCH = 10_000


def _NotFinite(norm: float) -> str:
    return "a signal is not finite"


class NormBound(NamedTuple):
    """The largest norm of a signal; a run ends as diverged where it is exceeded.

    Attributes:
        signal: The name of the signal; None: all recorded signals together.
        largest: The largest norm, in the unit of the signal. A norm of NaN exceeds any
            bound, also infinity.
        Reason: A function that returns the reason for the end from the norm.
    """

    signal: str | None = None
    largest: float = math.inf
    Reason: Callable[[float], str] = _NotFinite


class Job(NamedTuple):
    """The specification of a run.

    Attributes:
        diagram: The System to simulate.
        context: The Context where the run begins. It is not changed.
        config: The solver.
        duration: The duration of the run, s.
        signals: The output ports to record, by the name of the signal.
        bound: The bound at which the run ends early.
        progress: A function that is called from time to time with the simulated time
            in s; None: none.
        suppress_initialization_events: Whether the initialization events are left out,
            as Drake's InitializeParams call it: the Context is the end of an earlier
            run.
        has_events: Whether the events that blocks locate are found.
        publish_period: The time between the rows of the recording, s; None: the rows
            are those of the steps.
        has_default_signals: Whether nobody has chosen the signals, so that a compiled
            run may omit some.
    """

    diagram: System
    context: Context
    config: SimulatorConfig
    duration: float
    signals: Mapping[str, OutputPort]
    bound: NormBound = NormBound()
    progress: Callable[[float], None] | None = None
    suppress_initialization_events: bool = False
    has_events: bool = False
    publish_period: float | None = None
    has_default_signals: bool = False

    @property
    def start(self) -> float:
        """The time when the run begins, s."""
        return float(self.context.get_time())

    @property
    def end(self) -> float:
        """The time when the run ends, s."""
        return self.start + self.duration


class Ending(NamedTuple):
    """How a run has ended.

    Attributes:
        termination: As in Recording.
        reason: Why the run did not complete, as in Recording.
    """

    termination: str
    reason: str = ""


COMPLETED = Ending("completed")
INTERRUPTED = Ending("interrupted", "interrupted by the user")
"""The ending of a run after Ctrl-C; it takes precedence over all other endings."""


Bent = tuple[Collection[str], Collection[str]]
"""What find_bends of an Outcome returns."""


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
        is_beyond_bound: Whether it ended because a finite norm exceeded the bound.
        systems: The systems of the model by their paths.
        make_final_context: A function that returns the Context at the end of the run;
            None if there is no such Context, see Recording.
        notes: Remarks on the run.
        find_events: A function that returns the events that blocks have located, from
            the outcome. It does not refer to the outcome: the memory of a run would be
            released by the collector of cycles only.
        find_bends: A function that returns, from the outcome, the names of signals that
            are not accurate between rows, and of inputs of delays that jump or bend
            within a step.
    """

    engine: str
    series: Series
    steps: int
    derivative_evaluations: int
    wall_time: float
    ending: Ending
    is_beyond_bound: bool
    systems: Mapping[str, System]
    make_final_context: Callable[[], Context] | None = None
    notes: Sequence[str] = ()
    find_events: Callable[["Outcome"], list[Event]] = lambda outcome: []
    find_bends: Callable[["Outcome"], Bent] = lambda outcome: ((), ())


def FindEvents(run: "CompiledRun", end: float, outcome: Outcome) -> list[Event]:
    """Returns the events of a compiled run; imports what finds them when asked."""
    from teleop_drake.loops.run.block_events import CompiledEvents

    return CompiledEvents(run, end, outcome)


def FindBends(run: "CompiledRun", outcome: Outcome) -> tuple[list[str], list[str]]:
    """Returns the signals of Outcome.find_bends of a compiled run, as FindEvents()."""
    from teleop_drake.loops.run.block_events import CompiledBends

    return CompiledBends(run, outcome.series)


def FindComponents(job: Job) -> dict[str, list[str]]:
    """Returns the names of the components of a job's signals, as FindEvents()."""
    from teleop_drake.loops.engine.components import ComponentsIn

    return ComponentsIn(job.diagram, job.signals)


class Pace:
    """A limit to the number of steps of a run.

    A loop may be so stiff that the solver takes steps of nanoseconds.

    Args:
        duration: The duration of the run, s.
        start: The time when it begins, s.
    """

    def __init__(self, duration: float, start: float = 0.0):
        self._duration = duration
        self._start = start
        self._num_steps = 0
        self._time = start

    def Check(self, num_steps: int, time: float) -> None:
        """Extrapolates the number of steps of a run, after every 10 000 steps.

        Args:
            num_steps: Number of steps so far.
            time: The simulated time, s.

        Raises:
            ScenarioError: If the run would take more than 2 000 000 steps at the pace
                of the last steps.
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
                f"events, that the last {steps} steps advanced it by {gone:.2g} s, and "
                f"more than {_MOST_STEPS} would be needed"
            )
        self._num_steps = num_steps
        self._time = time


class Interruption:
    """A handler of Ctrl-C with which a run ends at the end of a step.

    A KeyboardInterrupt within a step could leave a partly written state. A second
    Ctrl-C raises KeyboardInterrupt at once, for systems that never return.

    Attributes:
        has_come: Whether Ctrl-C was pressed.
    """

    def __init__(self) -> None:
        self.has_come = False
        self._is_watching = False

    def __enter__(self) -> "Interruption":
        handler = signal.default_int_handler
        self._is_watching = (
            # Only the main thread receives signals and can set their handlers.
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
