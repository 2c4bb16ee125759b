"""An operator whose commands come from outside while the simulation runs."""

from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, DependencyTicket

from teleop_drake.operators.modes import Array, CheckVelocity, ModalOperator
from teleop_drake.validation import Refuse


class HandOperator(ModalOperator):
    """Commands a velocity that a hand gives, picture by picture.

        v_d(t) = before + (after - before) (t - begin)/(end - begin)

    within [begin, end], and held before and after. Whoever runs the simulation calls
    SetCommand() between two calls of AdvanceTo(), which end at `end`: v_d is continuous
    then, and is not smooth only where a step ends.

    Ports, state, modes, initial value and feedthrough are those of ModalOperator. The
    line is a numeric parameter of its Context. It has no kernel.

    It feels nothing by itself: that is what the hand is for.

    Args:
        num_axes: n.
    """

    def __init__(self, *, num_axes: int):
        ModalOperator.__init__(self, num_axes=num_axes)
        n = num_axes
        self._line = self.DeclareNumericParameter(
            BasicVector([0.0, 1.0, *[0.0] * 2 * n])
        )

    def SetCommand(
        self,
        context: Context,
        *,
        begin: float,
        end: float,
        before: ArrayLike,
        after: ArrayLike,
    ) -> None:
        """Sets the line along which v_d goes.

        Args:
            context: The Context of this block.
            begin: When it begins, s.
            end: When it ends, s, > begin.
            before: v_d at the beginning in m/s (n).
            after: v_d at the end in m/s (n).

        Raises:
            ValueError: If a value is not finite, or the end is not after the beginning.
        """
        if not end > begin:
            Refuse("end", end, f"> {begin} (s)")
        values = [begin, end, *CheckVelocity(before), *CheckVelocity(after)]
        context.get_mutable_numeric_parameter(self._line).SetFromVector(values)

    def IntendedVelocity(self, context: Context) -> Array:
        """Returns v_d in m/s (n).

        Args:
            context: The Context of this block.
        """
        line = context.get_numeric_parameter(self._line).CopyToVector()
        begin, end = line[:2]
        n = (line.size - 2) // 2
        share = min(max((context.get_time() - begin) / (end - begin), 0.0), 1.0)
        value: Array = (1 - share) * line[2 : 2 + n] + share * line[2 + n :]
        return value

    def IntentionTickets(self) -> set[DependencyTicket]:
        """Returns those of the time and of the parameter."""
        return {self.time_ticket(), self.all_parameters_ticket()}
