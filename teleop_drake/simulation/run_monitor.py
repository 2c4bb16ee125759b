"""What watches a run: it records, and says where the simulator has to stop."""

import contextlib
import math
import signal
import threading
import time as clock
from collections.abc import Callable, Iterator
from types import FrameType
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    Context,
    Diagram,
    EventStatus,
    PortDataType,
)

from teleop_drake.channels.delay_line import DelayLine
from teleop_drake.scenario import Scenario

# A step across a border as short as twice this many s is not bisected any further.
_EVENT_WINDOW = 2e-7

# After a jump or a kink the first steps are this share of the longest one, and then
# each is at most that share of the time since. A delayed signal is a polynomial through
# the steps of its sender: behind a jump there are none but the new ones, and they set
# its error, which error control does not see. Steps grow even more slowly after a
# crossing of a border, because Drake's error norm is absolute and hardly sees a tool
# that bounces by micrometres. Of some thirty settings these were chosen, which keep
# one_dof within 1e-5 of its signals' ranges at 46 of 50 delays from 0.02 to 0.4 s.
_FIRST_STEP = 1 / 8
_STEP_GROWTH = 0.04
_STEP_GROWTH_AFTER_CROSSING = 0.02

# How often progress is reported, in s of real time.
_REPORT_PERIOD = 0.1

_SIGNAL_NAMES = {
    ("master", "forward_packet"): "forward_packet_sent",
    ("forward_channel", "delayed_signal"): "forward_packet_received",
    ("controller", "return_packet"): "return_packet_sent",
    ("return_channel", "delayed_signal"): "return_packet_received",
    ("environment", "layer"): "environment_layer",
}


class Recorder:
    """Samples every vector output of the systems of a diagram.

    Attributes:
        names: Of the signals, in the order of a sample's values.
    """

    def __init__(self, diagram: Diagram, root_context: Context):
        self.names: list[str] = []
        self._evaluators: list[tuple[Callable[[Context], np.ndarray], Context]] = []
        for system in diagram.GetSystems():
            context = system.GetMyContextFromRoot(root_context)
            for i in range(system.num_output_ports()):
                port = system.get_output_port(i)
                if port.get_data_type() == PortDataType.kVectorValued:
                    key = (system.get_name(), port.get_name())
                    self.names.append(_SIGNAL_NAMES.get(key, port.get_name()))
                    self._evaluators.append((port.Eval, context))
        self._root_context = root_context
        self._rows: list[tuple[float, list[np.ndarray]]] = []

    def Sample(self) -> list[np.ndarray]:
        """Takes a sample now and returns its values."""
        values = [evaluate(context) for evaluate, context in self._evaluators]
        self._rows.append((self._root_context.get_time(), values))
        return values

    def DropLast(self) -> None:
        """Forgets the last sample."""
        self._rows.pop()

    def Finish(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Returns the times (N,) and the signals (N, k)."""
        times = np.array([time for time, _ in self._rows])
        return times, {
            name: np.array([values[i] for _, values in self._rows])
            for i, name in enumerate(self.names)
        }


class RunMonitor:
    """Watches a run: what happens at each step, and where the next ones should end.

    Attributes:
        recorder: What it records with.
        failure: Why the run cannot go on; empty while it can.
        is_interrupted: Whether it is to end because of Ctrl-C.
        speed_limit: Of the tool, in m/s.
    """

    def __init__(
        self,
        diagram: Diagram,
        root_context: Context,
        *,
        duration: float,
        speed_limit: float,
        limit_name: str,
        progress: Callable[[float], None] | None,
    ):
        self.recorder = Recorder(diagram, root_context)
        self.failure = ""
        self.is_interrupted = False
        self.speed_limit = speed_limit
        self._diagram = diagram
        self._context = root_context
        self._duration = duration
        self._limit_name = limit_name
        self._progress = progress
        self._last_report = clock.monotonic()
        self._velocity = self.recorder.names.index("tool_velocity")

    def Monitor(self, root_context: Context) -> EventStatus:
        """Records the end of a step; ends AdvanceTo() if there is more to do."""
        now = self.recorder.Sample()
        time = root_context.get_time()
        speed = math.hypot(*now[self._velocity])
        if not speed <= self.speed_limit:
            self.failure = (
                f"the tool's speed, {speed:.4g} m/s, exceeds {self._limit_name}"
            )
            if not math.isfinite(speed):
                self.recorder.DropLast()
            return EventStatus.ReachedTermination(self._diagram, self.failure)
        if (
            self._progress is not None
            and clock.monotonic() > self._last_report + _REPORT_PERIOD
        ):
            self._last_report = clock.monotonic()
            self._progress(time)
        if self.is_interrupted or self._MustStop(now):
            return EventStatus.ReachedTermination(self._diagram, "stop")
        return EventStatus.DidNothing()

    def _MustStop(self, now: list[np.ndarray]) -> bool:
        """Returns whether AdvanceTo() has to end with this step.

        Args:
            now: The sample taken at its end.
        """
        return False

    @contextlib.contextmanager
    def InterruptAtSteps(self) -> Iterator[None]:
        """Lets Ctrl-C end the run with the step, instead of anywhere in Python.

        Machine code that calls Python, as numba's does for each array that it returns,
        does not expect an exception there, and KeyboardInterrupt would become another.
        A second Ctrl-C is a KeyboardInterrupt at once, for systems that never return.
        """
        handler = signal.default_int_handler
        if (
            # Only there are signals handled, or their handlers set.
            threading.current_thread() is not threading.main_thread()
            or signal.getsignal(signal.SIGINT) is not handler
        ):
            yield
            return

        def Note(signal_number: int, frame: FrameType | None) -> None:
            self.is_interrupted = True
            signal.signal(signal.SIGINT, handler)

        signal.signal(signal.SIGINT, Note)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, handler)

    def AtJump(self) -> bool:
        """Returns whether an event that makes signals jump is pending now."""
        return False

    def NextStop(self) -> float:
        """Returns where the simulator should stop next, in s."""
        return self._duration


class _Motion(NamedTuple):
    """Something that moves along x."""

    position: float
    velocity: float
    acceleration: float
    borders: list[float]


class TeleoperatorMonitor(RunMonitor):
    """Watches the run of a teleoperator, whose signals jump.

    The simulator runs by itself except near a jump. There it stops, so that both
    sides are recorded. It is led up to a border by short steps, because finding the
    crossing by bisection would cost a hundred times more.
    """

    def __init__(
        self,
        scenario: Scenario,
        teleoperator: Diagram,
        simulator: Simulator,
        progress: Callable[[float], None] | None,
    ):
        root_context = simulator.get_mutable_context()
        ratio = scenario.divergence_speed_ratio
        super().__init__(
            teleoperator,
            root_context,
            duration=scenario.duration,
            speed_limit=ratio * float(np.linalg.norm(scenario.surgeon.velocity)),
            limit_name=f"{ratio:g} times the commanded speed",
            progress=progress,
        )
        self._scenario = scenario
        self._channels = [
            (system, system.GetMyContextFromRoot(root_context))
            for system in teleoperator.GetSystems()
            if hasattr(system, "NextJumpTime")
        ]
        self._has_delay_lines = any(
            isinstance(system, DelayLine) for system, _ in self._channels
        )
        # Where the force on the tool jumps or has a kink, and where the surgeon feels
        # contact.
        self._force_borders = [layer.start for layer in scenario.environment.layers]
        surface = scenario.contact_surface
        self._surfaces = [] if surface is None else [surface]
        place = {name: i for i, name in enumerate(self.recorder.names)}
        self._position = place["tool_position"]
        self._acceleration = place.get("tool_acceleration")
        self._mode = place["surgeon_mode"]
        # In the thesis's architectures both are in the packet, [p_WT; v_WT].
        self._felt = place.get("felt_position", place["return_packet_received"])
        self._felt_velocity = place.get("felt_velocity")
        self._integrator = simulator.get_mutable_integrator()
        self._longest_step = self._integrator.get_maximum_step_size()
        self._step_limit = self._longest_step
        self._motions: list[_Motion] = []
        self._last_jump = 0.0
        self._crossing_time = -math.inf
        self._next_jump = math.inf
        self._stop = 0.0

    def _MustStop(self, now: list[np.ndarray]) -> bool:
        before, self._motions = self._motions, self._FindMotions(now)
        for last, motion in zip(before, self._motions, strict=False):
            for border in motion.borders:
                if (last.position < border) != (motion.position < border):
                    self._crossing_time = self._context.get_time()
        is_at_jump = self.AtJump()
        if self._has_delay_lines:
            self._LimitStep(is_at_jump)
        return (
            is_at_jump
            or self._ApproachTime() < math.inf
            or self._FindNextJump() < self._stop
        )

    def AtJump(self) -> bool:
        """Returns whether an event that makes signals jump is pending now."""
        return self._context.get_time() in (
            self._crossing_time,
            self._next_jump,
            self._scenario.surgeon.stop_time,
        )

    def _LimitStep(self, is_at_jump: bool) -> None:
        """Makes the steps after a jump short, and then longer and longer."""
        time = self._context.get_time()
        if is_at_jump:
            self._last_jump = time
        shortest = _FIRST_STEP * self._longest_step
        step = min(
            _STEP_GROWTH * (time - self._last_jump),
            _STEP_GROWTH_AFTER_CROSSING * (time - self._crossing_time),
            self._longest_step,
        )
        step = max(step, shortest)
        if step != self._step_limit:
            self._step_limit = step
            self._integrator.set_maximum_step_size(step)

    def NextStop(self) -> float:
        """Returns where the simulator should stop next, in s."""
        self._next_jump = self._FindNextJump()
        self._stop = min(
            self._next_jump,
            self._context.get_time() + self._ApproachTime(),
            self._duration,
        )
        return self._stop

    def _FindNextJump(self) -> float:
        return min(
            (channel.NextJumpTime(context) for channel, context in self._channels),
            default=math.inf,
        )

    def _FindMotions(self, now: list[np.ndarray]) -> list[_Motion]:
        """Returns what moves towards which borders.

        Only the steps towards a border depend on velocity and acceleration, so they
        may be off.
        """
        felt = now[self._felt]
        if self._felt_velocity is None:
            felt_velocity = felt[len(felt) // 2 :]
        else:
            felt_velocity = now[self._felt_velocity]
        acceleration = 0.0
        if self._acceleration is not None:
            acceleration = now[self._acceleration].item(0)
        awaits_contact = now[self._mode].item(0) == 0
        return [
            _Motion(
                now[self._position].item(0),
                now[self._velocity].item(0),
                acceleration,
                self._force_borders,
            ),
            _Motion(
                felt.item(0),
                felt_velocity.item(0),
                0.0,
                self._surfaces if awaits_contact else [],
            ),
        ]

    def _ApproachTime(self) -> float:
        """Returns the length of a step towards a border ahead, infinity if none is.

        It covers most of the way, or a little more than the whole if that is short
        enough for Drake to accept the step as the location of the crossing.
        """
        horizon = 1.5 * self._longest_step
        shortest = math.inf
        for x, v, a, borders in self._motions:
            reach = (abs(v) + abs(a) * horizon / 2) * horizon
            for border in borders:
                if abs(border - x) > reach:
                    continue
                time = _TimeToCross(border - x, v, a)
                if time >= horizon:
                    continue
                # What the acceleration's change does to the time is of third order.
                margin = 0.1 * time * (time / horizon) ** 2
                if margin > _EVENT_WINDOW:
                    time -= margin
                else:
                    time += _EVENT_WINDOW
                shortest = min(shortest, time)
        return shortest


def _TimeToCross(gap: float, v: float, a: float) -> float:
    """Returns the smallest t > 0 with gap = v t + a t^2 / 2, or infinity."""
    if not math.isfinite(gap) or gap == 0:
        return math.inf
    discriminant = v * v + 2 * a * gap
    if discriminant < 0:
        return math.inf
    # Both roots in the form that does not cancel.
    q = v + math.copysign(math.sqrt(discriminant), v)
    roots = [2 * gap / q] if q != 0 else []
    if a != 0:
        roots.append(q / a)
    return min((root for root in roots if root > 0), default=math.inf)
