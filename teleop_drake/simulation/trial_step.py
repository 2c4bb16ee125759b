"""The beginning of a trial step, from which it can be repeated.

Drake's error control rejects a step for its error only. What happens otherwise, with
1.51.1 and 1.58.0: an exception that a block, or MultibodyPlant, raises within a step
ends AdvanceTo(), though the state that was tried was nonsense. A rate that is not
finite is overlooked by the norm of the error, which then accepts a state of NaN, or,
where it belongs to the first variable of a group, makes Drake repeat the smallest step
for ever. So the state is looked at before each evaluation of the rates, and a step that
fails is begun again as a shorter one.
"""

import math
import sys

import numpy as np
from pydrake.systems.framework import Context

# A shorter step hardly moves the time. A hundred times Drake's own limit.
_SHORTEST = 1e-12


class TrialStep:
    """The step under way.

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
