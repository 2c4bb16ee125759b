"""Runs a diagram in Drake's Simulator, with a monitor that records and checks it."""

import math
import time as clock
from collections.abc import Callable
from functools import partial
from struct import Struct

from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    InitializeParams,
    Simulator,
    SimulatorStatus,
)
from pydrake.systems.framework import Context, EventStatus

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import SystemsByPath
from teleop_drake.loops.framework.solver import EVENT_ACCURACY
from teleop_drake.loops.framework.validation import Refuse, ScenarioError
from teleop_drake.loops.kernel.block import LongestStepOf
from teleop_drake.loops.numerics.instants import TIE, same_within
from teleop_drake.loops.numerics.step_polynomials import times_every
from teleop_drake.loops.run.block_events import (
    DrakeEvents,
    GuardsDue,
    Watched,
    WatchedIn,
)
from teleop_drake.loops.run.failures import (
    IsDivergence,
    NamingBlocks,
    ReasonOfDivergence,
)
from teleop_drake.loops.run.recorder import Recorder
from teleop_drake.loops.run.recording import Event
from teleop_drake.loops.run.run import (
    COMPLETED,
    INTERRUPTED,
    Ending,
    Interruption,
    Job,
    NormBound,
    Outcome,
    Pace,
)
from teleop_drake.loops.run.simulator import (
    CountsOf,
    IsEnded,
    TeleoperatorSimulator,
)
from teleop_drake.loops.run.stale_cache_guard import HasOwnBlocks

# The most steps that a block may force on a run. Each takes some milliseconds.
_MOST_FORCED_STEPS = 100_000

# The beginning of the names of signals that are recorded to find events.
_HIDDEN = "\0"

# The steps of a run, with those rejected, are counted after so many samples.
_SAMPLES_PER_COUNT = 16

# How often progress is reported, in s of real time.
_REPORT_PERIOD = 0.1


def RunInDrake(job: Job) -> Outcome:
    """Runs a system in Drake's Simulator.

    A system without a block of this package runs in the plain Simulator.

    Raises:
        ScenarioError: If a block forces more than 100 000 steps.
    """
    _CheckSteps(job)
    simulator = _MakeSimulator(job)
    run = _DrakeRun(simulator, job)
    simulator.set_monitor(run.Monitor)
    start = clock.monotonic()
    with run.interruption as interruption:
        try:
            ending = run.Advance()
        except KeyboardInterrupt:
            if not run.has_begun:  # There is nothing to record.
                raise
            interruption.has_come = True
        except Exception as error:
            is_divergence = IsDivergence(error, simulator.get_context())
            if not (interruption.has_come or (run.has_begun and is_divergence)):
                raise
            is_controlled = not simulator.get_integrator().get_fixed_step_mode()
            reason = ReasonOfDivergence(error, has_error_control=is_controlled)
            ending = Ending("diverged", reason)
    if interruption.has_come:  # It takes precedence: it ends a whole sweep.
        ending = INTERRUPTED
    wall_time = clock.monotonic() - start
    # The monitor refers to the Context, with which pydrake keeps the Simulator alive.
    simulator.clear_monitor()
    counts = CountsOf(simulator)
    series = run.recorder.Finish()
    if ending == COMPLETED:
        series[0][-1] = job.end  # The last step ends there, up to rounding.
    for name in run.watched.sent:
        del series[1][_HIDDEN + name]
    positions = {path: series[1].pop(_HIDDEN + path) for path in run.watched.positions}
    bends = run.Bends()
    outcome = Outcome(
        engine="drake",
        series=series,
        steps=counts.steps,
        derivative_evaluations=counts.evaluations,
        wall_time=wall_time,
        ending=ending,
        is_beyond_bound=run.is_beyond_bound,
        systems=SystemsByPath(job.diagram),
        make_final_context=simulator.get_context().Clone,
        find_bends=lambda outcome: bends,
    )
    if job.has_events:
        outcome.find_events = partial(DrakeEvents, job, run.due, positions)
    return outcome


def _MakeSimulator(job: Job) -> Simulator:
    """Returns the Simulator for a system, at the start of a run."""
    context = job.context.Clone()
    kind = TeleoperatorSimulator if HasOwnBlocks(job.diagram) else Simulator
    simulator = kind(job.diagram, context)
    ApplySimulatorConfig(job.config, simulator)
    context.SetTime(job.start)
    if context.get_accuracy() is None:
        context.SetAccuracy(EVENT_ACCURACY)
    return simulator


def _CheckSteps(job: Job) -> None:
    """Refuses a run that a delay or an operator forces to take too many steps."""
    for system, context in ContextsIn(job.diagram, job.context).items():
        step = LongestStepOf(system, context)
        if step == 0:
            allowed = (
                "above 0 s in Drake's Simulator: a block made with a delay of 0, or a "
                "compiled run, passes the signal on"
            )
            Refuse(f"{system.get_name()}.delay", 0.0, allowed)
        num_steps = job.duration / step
        if num_steps > _MOST_FORCED_STEPS:
            raise ScenarioError(
                f"duration = {job.duration:g}: must be at most "
                f"{_MOST_FORCED_STEPS * step:g} s in Drake's Simulator, where "
                f"{system.get_name()} allows no step longer than {step:g} s"
            )


class _DrakeRun:
    """A run in Drake's Simulator, whose steps are recorded and checked.

    Attributes:
        recorder: The sampler of the signals.
        watched: What events depend on, besides the signals.
        due: The events of guards so far.
        is_beyond_bound: Whether the bound has ended the run.
        interruption: The handler of Ctrl-C.
    """

    def __init__(self, simulator: Simulator, job: Job):
        self._simulator = simulator
        self._job = job
        self._pace = Pace(job.duration, job.start)
        self._num_samples = 0
        self._next_count = _SAMPLES_PER_COUNT
        self.watched = Watched({}, {}, {})
        if job.has_events:
            self.watched = WatchedIn(job.diagram)
        self.due: list[Event] = []
        ports = self.watched.positions | self.watched.sent
        hidden = {_HIDDEN + name: port for name, port in ports.items()}
        self._is_bounded = job.bound != NormBound()
        # A bound and what is watched need all steps.
        needs_all = self._is_bounded or self.watched != Watched({}, {}, {})
        self._due: Array | None = None
        if job.publish_period is not None and not needs_all:
            self._due = times_every(job.publish_period, job.start, job.end)
        self.recorder = Recorder(
            job.diagram,
            {**job.signals, **hidden},
            simulator.get_mutable_context(),
            due=self._due,
        )
        self._ending: Ending | None = None
        self._complete_at = job.end - same_within(job.end)
        self.is_beyond_bound = False
        self.interruption = Interruption()
        self._last_report = clock.monotonic()
        # A bound is on one signal, or on all; the rest of a sample is left out.
        places = [
            place
            for name, place in zip(job.signals, self.recorder.columns, strict=False)
            if job.bound.signal in (None, name)
        ]
        begin, end = (places[0].start, places[-1].stop) if places else (0, 0)
        rest = self.recorder.columns[-1].stop - end if places else 0
        self._bounded = Struct(f"{8 * begin}x{end - begin}d{8 * rest}x")

    @property
    def has_begun(self) -> bool:
        """Whether a step has been recorded."""
        return self._num_samples > 0

    def Advance(self) -> Ending:
        """Runs to the end of the job, or until it ends early; returns how it ended."""
        simulator = self._simulator
        is_ended: Callable[[SimulatorStatus], bool] = IsEnded
        if isinstance(simulator, TeleoperatorSimulator):
            is_ended = simulator.IsEndedByOthers
        with NamingBlocks():
            status = simulator.Initialize(
                InitializeParams(
                    suppress_initialization_events=self._job.suppress_initialization_events
                )
            )
            if not is_ended(status):
                status = self._AdvanceToEnd(is_ended)
        self.recorder.CatchUp()
        if not self.has_begun:  # An initialization event has ended the run.
            self.recorder.Sample()
        # If the monitor has not ended the run, an event of a block has.
        return self._ending or Ending("terminated", status.message())

    def _AdvanceToEnd(
        self, is_ended: Callable[[SimulatorStatus], bool]
    ) -> SimulatorStatus:
        """Runs to the end of the job, or until an event or the monitor ends the run.

        Args:
            is_ended: Whether a run has ended early, from the status of AdvanceTo().
        """
        if self._due is None or self._job.context.num_continuous_states():
            is_checked = self._is_bounded or self.watched.guarded
            if is_checked or not self.recorder.is_held:
                return self._AdvanceInSteps(is_ended)
            monitor = self.recorder.HeldMonitor(
                self._CheckHeld, self._complete_at, self.interruption
            )
            self._simulator.set_monitor(monitor)
            status = self._AdvanceInSteps(is_ended)
            if self._ending is None:  # An event has ended the run before a check.
                self._CheckHeld(self._simulator.get_context().get_time())
            return status
        # Between the rows, nothing in Python looks at the run.
        self._simulator.clear_monitor()
        context = self._simulator.get_context()
        for time in self._due[1:].tolist():
            status = self._simulator.AdvanceTo(time)
            if self.Monitor(context) or is_ended(status):
                break
        return status

    def _AdvanceInSteps(
        self, is_ended: Callable[[SimulatorStatus], bool]
    ) -> SimulatorStatus:
        """Runs to the end of the job, or until an event or the monitor ends the run.

        Drake takes no steps for a system without continuous states. Its signals may
        depend on time nevertheless, so it stops at each multiple of the longest step,
        where periodic events of this period are, too.

        Args:
            is_ended: Whether a run has ended early, from the status of AdvanceTo().
        """
        step = self._job.config.max_step_size
        if self.recorder.is_held or self._job.context.num_continuous_states():
            step = math.inf
        while True:
            time = self._simulator.get_context().get_time()
            boundary = self._job.end
            if math.isfinite(step):
                boundary = min((math.floor(time / step + TIE) + 1) * step, boundary)
            status = self._simulator.AdvanceTo(boundary)
            if boundary == self._job.end or is_ended(status):
                return status

    def Bends(self) -> tuple[set[str], set[str]]:
        """Returns the signals that Outcome.find_bends tells."""
        recorder = self.recorder
        bent = recorder.Bent()
        sent = {x for x in self.watched.sent if _HIDDEN + x in bent}
        return recorder.Unresolved() & set(self._job.signals), sent

    def Monitor(self, root_context: Context) -> EventStatus | None:
        """Records a step at its end; ends the run if a check requires it."""
        sample = self.recorder.Sample()
        self._num_samples += 1
        guarded = self.watched.guarded
        if guarded:
            self.due += GuardsDue(guarded, self._job.diagram, root_context)
        norm = math.hypot(*self._bounded.unpack(sample)) if sample else 0.0
        return self._Check(self.recorder.time, norm)

    def _CheckHeld(self, time: float) -> EventStatus | None:
        """Checks the samples of held signals since the last check, as _Check()."""
        are_numbers = self.recorder.AreNumbers(self._num_samples)
        self._num_samples = self.recorder.num_samples
        return self._Check(time, 0.0 if are_numbers else math.nan)

    def _Check(self, time: float, norm: float) -> EventStatus | None:
        """Ends the run if it exceeds its bound, is interrupted or complete.

        Args:
            time: The time of the last sample, s.
            norm: The norm of the bounded signals in it.

        Raises:
            ScenarioError: If the run would take too many steps; see Pace.
        """
        bound = self._job.bound
        if self._num_samples >= self._next_count:
            self._next_count = self._num_samples + _SAMPLES_PER_COUNT
            rejected = CountsOf(self._simulator).rejected
            steps = max(self._num_samples, self._simulator.get_num_steps_taken())
            self._pace.Check(steps + rejected, time)
        if not norm <= bound.largest:
            self.is_beyond_bound = True
            return self._End(Ending("diverged", bound.Reason(norm)))
        progress = self._job.progress
        if progress and clock.monotonic() > self._last_report + _REPORT_PERIOD:
            self._last_report = clock.monotonic()
            progress(time)
        if self.interruption.has_come:
            return self._End(INTERRUPTED)
        if time >= self._complete_at:
            return self._End(COMPLETED)  # Events at the end do not happen.
        return None

    def _End(self, ending: Ending) -> EventStatus:
        self._ending = ending
        return EventStatus.ReachedTermination(self._job.diagram, ending.termination)
