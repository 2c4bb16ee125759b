"""Runs a diagram in Drake's Simulator, with a monitor that records and checks it."""

import math
import time as clock
from collections.abc import Mapping

import numpy as np
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    InitializeParams,
    Simulator,
)
from pydrake.systems.framework import Context, EventStatus, OutputPort, System

from teleop_drake.contexts import ContextsIn, DiscreteState
from teleop_drake.numerics.instants import same_within
from teleop_drake.numerics.step_polynomials import (
    DEGREE,
    Series,
    shares,
    straight_steps,
)
from teleop_drake.recording import Event
from teleop_drake.signals import SystemsByPath
from teleop_drake.simulation.block_events import (
    DrakeEvents,
    GuardsDue,
    Watched,
    WatchedIn,
)
from teleop_drake.simulation.failures import (
    IsDivergence,
    NamingBlocks,
    ReasonOfDivergence,
)
from teleop_drake.simulation.run import (
    COMPLETED,
    INTERRUPTED,
    Ending,
    Interruption,
    Job,
    Outcome,
    Pace,
)
from teleop_drake.simulation.simulator import (
    EVENT_ACCURACY,
    CountsOf,
    TeleoperatorSimulator,
)
from teleop_drake.simulation.stale_cache_guard import HasOwnBlocks
from teleop_drake.simulation.stepping import LongestStepOf
from teleop_drake.validation import Refuse, ScenarioError

# The most steps that a block may force on a run. Each takes some milliseconds.
_MOST_FORCED_STEPS = 100_000

# A run that is recorded at the ends of steps only is checked after so many steps.
_STRIDE = 64

# The beginning of the names of signals that are recorded to find events.
_HIDDEN = "\0"

# How often progress is reported, in s of real time.
_REPORT_PERIOD = 0.1

# The instants of samples within a step, as shares of its length, and for each instant
# the weights of a cubic Hermite polynomial: those of the values at both ends, and those
# of the rates at both ends times the length. They are the powers of the share times the
# matrix of Hermite's coefficients.
_INSIDE = shares(DEGREE)[1:-1]
_HERMITE = [[1, 0, 0, 0], [0, 0, 1, 0], [-3, 3, -2, -1], [2, -2, 1, 1]]
_WEIGHTS = np.vander(_INSIDE, 4, increasing=True) @ _HERMITE


def RunInDrake(job: Job) -> Outcome:
    """Runs a system in Drake's Simulator.

    A system without a block of this package runs in the plain Simulator. If it also has
    no discrete state, its signals are recorded at the ends of steps only.

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
    positions = {path: series[1].pop(_HIDDEN + path) for path in run.watched.positions}
    outcome = Outcome(
        engine="drake",
        series=series,
        steps=counts.steps,
        derivative_evaluations=counts.evaluations,
        wall_time=wall_time,
        ending=ending,
        is_beyond_bound=run.is_beyond_bound,
        systems=SystemsByPath(job.diagram),
        make_final_context=simulator.get_context().Clone().Clone,
    )
    if job.has_events:
        due = run.due
        outcome.find_events = lambda: DrakeEvents(job, due, positions, outcome)
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


def _IsDense(job: Job) -> bool:
    """Returns whether samples are also taken within steps and after updates."""
    num_groups = job.context.num_discrete_state_groups()
    return num_groups > 0 or HasOwnBlocks(job.diagram)


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


class Recorder:
    """A sampler of the signals of a diagram, step by step.

    Drake provides the states at the ends of a step only. Within a step they are
    interpolated by cubic polynomials that match states and rates at both ends. The
    outputs are evaluated at these states, in a separate Context. If the discrete state
    differs from that of the last sample, a block has changed it at the beginning of the
    step. The beginning is then sampled again, with the new discrete state.

    Attributes:
        names: The names of the signals, in the order of a sample's values.

    Args:
        diagram: The simulated System.
        signals: The output port of each signal, by name.
        root_context: The Context of the Simulator.
        is_dense: Whether samples are also taken within steps.
    """

    def __init__(
        self,
        diagram: System,
        signals: Mapping[str, OutputPort],
        root_context: Context,
        *,
        is_dense: bool = True,
    ):
        self.names = list(signals)
        self._inner_context = root_context.Clone()
        self._at_end, self._inside = (
            [
                (port.Eval, port.get_system().GetMyContextFromRoot(root))
                for port in signals.values()
            ]
            for root in (root_context, self._inner_context)
        )
        self._diagram = diagram
        self._is_dense = is_dense
        self._root_context = root_context
        self._rows: list[tuple[float, list[np.ndarray]]] = []
        self._step_ends: list[int] = []
        self._state = self._rate = self._mode = np.empty(0)

    def Sample(self) -> list[np.ndarray]:
        """Samples the interior and the end of a step; returns the values at its end."""
        root = self._root_context
        time = root.get_time()
        values = [evaluate(context) for evaluate, context in self._at_end]
        if not self._is_dense:
            self._rows.append((time, values))
            return values
        state = root.get_continuous_state_vector().CopyToVector()
        rate = self._RateIn(root)
        mode = DiscreteState(root)
        if self._rows and time > self._rows[-1][0]:
            self._inner_context.SetTimeStateAndParametersFrom(root)
            if not np.array_equal(mode, self._mode):
                # A block has changed its discrete state at the beginning of the step.
                self._SampleAt(self._rows[-1][0], self._state)
                self._rate = self._RateIn(self._inner_context)
            self._SampleInside(time, state, rate)
            self._step_ends.append(len(self._rows))
        self._rows.append((time, values))
        self._state = state
        self._rate = rate
        self._mode = mode
        return values

    def Last(self) -> tuple[float, list[np.ndarray]]:
        """Returns the time of the last sample and its values."""
        return self._rows[-1]

    def _RateIn(self, root_context: Context) -> np.ndarray:
        """Returns the rate of the state in a Context."""
        if root_context.num_continuous_states() == 0:
            return np.empty(0)  # Some systems without such a state raise an error.
        return self._diagram.EvalTimeDerivatives(root_context).CopyToVector()

    def _SampleInside(self, end: float, state: np.ndarray, rate: np.ndarray) -> None:
        """Takes the samples between the last one and the end of the step.

        Args:
            end: The time of the end, s.
            state: The state at the end.
            rate: The rate of the state at the end.
        """
        begin = self._rows[-1][0]
        h = end - begin
        ends = [self._state, state, h * self._rate, h * rate]
        for share, inside in zip(_INSIDE.tolist(), _WEIGHTS @ ends, strict=True):
            self._SampleAt(begin + share * h, inside)

    def _SampleAt(self, time: float, state: np.ndarray) -> None:
        self._inner_context.SetTime(time)
        self._inner_context.SetContinuousState(state)
        values = [evaluate(context) for evaluate, context in self._inside]
        self._rows.append((time, values))

    def Finish(self) -> Series:
        """Returns the times (N,), the signals (N, k) and the steps."""
        times = np.array([time for time, _ in self._rows])
        signals = {
            name: np.array([values[i] for _, values in self._rows])
            for i, name in enumerate(self.names)
        }
        if not self._is_dense:
            return times, signals, straight_steps(times)
        ends = np.array(self._step_ends, int)
        return times, signals, ends[:, np.newaxis] + np.arange(-DEGREE, 1)


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
        is_dense = _IsDense(job)
        self._stride = 1 if is_dense else _STRIDE
        self.watched = WatchedIn(job.diagram) if job.has_events else Watched({}, {})
        self.due: list[Event] = []
        hidden = {_HIDDEN + x: port for x, port in self.watched.positions.items()}
        self.recorder = Recorder(
            job.diagram,
            {**job.signals, **hidden},
            simulator.get_mutable_context(),
            is_dense=is_dense,
        )
        self._ending: Ending | None = None
        self.is_beyond_bound = False
        self.interruption = Interruption()
        self._last_report = clock.monotonic()
        names = list(job.signals)
        bounded = job.bound.signal
        self._watched = [i for i, x in enumerate(names) if bounded in (None, x)]

    @property
    def has_begun(self) -> bool:
        """Whether a step has been recorded."""
        return self._num_samples > 0

    def Advance(self) -> Ending:
        """Runs to the end of the job, or until it ends early; returns how it ended."""
        with NamingBlocks():
            if self._job.suppress_initialization_events:
                self._simulator.Initialize(
                    InitializeParams(suppress_initialization_events=True)
                )
            status = self._simulator.AdvanceTo(self._job.end)
        # The stride may have skipped the check of the last step.
        self._Check(*self.recorder.Last())
        # If the monitor has not ended the run, an event of a block has.
        return self._ending or Ending("terminated", status.message())

    def Monitor(self, root_context: Context) -> EventStatus | None:
        """Records a step at its end; ends the run if a check requires it."""
        now = self.recorder.Sample()
        self._num_samples += 1
        guarded = self.watched.guarded
        if guarded:
            self.due += GuardsDue(guarded, self._job.diagram, root_context)
        if self._num_samples % self._stride:
            return None
        return self._Check(root_context.get_time(), now)

    def _Check(self, time: float, now: list[np.ndarray]) -> EventStatus | None:
        """Ends the run if it exceeds its bound, is interrupted or complete.

        Args:
            time: The time of the last sample, s.
            now: The values of the last sample.

        Raises:
            ScenarioError: If the run would take too many steps; see Pace.
        """
        bound = self._job.bound
        self._pace.Check(self._num_samples + CountsOf(self._simulator).rejected, time)
        norm = math.hypot(*(x for i in self._watched for x in now[i]))
        if not norm <= bound.largest:
            self.is_beyond_bound = True
            return self._End(Ending("diverged", bound.Reason(norm)))
        progress = self._job.progress
        if progress and clock.monotonic() > self._last_report + _REPORT_PERIOD:
            self._last_report = clock.monotonic()
            progress(time)
        if self.interruption.has_come:
            return self._End(INTERRUPTED)
        if time >= self._job.end - same_within(self._job.end):
            return self._End(COMPLETED)  # Events at the end do not happen.
        return None

    def _End(self, ending: Ending) -> EventStatus:
        self._ending = ending
        return EventStatus.ReachedTermination(self._job.diagram, ending.termination)
