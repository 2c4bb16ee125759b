"""An operator whose commands come from outside while the simulation runs."""

from teleop_drake.arrays import Array, ArrayLike
from teleop_drake.blocks.environments.surface import Surface
from teleop_drake.blocks.operators.base import ModalOperator


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

    def __init__(
        self,
        num_axes: int,
        *,
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
    ):
        ModalOperator.__init__(
            self,
            num_axes,
            (velocity_on_line, "time", "line"),
            {},
            inputs={"line": 2 + 2 * num_axes},
            contact_force=contact_force,
            contact_surface=contact_surface,
            stop_time=stop_time,
        )


def velocity_on_line(time: float, line: Array) -> Array:
    """Returns v_d in m/s (n); zero if the line is zeros."""
    n = (len(line) - 2) // 2
    # A line without a length has ended.
    length = max(line[1] - line[0], 1e-9)
    share = min(max((time - line[0]) / length, 0.0), 1.0)
    velocity: Array = (1 - share) * line[2 : 2 + n] + share * line[2 + n :]
    return velocity
