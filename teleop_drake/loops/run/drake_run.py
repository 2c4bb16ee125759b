"""Runs a diagram in Drake's Simulator, with a monitor that records and checks it."""

import math
import time as clock
from collections.abc import Callable, Mapping

import numpy as np
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    InitializeParams,
    Simulator,
    SimulatorStatus,
)
from pydrake.systems.framework import Context, EventStatus, OutputPort, System

from teleop_drake.loops.framework.contexts import ContextsIn, DiscreteState
from teleop_drake.loops.framework.signals import SystemsByPath
from teleop_drake.loops.framework.validation import Refuse, ScenarioError
from teleop_drake.loops.numerics.instants import TIE, same_within
from teleop_drake.loops.numerics.step_polynomials import DEGREE, Series
from teleop_drake.loops.run.bends import CHECKED, INSIDE, Bends, NotesOnBends
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
from teleop_drake.loops.run.recording import Event
from teleop_drake.loops.run.run import (
    COMPLETED,
    INTERRUPTED,
    Ending,
    Interruption,
    Job,
    Outcome,
    Pace,
)
from teleop_drake.loops.run.simulator import (
    EVENT_ACCURACY,
    CountsOf,
    IsEnded,
    TeleoperatorSimulator,
)
from teleop_drake.loops.run.stale_cache_guard import HasOwnBlocks
from teleop_drake.loops.run.stepping import LongestStepOf

# The most steps that a block may force on a run. Each takes some milliseconds.
_MOST_FORCED_STEPS = 100_000

# The beginning of the names of signals that are recorded to find events.
_HIDDEN = "\0"

# How often progress is reported, in s of real time.
_REPORT_PERIOD = 0.1

# The coefficients of a cubic Hermite polynomial, by ascending powers: of the values at
# both ends, and of the rates at both ends times the length.
_HERMITE = np.array(
    [[1.0, 0, 0, 0], [0, 0, 1, 0], [-3, 3, -2, -1], [2, -2, 1, 1]],
)

# The shortest piece as a share of its step, and the most pieces of a step. A kink needs
# some fifteen.
_SHORTEST_PIECE = 2.0**-14
_MOST_PIECES = 200


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
        notes=NotesOnBends(run.recorder.unresolved & set(job.signals)),
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
    outputs are evaluated at these states, in a separate Context. Where a polynomial
    through the samples does not follow a signal, the step is recorded in shorter
    pieces, down to 2^-14 of its length. If the discrete state differs from that of the
    last sample, a block has changed it at the beginning of the step. The beginning is
    then sampled again, with the new discrete state.

    Attributes:
        names: The names of the signals, in the order of a sample's values.
        unresolved: The names of the signals that jump or bend within a step, more
            sharply than the shortest piece follows.

    Args:
        diagram: The simulated System.
        signals: The output port of each signal, by name.
        root_context: The Context of the Simulator.
    """

    def __init__(
        self,
        diagram: System,
        signals: Mapping[str, OutputPort],
        root_context: Context,
    ):
        self.names = list(signals)
        self.unresolved: set[str] = set()
        self._bends = Bends([port.size() for port in signals.values()])
        self._inner_context = root_context.Clone()
        self._at_end, self._inside = (
            [
                (port.Eval, port.get_system().GetMyContextFromRoot(root))
                for port in signals.values()
            ]
            for root in (root_context, self._inner_context)
        )
        self._diagram = diagram
        self._root_context = root_context
        self._rows: list[tuple[float, list[np.ndarray]]] = []
        self._step_ends: list[int] = []
        self._state = self._rate = self._mode = np.empty(0)

    def Sample(self) -> list[np.ndarray]:
        """Samples the interior and the end of a step; returns the values at its end."""
        root = self._root_context
        time = root.get_time()
        values = [evaluate(context) for evaluate, context in self._at_end]
        state = root.get_continuous_state_vector().CopyToVector()
        rate = self._RateIn(root)
        mode = DiscreteState(root)
        is_finite = all(np.isfinite(x).all() for x in values)
        last = self._rows[-1][0] if self._rows else math.inf
        if is_finite and time > last + same_within(time):
            self._inner_context.SetTimeStateAndParametersFrom(root)
            if not np.array_equal(mode, self._mode):
                # A block has changed its discrete state at the beginning of the step.
                self._SampleAt(self._rows[-1][0], self._state)
                self._rate = self._RateIn(self._inner_context)
            self._SampleStep(time, state, rate, values)
        else:
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

    def _SampleStep(
        self,
        end: float,
        state: np.ndarray,
        rate: np.ndarray,
        values: list[np.ndarray],
    ) -> None:
        """Records the samples from the last one to the end of the step.

        Args:
            end: The time of the end, s.
            state: The state at the end.
            rate: The rate of the state at the end.
            values: The sample at the end.
        """
        begin = self._rows[-1][0]
        h = end - begin
        states = np.array([self._state, state, h * self._rate, h * rate])
        a, b, c, d = _HERMITE @ states

        def At(share: float) -> tuple[float, list[np.ndarray]]:
            inside = a + share * (b + share * (c + share * d))
            return self._Evaluate(begin + share * h, inside)

        # The pieces ahead, the next one last, each with the sample at its end.
        pieces = [(0.0, 1.0, (end, values))]
        num_pieces = 1
        while pieces:
            first, last, sample = pieces.pop()
            width = last - first
            inside = [At(first + share * width) for share in INSIDE]
            _, checked = At(first + CHECKED * width)
            samples = [x for _, x in (self._rows[-1], *inside, sample)]
            bent = self._bends.Find(samples, checked)
            if len(bent) and width > _SHORTEST_PIECE and num_pieces < _MOST_PIECES:
                middle = first + width / 2
                pieces += [(middle, last, sample), (first, middle, inside[1])]
                num_pieces += 1
                continue
            self.unresolved |= {self.names[k] for k in bent}
            if num_pieces == _MOST_PIECES:
                # Noise bends everywhere.
                self._bends.Leave(bent)
            self._rows += inside
            self._step_ends.append(len(self._rows))
            self._rows.append(sample)

    def _SampleAt(self, time: float, state: np.ndarray) -> None:
        self._rows.append(self._Evaluate(time, state))

    def _Evaluate(
        self, time: float, state: np.ndarray
    ) -> tuple[float, list[np.ndarray]]:
        """Returns a time in s and the values of the signals there, at a state."""
        self._inner_context.SetTime(time)
        self._inner_context.SetContinuousState(state)
        return time, [evaluate(context) for evaluate, context in self._inside]

    def Finish(self) -> Series:
        """Returns the times (N,), the signals (N, k) and the steps."""
        times = np.array([time for time, _ in self._rows])
        signals = {
            name: np.array([values[i] for _, values in self._rows])
            for i, name in enumerate(self.names)
        }
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
        self.watched = WatchedIn(job.diagram) if job.has_events else Watched({}, {})
        self.due: list[Event] = []
        hidden = {_HIDDEN + x: port for x, port in self.watched.positions.items()}
        self.recorder = Recorder(
            job.diagram, {**job.signals, **hidden}, simulator.get_mutable_context()
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
            status = self._AdvanceInSteps()
        # If the monitor has not ended the run, an event of a block has.
        return self._ending or Ending("terminated", status.message())

    def _AdvanceInSteps(self) -> SimulatorStatus:
        """Runs to the end of the job, or until an event or the monitor ends the run.

        Drake takes no steps for a system without continuous states. Its signals may
        depend on time nevertheless, so it stops at each multiple of the longest step,
        where periodic events of this period are, too.
        """
        step = self._job.config.max_step_size
        if self._job.context.num_continuous_states():
            step = math.inf
        is_ended: Callable[[SimulatorStatus], bool] = IsEnded
        if isinstance(self._simulator, TeleoperatorSimulator):
            is_ended = self._simulator.IsEndedByOthers
        while True:
            time = self._simulator.get_context().get_time()
            boundary = self._job.end
            if math.isfinite(step):
                boundary = min((math.floor(time / step + TIE) + 1) * step, boundary)
            status = self._simulator.AdvanceTo(boundary)
            if boundary == self._job.end or is_ended(status):
                return status

    def Monitor(self, root_context: Context) -> EventStatus | None:
        """Records a step at its end; ends the run if a check requires it."""
        now = self.recorder.Sample()
        self._num_samples += 1
        guarded = self.watched.guarded
        if guarded:
            self.due += GuardsDue(guarded, self._job.diagram, root_context)
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
