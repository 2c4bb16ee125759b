"""The operator of the thesis: a constant velocity."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from teleop_drake.environments import Surface
from teleop_drake.kernel import Term
from teleop_drake.operators.base import OperatorConfig
from teleop_drake.operators.modes import CheckVelocity, ModalOperator


class ConstantVelocityOperator(ModalOperator):
    """Commands a velocity until contact is felt, then a constant force (section 2.5).

        mode 0, velocity: v_d = velocity, F_h = force of the haptic device
        mode 1, force:    v_d = 0,        F_h = contact_force
        mode 2, stopped:  v_d = 0,        F_h = 0 if the mode was 1, otherwise the
                                          haptic device brakes the tool

    Ports, state, initial value and feedthrough are those of ModalOperator.

    It does not react to forces, get tired, or let go when the tool bounces off.

    Args:
        velocity: v_d in m/s (n).
        contact_force: Force after contact in N (n); None: never switches.
        contact_surface: Where contact is perceived; None: never.
        stop_time: When the stop is commanded in s; None: never.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    has_constant_command = True

    def __init__(
        self,
        *,
        velocity: ArrayLike,
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
    ):
        self._velocity = CheckVelocity(velocity)
        ModalOperator.__init__(
            self,
            num_axes=self._velocity.size,
            contact_force=contact_force,
            contact_surface=contact_surface,
            stop_time=stop_time,
        )

    def IntentionTerm(self) -> tuple[Term, Mapping[str, Any]]:
        """Returns the term of the intended velocity, and its parameters; see kernel."""
        return "velocity", {"velocity": self._velocity}


@dataclass(kw_only=True, eq=False)
class ConstantVelocityConfig(OperatorConfig):
    """v_d = velocity until contact is perceived (thesis section 2.5)."""

    kind = "constant_velocity"

    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> ConstantVelocityOperator:
        """Makes the block; see OperatorConfig.MakeOperator."""
        return ConstantVelocityOperator(
            velocity=self.velocity,
            contact_force=self.contact_force,
            contact_surface=contact_surface,
            stop_time=self.stop_time,
        )
