"""A workaround for cache entries that are out of date when Drake repeats a step.

When error control rejects a step, Drake's IntegratorBase restores the time and the
continuous state at the start of the step, but it notifies the Context of the time only:
it writes the state through a reference that it obtained before the step. Cache entries
that depend on the state, but not on the time, keep their values from the end of the
rejected step: the motion of a MultibodyPlant, for example, or the output of a
controller's state. The first stage of the repeated step is computed from them.
Therefore a repeated step has an error of the second order, whatever the order of the
method, and error control cannot detect it.

In drake/systems/analysis/integrator_base.cc, StepOnceErrorControlledAtMost(), the same
from v1.51.1 to v1.58.0 and in the master branch of August 2026:

     66    VectorBase<T>& xc =
     67        get_mutable_context()->get_mutable_continuous_state_vector();
     68    xc0_save_ = xc.CopyToVector();
    ...
    175        // Reset the time, state, and time derivative at t0.
    176        get_mutable_context()->SetTime(current_time);
    177        xc.SetFromVector(xc0_save_);

The fix is to write the state through the Context, instead of lines 176 and 177:

               get_mutable_context()->SetTimeAndContinuousState(current_time,
                                                                xc0_save_);

tests/loops/run/test_stale_cache_guard.py has the smallest case, and fails when Drake
no longer needs the guard.
"""

import math
import sys
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, System

from teleop_drake.loops.kernel import KernelBlock
from teleop_drake.loops.run.stepping import SystemsIn

# The shortest step that is tried, in multiples of the time if that exceeds 1 s, else in
# s. It is a hundred times Drake's own limit; a shorter step hardly changes the time.
_SHORTEST = 1e-12


class TrialStep:
    """The start of the current step, from which the step can be repeated.

    Drake's error control rejects a step only if its error is too large. Two other
    failures are not handled, in 1.51.1 and 1.58.0:

    * An exception that a block, or MultibodyPlant, raises within a step ends
      AdvanceTo(), even if the state that was tried is far from the solution.
    * The norm of the error ignores a rate that is not finite. The integrator then
      accepts a state of NaN or, if the rate belongs to the first variable of a group,
      repeats the smallest step for ever.

    Therefore Look() checks the state before each evaluation of the rates, and a step
    that fails is repeated with a shorter length.

    When time goes back, Look() marks all cache entries as out of date. A block calls
    Look(), so the rates of systems that precede this block have been computed from
    stale results by then. If one of these systems has a state, a step that error
    control has rejected is repeated with the length that was finally accepted.

    The object belongs to one run. It keeps no Context, which would keep the Simulator
    alive.

    A block of this package calls Look() before each evaluation of the rates, so that a
    Diagram need not become part of another one. Without such a block, all steps are
    Drake's own, and none is repeated.

    Args:
        simulator: The Simulator that takes the steps.
        system: The simulated System.
    """

    def __init__(self, simulator: Simulator, system: System):
        self._is_watched = False
        # Whether no system with a state is evaluated before Look() is called.
        self._is_first = True
        for part in SystemsIn(system):
            if _CallsWatchers(part):
                self._is_watched = True
                part.WatchRates(simulator, self.Look)
                break
            if part.num_continuous_states() > 0 and not isinstance(part, Diagram):
                self._is_first = False
        self._time = -math.inf
        self._last_time = -math.inf
        self._state = np.empty(0)
        self._num_rejected = 0

    def Begin(self, simulator: Simulator) -> None:
        """Stores the start of a step, whose events may still change the state."""
        root_context = simulator.get_context()
        self._time = self._last_time = root_context.get_time()
        self._state = root_context.get_continuous_state_vector().CopyToVector()
        self._num_rejected = _NumRejected(simulator)

    def Look(self, simulator: Simulator) -> None:
        """Checks the time and the state for which rates are about to be evaluated.

        Raises:
            FloatingPointError: If the state is not finite.
        """
        root_context = simulator.get_context()
        time = root_context.get_time()
        if time < self._last_time:
            simulator.get_mutable_context().SetAllCacheEntriesOutOfDate()
        self._last_time = time
        state = root_context.get_continuous_state_vector().CopyToVector()
        # The sum of finite numbers is finite, unless they are absurdly large.
        if not math.isfinite(state.sum()):
            raise FloatingPointError("the state is not finite")
        if time == self._time:  # Events at the start have changed the state.
            self._state = state

    def StaleStep(self, simulator: Simulator) -> float | None:
        """Returns the length in s of the last step if it has to be repeated, else None.

        It has to be repeated if its first attempts were rejected, because the accepted
        attempt began with stale results.
        """
        may_be_stale = self._is_watched and not self._is_first
        if not may_be_stale or _NumRejected(simulator) == self._num_rejected:
            return None
        length = simulator.get_context().get_time() - self._time
        return length if length > 0 else None

    def ShorterStep(self, simulator: Simulator, longest_step: float) -> float | None:
        """Returns the longest step to try after a failure, s; None: no step helps.

        Args:
            simulator: The Simulator after the failure.
            longest_step: The longest step that the failed attempt could have, s.
        """
        is_fixed = simulator.get_integrator().get_fixed_step_mode()
        if is_fixed or not self._is_watched:
            return None
        gone = simulator.get_context().get_time() - self._time
        if not (gone > 0 and math.isfinite(self._state.sum())):
            return None
        step = min(gone / 2, longest_step / 2)
        return step if step > _SHORTEST * max(1.0, self._time) else None

    def PutBack(self, simulator: Simulator) -> None:
        """Restores the time and the state at the start of the step.

        The events at the start have happened already. The time is set to the next
        larger number, so that they do not happen again.
        """
        time = max(math.nextafter(self._time, math.inf), sys.float_info.min)
        root_context = simulator.get_mutable_context()
        root_context.SetTime(time)
        root_context.SetContinuousState(self._state)
        self.Begin(simulator)


def _NumRejected(simulator: Simulator) -> int:
    """Returns how many steps error control has rejected since the initialization."""
    integrator = simulator.get_integrator()
    return int(integrator.get_num_step_shrinkages_from_error_control())


def HasOwnBlocks(system: System) -> bool:
    """Returns whether a system contains a block of this package, or one like it.

    A block that announces jumps needs steps that end there; see stepping.
    """
    return any(
        isinstance(part, KernelBlock) or hasattr(part, "NextJumpTime")
        for part in SystemsIn(system)
    )


def _CallsWatchers(system: Any) -> bool:
    """Returns whether a block calls the functions that WatchRates() registers."""
    own = KernelBlock.DoCalcTimeDerivatives
    return isinstance(system, KernelBlock) and type(system).DoCalcTimeDerivatives is own
