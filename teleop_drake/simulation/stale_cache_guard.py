"""A way around results that Drake keeps when it repeats a step.

When error control rejects a step, Drake's IntegratorBase puts time and continuous state
back to the start of the step, but tells the Context about the time only: it writes the
state through a reference that it took before the step. Whatever is cached and depends
on the state, but not on the time, stays as it was at the end of the rejected step: the
motion of a MultibodyPlant, for example, or the output of a controller's state. The
first stage of the repeated step is computed from that. So a repeated step has an error
of the second order, whatever the order of the method, and error control cannot see it.

In drake/systems/analysis/integrator_base.cc, StepOnceErrorControlledAtMost(), the same
from v1.51.1 to v1.58.0 and in the master branch of August 2026:

     66    VectorBase<T>& xc =
     67        get_mutable_context()->get_mutable_continuous_state_vector();
     68    xc0_save_ = xc.CopyToVector();
    ...
    175        // Reset the time, state, and time derivative at t0.
    176        get_mutable_context()->SetTime(current_time);
    177        xc.SetFromVector(xc0_save_);

The mend is to write the state through the Context, instead of lines 176 and 177:

               get_mutable_context()->SetTimeAndContinuousState(current_time,
                                                                xc0_save_);

tests/simulation/test_stale_cache_guard.py has the smallest case, and fails when Drake
no longer needs the guard.
"""

import math
import sys
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, System

from teleop_drake.kernel import KernelBlock
from teleop_drake.simulation.stepping import SystemsIn

# A shorter step hardly moves the time. A hundred times Drake's own limit.
_SHORTEST = 1e-12


class TrialStep:
    """The beginning of the step under way, from which it can be repeated.

    Drake's error control rejects a step for its error only. What happens otherwise,
    with 1.51.1 and 1.58.0: an exception that a block, or MultibodyPlant, raises within
    a step ends AdvanceTo(), though the state that was tried was nonsense. A rate that
    is not finite is overlooked by the norm of the error, which then accepts a state of
    NaN, or, where it belongs to the first variable of a group, makes Drake repeat the
    smallest step for ever. So the state is looked at before each evaluation of the
    rates, and a step that fails is begun again as a shorter one.

    When time goes back, Look() marks everything that is cached as out of date. It is
    called by a block, so the rates of systems in front of that block have been computed
    from stale results by then. Where one of these has a state, a step that error
    control has rejected is begun again with the length that was accepted.

    It belongs to one run, and keeps no Context: that would keep the Simulator alive.

    A block of this package calls Look() before each evaluation of the rates, so that a
    Diagram need not become a part of another one. Without such a block, steps are
    Drake's own: none is begun again.

    Args:
        simulator: What takes the steps.
        system: What it simulates.
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
        """Notes that a step begins, maybe with events that change the state yet."""
        root_context = simulator.get_context()
        self._time = self._last_time = root_context.get_time()
        self._state = root_context.get_continuous_state_vector().CopyToVector()
        self._num_rejected = _NumRejected(simulator)

    def Look(self, simulator: Simulator) -> None:
        """Looks at the time and the state of which rates are to be evaluated.

        Raises:
            FloatingPointError: If the state is not finite.
        """
        root_context = simulator.get_context()
        time = root_context.get_time()
        if time < self._last_time:
            simulator.get_mutable_context().SetAllCacheEntriesOutOfDate()
        self._last_time = time
        state = root_context.get_continuous_state_vector().CopyToVector()
        # Of so many numbers that are finite the sum is, or the step is absurd.
        if not math.isfinite(state.sum()):
            raise FloatingPointError("the state is not finite")
        if time == self._time:  # The events at the start have happened.
            self._state = state

    def StaleStep(self, simulator: Simulator) -> float | None:
        """Returns the length in s of a step that has to be repeated; None: it is good.

        Its first attempts were rejected, and it began with stale results.
        """
        may_be_stale = self._is_watched and not self._is_first
        if not may_be_stale or _NumRejected(simulator) == self._num_rejected:
            return None
        length = simulator.get_context().get_time() - self._time
        return length if length > 0 else None

    def ShorterStep(self, simulator: Simulator, longest_step: float) -> float | None:
        """Returns the longest step to try next in s, or None: it would not help.

        Args:
            simulator: As the failure left it.
            longest_step: That could have been tried, in s.
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
        """Puts time and state back to the start of the step.

        What is due at the start has happened. So that it does not happen again, the
        time is the next larger number.
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
    """Returns whether there is a block of this package in a system."""
    return any(isinstance(part, KernelBlock) for part in SystemsIn(system))


def _CallsWatchers(system: Any) -> bool:
    """Returns whether a block calls those that watch the evaluation of its rates."""
    own = KernelBlock.DoCalcTimeDerivatives
    return isinstance(system, KernelBlock) and type(system).DoCalcTimeDerivatives is own
