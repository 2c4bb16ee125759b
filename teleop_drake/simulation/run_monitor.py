"""The monitor of a run: it records, and ends a run that cannot go on."""

import math
import signal
import threading
import time as clock
from collections.abc import Callable
from types import FrameType

import numpy as np
from pydrake.systems.framework import (
    Context,
    Diagram,
    EventStatus,
)

from teleop_drake.numerics.step_polynomials import DEGREE, Series, shares
from teleop_drake.scenario.scenario import MAX_STEPS
from teleop_drake.signals import SignalsOf
from teleop_drake.tasks.base import SpeedLimit
from teleop_drake.validation import ScenarioError

# How often progress is reported, in s of real time.
_REPORT_PERIOD = 0.1

# Steps of a run, among them those that were tried in vain and events at one instant.
# Error control may want a few more than a run is forced to take.
_MOST_STEPS = 2 * MAX_STEPS

# In so many steps a run shows its pace.
_STRETCH = 10_000


class Pace:
    """Refuses to go on with a run that would take steps without end.

    A loop may be so stiff that the solver takes ever so many steps of nanoseconds.

    Args:
        duration: How far the run should come, s.
    """

    def __init__(self, duration: float):
        self._duration = duration
        self._num_steps, self._time = 0, 0.0

    def Check(self, num_steps: int, time: float) -> None:
        """Looks at how far a run has come, after 10 000 steps again.

        Args:
            time: How far it has come, s.

        Raises:
            ScenarioError: If it would take more than 2 000 000 steps, as it goes on.
        """
        steps, gone = num_steps - self._num_steps, time - self._time
        if steps < _STRETCH:
            return
        if num_steps * gone + steps * (self._duration - time) > _MOST_STEPS * gone:
            raise ScenarioError(
                f"duration = {self._duration:g}: must be at most {time:.3g} s here, "
                f"which took {num_steps} steps; the loop is so stiff, or has so many "
                f"events, that the last {steps} steps came {gone:.2g} s further, and "
                f"more than {_MOST_STEPS} would be needed"
            )
        self._num_steps, self._time = num_steps, time


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


class Recorder:
    """Samples every vector output of the systems of a diagram, step by step.

    Drake tells the states at the ends of a step only. Within it they are the cubic
    polynomials that have their rates there, and the outputs are evaluated at these
    states, in a Context of its own.

    Attributes:
        names: Of the signals, in the order of a sample's values.
        inner_context: In which the outputs within a step are evaluated.
    """

    def __init__(self, diagram: Diagram, root_context: Context):
        signals = SignalsOf(diagram)
        self.names = list(signals)
        self.inner_context = root_context.Clone()
        self._at_end, self._inside = (
            [
                (port.Eval, port.get_system().GetMyContextFromRoot(root))
                for port in signals.values()
            ]
            for root in (root_context, self.inner_context)
        )
        self._diagram = diagram
        self._root_context = root_context
        self._rows: list[tuple[float, list[np.ndarray]]] = []
        self._step_ends: list[int] = []
        self._state = self._rate = np.empty(0)

    def Sample(self) -> list[np.ndarray]:
        """Takes a sample now, and those in the step that ends; returns its values."""
        time, root = self._root_context.get_time(), self._root_context
        values = [evaluate(context) for evaluate, context in self._at_end]
        state = root.get_continuous_state_vector().CopyToVector()
        rate = self._diagram.EvalTimeDerivatives(
            self._diagram.GetMyContextFromRoot(root)
        ).CopyToVector()
        if self._rows and time > self._rows[-1][0]:
            self._SampleInside(time, state, rate)
            self._step_ends.append(len(self._rows))
        self._rows.append((time, values))
        self._state, self._rate = state, rate
        return values

    def _SampleInside(self, end: float, state: np.ndarray, rate: np.ndarray) -> None:
        """Takes the samples between the last one and a time."""
        inner, begin = self.inner_context, self._rows[-1][0]
        inner.SetTimeStateAndParametersFrom(self._root_context)
        h = end - begin
        for s in shares(DEGREE)[1:-1].tolist():
            inner.SetTime(begin + s * h)
            inner.SetContinuousState(
                (1 - s) ** 2 * ((1 + 2 * s) * self._state + s * h * self._rate)
                + s**2 * ((3 - 2 * s) * state - (1 - s) * h * rate)
            )
            values = [evaluate(context) for evaluate, context in self._inside]
            self._rows.append((begin + s * h, values))

    def Finish(self) -> Series:
        """Returns the times (N,), the signals (N, k) and the steps."""
        times = np.array([time for time, _ in self._rows])
        signals = {
            name: np.array([values[i] for _, values in self._rows])
            for i, name in enumerate(self.names)
        }
        ends = np.array(self._step_ends, int)
        return times, signals, ends[:, np.newaxis] + np.arange(-DEGREE, 1)


class RunMonitor:
    """Watches a run: what happens at each step.

    Attributes:
        recorder: What it records with.
        failure: Why the run cannot go on; empty while it can.
        interruption: Ends it because of Ctrl-C.
    """

    def __init__(
        self,
        diagram: Diagram,
        root_context: Context,
        *,
        duration: float,
        speed_limit: SpeedLimit,
        progress: Callable[[float], None] | None,
        count_rejected: Callable[[], int],
    ):
        self._pace = Pace(duration)
        self._num_samples = 0
        self._count_rejected = count_rejected
        self.recorder = Recorder(diagram, root_context)
        self.failure = ""
        self.interruption = Interruption()
        self._speed_limit = speed_limit
        self._diagram = diagram
        self._progress = progress
        self._last_report = clock.monotonic()
        names = self.recorder.names
        # Without a tool, whatever is recorded has to stay finite.
        self._watched = [i for i, x in enumerate(names) if x == "tool_velocity"]
        self._watched = self._watched or list(range(len(names)))

    def Monitor(self, root_context: Context) -> EventStatus:
        """Records the end of a step; ends the run if it cannot go on."""
        now = self.recorder.Sample()
        time = root_context.get_time()
        self._num_samples += 1
        self._pace.Check(self._num_samples + self._count_rejected(), time)
        speed = math.hypot(*(x for i in self._watched for x in now[i]))
        if not speed <= self._speed_limit.speed:
            self.failure = self._speed_limit.Reason(speed)
            return EventStatus.ReachedTermination(self._diagram, self.failure)
        if (
            self._progress is not None
            and clock.monotonic() > self._last_report + _REPORT_PERIOD
        ):
            self._last_report = clock.monotonic()
            self._progress(time)
        if self.interruption.has_come:
            return EventStatus.ReachedTermination(self._diagram, "interrupted")
        return EventStatus.DidNothing()
