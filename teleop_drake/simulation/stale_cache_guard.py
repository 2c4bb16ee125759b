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
import weakref

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    Context,
    ContinuousState,
    Diagram,
    DiagramBuilder,
    LeafSystem,
)

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

    It belongs to one run, and keeps no Context: that would keep the Simulator alive.
    """

    def __init__(self) -> None:
        self._time = -math.inf
        self._state = np.empty(0)
        self._is_at_start = False

    def Begin(self, root_context: Context) -> None:
        """Notes that a step begins, maybe with events that change the state yet."""
        self._time = root_context.get_time()
        self._state = root_context.get_continuous_state_vector().CopyToVector()
        self._is_at_start = True

    def Look(self, root_context: Context) -> None:
        """Looks at the state of which rates are to be evaluated.

        Raises:
            FloatingPointError: If the state is not finite.
        """
        state = root_context.get_continuous_state_vector().CopyToVector()
        # Of so many numbers that are finite the sum is, or the step is absurd.
        if not math.isfinite(state.sum()):
            raise FloatingPointError("the state is not finite")
        if self._is_at_start:
            self._is_at_start = False
            if root_context.get_time() == self._time:
                self._state = state

    def ShorterStep(self, root_context: Context, longest_step: float) -> float | None:
        """Returns the longest step to try next in s, or None: it would not help.

        Args:
            root_context: The Context of the Simulator, as the failure left it.
            longest_step: That could have been tried, in s.
        """
        gone = root_context.get_time() - self._time
        if not (gone > 0 and math.isfinite(self._state.sum())):
            return None
        step = min(gone / 2, longest_step / 2)
        return step if step > _SHORTEST * max(1.0, self._time) else None

    def PutBack(self, root_context: Context) -> None:
        """Puts time and state back to the start of the step.

        What is due at the start has happened. So that it does not happen again, the
        time is the next larger number.
        """
        time = max(math.nextafter(self._time, math.inf), sys.float_info.min)
        root_context.SetTime(time)
        root_context.SetContinuousState(self._state)
        self.Begin(root_context)


class StaleCacheGuard(LeafSystem):
    """Marks everything that is cached as out of date whenever time goes back.

    It has neither ports nor state. A Diagram evaluates the time derivatives of its
    systems in the order in which they were added, so this is the one to add first.
    """

    def __init__(self) -> None:
        LeafSystem.__init__(self)
        self._simulators: weakref.WeakKeyDictionary[Simulator, TrialStep] = (
            weakref.WeakKeyDictionary()
        )
        # Of the last evaluation. No result depends on it.
        self._time = -math.inf

    def Watch(self, simulator: Simulator, trial: TrialStep) -> None:
        """Adds a Simulator to those whose steps are watched.

        Args:
            simulator: Of the whole diagram. It is not kept alive.
            trial: Looks at the state before each evaluation.
        """
        self._simulators[simulator] = trial

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Looks at the time and the state; there are no derivatives."""
        time = context.get_time()
        has_gone_back, self._time = time < self._time, time
        for simulator, trial in self._simulators.items():
            if has_gone_back:
                simulator.get_mutable_context().SetAllCacheEntriesOutOfDate()
            trial.Look(simulator.get_context())


_NAME = "stale_cache_guard"

# The diagrams of a guard and of another diagram, by the latter. It keeps the former
# alive, because pydrake keeps together what was built together. A strong reference
# here would keep both, for ever.
_guarded: weakref.WeakKeyDictionary[Diagram, weakref.ref[Diagram]] = (
    weakref.WeakKeyDictionary()
)


def MakeGuarded(diagram: Diagram) -> Diagram:
    """Makes a Diagram of a StaleCacheGuard and of the one that is given.

    Args:
        diagram: What to guard; not part of another Diagram.

    Returns:
        The Diagram, the same one each time. Its guard is GuardOf() it.
    """
    guarded = _guarded[diagram]() if diagram in _guarded else None
    if guarded is None:
        builder = DiagramBuilder()
        builder.AddNamedSystem(_NAME, StaleCacheGuard())
        builder.AddSystem(diagram)
        guarded = builder.Build()
        _guarded[diagram] = weakref.ref(guarded)
    return guarded


def GuardOf(guarded: Diagram) -> StaleCacheGuard:
    """Returns the guard in a Diagram that MakeGuarded() made."""
    guard = guarded.GetSubsystemByName(_NAME)
    assert isinstance(guard, StaleCacheGuard)
    return guard
