"""The slave of a position-position teleoperator with damping injection."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from teleop_drake.kernel import Kernel
from teleop_drake.laws.proportional import slave_force
from teleop_drake.validation import CheckGain


class ProportionalSlave(LeafSystem):
    """Ties the tool to where the master was by a spring, and brakes it.

        F_c = K (x_m - p_WT) - B v

    with x_m(t - T_f) as it arrives. See ProportionalMaster for the other end, for the
    sources and for when the two are stable.

    | port | name              | size | unit | is      |
    |------|-------------------|------|------|---------|
    | in   | forward_packet    | n    | m    | x_m     |
    | in   | tool_position     | n    | m    | p_WT    |
    | in   | tool_velocity     | n    | m/s  | v       |
    | in   | environment_force | n    | N    | ignored |
    | out  | control_force     | n    | N    | F_c     |
    | out  | return_packet     | n    | m    | p_WT    |

    State: none.

    Direct feedthrough: all inputs but environment_force to control_force; tool_position
    to return_packet.

    It has no integral action: a force that lasts leaves a position error.

    Args:
        stiffness: K in N/m (n, n), symmetric, not negative.
        damping: B in N s/m (n, n), symmetric, not negative.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(self, *, stiffness: ArrayLike, damping: ArrayLike):
        LeafSystem.__init__(self)
        self.set_name("proportional_slave")
        n = np.atleast_2d(stiffness).shape[0]
        self._K = CheckGain("stiffness", stiffness, n, may_be_zero=True)
        self._B = CheckGain("damping", damping, n, may_be_zero=True)
        self._x_m = self.DeclareVectorInputPort("forward_packet", n)
        self._p = self.DeclareVectorInputPort("tool_position", n)
        self._v = self.DeclareVectorInputPort("tool_velocity", n)
        self.DeclareVectorInputPort("environment_force", n)
        self.DeclareVectorOutputPort(
            "control_force",
            n,
            self._CalcControlForce,
            prerequisites_of_calc={
                self._x_m.ticket(),
                self._p.ticket(),
                self._v.ticket(),
            },
        )
        self.DeclareVectorOutputPort(
            "return_packet",
            n,
            self._CopyPosition,
            prerequisites_of_calc={self._p.ticket()},
        )

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        return Kernel(
            parameters={"stiffness": self._K, "damping": self._B},
            outputs={
                "control_force": (
                    slave_force, "forward_packet", "tool_position", "tool_velocity",
                    "stiffness", "damping",
                ),
                "return_packet": "tool_position",
            },
            unused=("environment_force",),
        )  # fmt: skip

    def _CalcControlForce(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            slave_force(
                self._x_m.Eval(context),
                self._p.Eval(context),
                self._v.Eval(context),
                self._K,
                self._B,
            )
        )

    def _CopyPosition(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._p.Eval(context))
