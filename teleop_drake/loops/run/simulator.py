"""The Simulator for teleoperators, which simulate() uses with Drake's engine."""

import math
import weakref
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    InitializeParams,
    Simulator,
    SimulatorConfig,
    SimulatorStatus,
)
from pydrake.systems.framework import Context, EventStatus, System

from teleop_drake.loops.framework.contexts import DiscreteState
from teleop_drake.loops.framework.signals import CheckContext, CheckSystem
from teleop_drake.loops.framework.solver import CONFIG, EVENT_ACCURACY
from teleop_drake.loops.framework.validation import CheckKind
from teleop_drake.loops.kernel.block import LongestStep
from teleop_drake.loops.run.failures import IsDivergence, IsGivingUp
from teleop_drake.loops.run.stale_cache_guard import TrialStep
from teleop_drake.loops.run.stepping import Stepping

# The most times that the events of one instant are repeated.
_MOST_UPDATES = 10

_ENDS = (EventStatus.Severity.kReachedTermination, EventStatus.Severity.kFailed)

_Monitor = Callable[[Context], EventStatus | None]


def MakeSimulator(
    diagram: System, config: SimulatorConfig, context: Context | None = None
) -> "TeleoperatorSimulator":
    """Makes the Simulator of a diagram that has delays or walls in it.

    A single call of AdvanceTo() takes the same steps as simulate() with engine="drake",
    to the last bit. Drake's own Simulator, with the same configuration, is wrong by up
    to some per cent after a collision. This Simulator

    * locates events, such as a puncture and contact, to better than a microsecond
      (context.SetAccuracy),
    * takes no step longer than the shortest delay, whatever the configuration says,
    * ends steps where a signal jumps and where the echo of a jump arrives, and takes
      short steps after it, because a delayed signal is interpolated from these steps,
    * repeats the events at a periodic discrete update until no discrete state changes,
      so that delays and guards respond to the update at the same instant,
    * repeats a rejected step without results that are out of date, and
    * under error control, tries a shorter step if a state within a step is not finite,
      or if a block cannot compute with it (for the last two see TrialStep).

    The last two need a block of this package in the diagram, which observes each step.
    Publish events at the end of a step happen again if the step is repeated.

    Args:
        diagram: The System to simulate; not part of another Diagram.
        config: Drake's configuration. Its start_time is ignored if there is a Context.
        context: The Context where the run begins, which the Simulator changes, as
            Drake's does; None: the default Context.

    Returns:
        The Simulator.
    """
    CheckSystem("diagram", diagram)
    CheckKind("config", config, SimulatorConfig, CONFIG)
    if context is not None:
        CheckContext(diagram, context)
    simulator = TeleoperatorSimulator(diagram, context)
    time = simulator.get_context().get_time()
    ApplySimulatorConfig(config, simulator)
    if context is not None:
        simulator.get_mutable_context().SetTime(time)
    return simulator


class Counts(NamedTuple):
    """Statistics of a Simulator since its run began.

    Attributes:
        steps: Number of steps taken.
        evaluations: Number of evaluations of the rates.
        rejected: Number of rejected steps.
    """

    steps: int
    evaluations: int
    rejected: int


def CountsOf(simulator: Simulator) -> Counts:
    """Returns the statistics of a Simulator since its run began."""
    earlier = getattr(simulator, "earlier_counts", Counts(0, 0, 0))
    integrator = simulator.get_integrator()
    num_shrinkages = (
        integrator.get_num_step_shrinkages_from_error_control()
        + integrator.get_num_step_shrinkages_from_substep_failures()
    )
    return Counts(
        earlier.steps + integrator.get_num_steps_taken(),
        earlier.evaluations + integrator.get_num_derivative_evaluations(),
        earlier.rejected + num_shrinkages,
    )


def IsEnded(status: SimulatorStatus) -> bool:
    """Returns whether AdvanceTo() has ended before its boundary."""
    reached = SimulatorStatus.ReturnReason.kReachedBoundaryTime
    return bool(status.reason() != reached)


class TeleoperatorSimulator(Simulator):
    """A Simulator that ends its steps where signals jump; see MakeSimulator().

    It is used like Drake's Simulator. During a run, the integrator's maximum step size
    may be smaller than the value that it had at the beginning of the run.

    Attributes:
        earlier_counts: The statistics from before the last reset of the integrator.

    Args:
        diagram: The System to simulate; not part of another Diagram.
        context: The Context where the run begins; None: the default Context.
    """

    def __init__(self, diagram: System, context: Context | None = None):
        Simulator.__init__(self, diagram, context)
        self._trial = TrialStep(self, diagram)
        self._diagram = diagram
        self._stepping = Stepping(diagram, math.inf)
        self._is_initialized = False
        self._monitor: _Monitor | None = None
        self._is_stopped = False
        self._rejected_to: float | None = None
        # Whether Drake calls the monitor although no step has ended.
        self._is_between_steps = False
        self.earlier_counts = Counts(0, 0, 0)
        # Weak, because Python's garbage collector cannot see references inside Drake.
        reference = weakref.ref(self)

        def Monitor(root_context: Context) -> EventStatus:
            simulator = reference()
            assert simulator is not None
            return simulator._EndStep(root_context)

        Simulator.set_monitor(self, Monitor)

    def set_monitor(self, monitor: _Monitor) -> None:
        """Sets the function that is called at the end of each step, as in Drake.

        Args:
            monitor: A function of the Simulator's Context. It may end AdvanceTo() by
                returning EventStatus.ReachedTermination().
        """
        self._monitor = monitor

    def clear_monitor(self) -> None:
        """Removes the monitor."""
        self._monitor = None

    def get_monitor(self) -> _Monitor | None:
        """Returns the function that set_monitor() has set, or None."""
        return self._monitor

    def Initialize(self, *arguments: object, **keywords: object) -> SimulatorStatus:
        """Begins a run at the present Context, as in Drake."""
        integrator = self.get_mutable_integrator()
        longest_step = integrator.get_maximum_step_size()
        # Undo the limit that an earlier run has set.
        if longest_step == self._stepping.step_limit:
            longest_step = self._stepping.longest_step
        longest_step = min(longest_step, LongestStep(self._diagram, self.get_context()))
        integrator.set_maximum_step_size(longest_step)
        self._stepping = Stepping(self._diagram, longest_step, self.get_context())
        self._is_initialized = True
        self.earlier_counts = Counts(0, 0, 0)
        self._is_stopped = False
        root_context = self.get_mutable_context()
        if root_context.get_accuracy() is None:
            root_context.SetAccuracy(EVENT_ACCURACY)
        self._trial.Begin(self)
        status = Simulator.Initialize(self, *arguments, **keywords)
        self._stepping.BeginModes(root_context)
        return status

    def AdvancePendingEvents(self) -> SimulatorStatus:
        """Executes the pending events, as in Drake."""
        if not self._is_initialized:
            self.Initialize()
        return Simulator.AdvancePendingEvents(self)

    def AdvanceTo(
        self, boundary_time: float, interruptible: bool = True
    ) -> SimulatorStatus:
        """Advances to a time, as in Drake.

        Args:
            boundary_time: The time to which to advance, s.
            interruptible: As in Drake.

        Returns:
            The status, which reports the time and the reason of the return.
        """
        if not self._is_initialized:
            status = self.Initialize()
            if self.IsEndedByOthers(status):
                return status
        stepping = self._stepping
        context = self.get_context()
        while True:
            if stepping.IsAtDiscreteUpdate(context.get_time()):
                self._Settle()
            if stepping.IsAtJump(context.get_time()):
                # The monitor is called before and after the jump.
                status = self.AdvancePendingEvents()
                if self.IsEndedByOthers(status):
                    return status
            jump = stepping.SourceJump(context.get_time())
            if jump is not None and jump.after <= boundary_time:
                self.earlier_counts = CountsOf(self)
                stepping.Cross(jump, self.get_mutable_context())
                self._ContinueFromHere(stepping.step_limit)
                status = self.AdvancePendingEvents()
                if self.IsEndedByOthers(status):
                    return status
            # A jump that is due now may have been rounded to an earlier time.
            stop = max(stepping.NextStop(context), context.get_time())
            if jump is not None and jump.after > boundary_time:
                stop = boundary_time
            stop = min(stop, boundary_time)
            try:
                status = Simulator.AdvanceTo(self, stop, interruptible)
            except (Exception, SystemExit) as error:
                # A step that failed is repeated with a shorter length.
                if not IsDivergence(error, context) or IsGivingUp(error):
                    raise
                shorter = self._ShorterStep()
                if shorter is None:
                    raise
                self._BeginAgain(shorter)
                continue
            # _EndStep() has found the step to be wrong.
            if self._rejected_to is not None:
                self._BeginAgain(self._rejected_to)
                continue
            if context.get_time() >= boundary_time or self.IsEndedByOthers(status):
                # The Context may be changed before the run goes on.
                stepping.StoreSent(self.get_mutable_context())
                return status

    def _Settle(self) -> None:
        """Executes the pending events until no discrete state changes any more.

        Simultaneous discrete updates do not see each other's results. Therefore the
        per-step updates of delays and guards see the result of a periodic update only
        when they are executed once more.
        """
        context = self.get_context()
        self._is_between_steps = True
        for _ in range(_MOST_UPDATES):
            before = DiscreteState(context)
            Simulator.AdvancePendingEvents(self)
            if np.array_equal(before, DiscreteState(context)):
                break
        self._is_between_steps = False

    def _ShorterStep(self) -> float | None:
        """Returns the longest step to try after a failure, s; None: no step helps."""
        return self._trial.ShorterStep(self, self._stepping.step_limit)

    def _BeginAgain(self, step: float) -> None:
        """Restores the start of a step, to be repeated with at most `step` s."""
        counts = CountsOf(self)
        self.earlier_counts = counts._replace(rejected=counts.rejected + 1)
        self._trial.PutBack(self)
        self._stepping.Reject(step, self.get_mutable_integrator())
        self._ContinueFromHere(step)

    def _ContinueFromHere(self, step: float) -> None:
        """Prepares Drake for steps from a time that has been set, of at most `step` s.

        The counts of the integrator begin at 0 again.
        """
        integrator = self.get_mutable_integrator()
        # Drake requires that the first step is not longer than the maximum step size.
        first_step = integrator.get_initial_step_size_target()
        integrator.request_initial_step_size_target(step)
        self._rejected_to = None
        self._is_between_steps = True
        try:
            # After an error, Drake cannot continue without an initialization.
            Simulator.Initialize(
                self, InitializeParams(suppress_initialization_events=True)
            )
        finally:
            self._is_between_steps = False
            integrator.request_initial_step_size_target(first_step)
        self._trial.Begin(self)

    def IsEndedByOthers(self, status: SimulatorStatus) -> bool:
        """Returns whether a monitor or an event of a block has ended AdvanceTo()."""
        return not self._is_stopped and IsEnded(status)

    def _EndStep(self, root_context: Context) -> EventStatus:
        """Checks a step at its end, calls the monitor and limits the next step.

        The returned status ends AdvanceTo() if the step has to be repeated, if the
        monitor ends the run, or if the next step needs a stop here.
        """
        self._is_stopped = False
        if self._is_between_steps:
            return EventStatus.DidNothing()
        state = root_context.get_continuous_state_vector().CopyToVector()
        if math.isfinite(state.sum()):
            self._rejected_to = self._trial.StaleStep(self)
        else:  # The norm of the error ignores it.
            self._rejected_to = self._ShorterStep()
        if self._rejected_to is not None:
            return EventStatus.ReachedTermination(self._diagram, "repeated")
        self._trial.Begin(self)
        if self._monitor is not None:
            status = self._monitor(root_context)
            if status is not None and status.severity() in _ENDS:
                return status
        self._is_stopped = self._stepping.EndStep(
            root_context, self.get_mutable_integrator()
        )
        if self._is_stopped:
            return EventStatus.ReachedTermination(self._diagram, "at a jump")
        return EventStatus.DidNothing()
