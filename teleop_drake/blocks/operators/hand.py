"""An operator whose commands come from outside while the simulation runs."""

from collections.abc import Mapping
from typing import Any

from teleop_drake.arrays import Array
from teleop_drake.blocks.operators.modes import ModalOperator
from teleop_drake.kernel import Term


class HandOperator(ModalOperator):
    """Commands a velocity that a hand gives, picture by picture.

        v_d(t) = before + (after - before) (t - begin)/(end - begin)

    within [begin, end], and held before and after. The page sets the input `line`
    between two pictures, each of which ends at its `end`: v_d is continuous then, and
    is not smooth only where a step ends.

    | port | name | size   | unit                                      |
    |------|------|--------|-------------------------------------------|
    | in   | line | 2 + 2n | [begin; end; before; after], s and m/s |

    As long as nothing is connected to it, and it has no value, v_d is zero. All other
    ports, state, modes, initial value and feedthrough are those of ModalOperator.

    It feels nothing by itself: that is what the hand is for.
    """

    optional_inputs = ("line",)

    def DeclareMore(self) -> None:
        """Declares the input of the hand."""
        self.DeclareVectorInputPort("line", 2 + 2 * self._num_axes)

    def IntentionTerm(self) -> tuple[Term, Mapping[str, Any]]:
        """Returns the term of the intended velocity, and its parameters; see kernel."""
        return (velocity_on_line, "time", "line"), {}


def velocity_on_line(time: float, line: Array) -> Array:
    """Returns v_d in m/s (n); zero if the line is zeros."""
    n = (len(line) - 2) // 2
    # A line without a length has ended.
    length = max(line[1] - line[0], 1e-9)
    share = min(max((time - line[0]) / length, 0.0), 1.0)
    velocity: Array = (1 - share) * line[2 : 2 + n] + share * line[2 + n :]
    return velocity
