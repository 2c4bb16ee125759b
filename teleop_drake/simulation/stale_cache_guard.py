"""A way around results that Drake keeps when it repeats a step.

When error control rejects a step, Drake's IntegratorBase puts time and continuous state
back to the start of the step (StepOnceErrorControlledAtMost, at least in Drake 1.51 to
1.58), but tells the Context about the time only. Whatever is cached and depends on the
state, but not on the time, stays as it was at the end of the rejected step: the motion
of a MultibodyPlant, for example, or the output of a controller's state. The first
stage of the repeated step is computed from that. So a repeated step has an error of the
second order, whatever the order of the method, and error control cannot see it.
"""

import math
import weakref

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    Context,
    ContinuousState,
    Diagram,
    DiagramBuilder,
    LeafSystem,
)


class StaleCacheGuard(LeafSystem):
    """Marks everything that is cached as out of date whenever time goes back.

    It has neither ports nor state. A Diagram evaluates the time derivatives of its
    systems in the order in which they were added, so this is the one to add first.
    """

    def __init__(self) -> None:
        LeafSystem.__init__(self)
        self._root_context: Context | None = None
        # Of the last evaluation. No result depends on it.
        self._time = -math.inf

    def Watch(self, root_context: Context | None) -> None:
        """Sets what is watched.

        Args:
            root_context: The Context of the whole diagram; None lets go of it.
        """
        self._root_context = root_context
        self._time = -math.inf

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Looks at the time; there are no derivatives."""
        time = context.get_time()
        if time < self._time and self._root_context is not None:
            self._root_context.SetAllCacheEntriesOutOfDate()
        self._time = time


_guarded: weakref.WeakKeyDictionary[Diagram, tuple[Diagram, StaleCacheGuard]] = (
    weakref.WeakKeyDictionary()
)


def MakeSimulator(diagram: Diagram) -> tuple[Simulator, StaleCacheGuard]:
    """Makes a Simulator that repeats a rejected step as if it were the first attempt.

    It simulates a Diagram of a guard and of the one that is given. The Context of the
    latter, or of a system in it, is what GetMyContextFromRoot() makes of the
    Simulator's.

    Args:
        diagram: What to simulate; not part of another Diagram.

    Returns:
        The Simulator, and the guard, which holds on to its Context until it is told
        to watch another one, or None.
    """
    if diagram not in _guarded:
        # A system can be built into one Diagram only.
        builder = DiagramBuilder()
        guard = builder.AddNamedSystem("stale_cache_guard", StaleCacheGuard())
        builder.AddSystem(diagram)
        _guarded[diagram] = builder.Build(), guard
    guarded, guard = _guarded[diagram]
    simulator = Simulator(guarded)
    guard.Watch(simulator.get_mutable_context())
    return simulator, guard
