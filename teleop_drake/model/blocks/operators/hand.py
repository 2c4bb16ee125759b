"""An operator whose commands enter through an input port during the simulation."""

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.surface import Surface
from teleop_drake.model.blocks.operators.base import ModalOperator


class HandOperator(ModalOperator):
    """Commands the velocity of a user's hand, which a page samples frame by frame.

        v_d(t) = before + (after - before) (t - begin)/(end - begin)

    within [begin, end]; v_d is held before and after. The interactive page sets the
    input `line` before each frame of its animation, which lasts until `end`. v_d is
    therefore continuous, and bends only where a step of the solver ends.

    | port | name | size   | unit                                      |
    |------|------|--------|-------------------------------------------|
    | in   | line | 2 + 2n | [begin; end; before; after], s and m/s |

    v_d is zero while `line` is neither connected nor has a value. All other ports,
    state, modes, initial value and feedthrough are those of ModalOperator.

    It does not model a reaction to forces, which is left to the user.
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
    # The bound avoids a division by zero; a line of no length has ended.
    length = max(line[1] - line[0], 1e-9)
    share = min(max((time - line[0]) / length, 0.0), 1.0)
    velocity: Array = (1 - share) * line[2 : 2 + n] + share * line[2 + n :]
    return velocity
