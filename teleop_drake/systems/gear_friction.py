"""Friction between a drive and the tool."""

import numpy as np

from teleop_drake.kernel import Kernel, KernelBlock
from teleop_drake.laws.actuators import delivered_force
from teleop_drake.validation import CheckNumber


class GearFriction(KernelBlock):
    """Takes the friction of gears from a force.

        F_out = F_in - F_C v/sqrt(v^2 + v_s^2) - B v          on each axis

    Coulomb's friction F_C, made smooth by the speed v_s, and viscous friction B; see
    laws.actuators.

    | port | name          | size | unit |
    |------|---------------|------|------|
    | in   | drive_force   | n    | N    |
    | in   | tool_velocity | n    | m/s  |
    | out  | control_force | n    | N    |

    State: none. Direct feedthrough: from both inputs.

    It does not stick: a force below F_C moves the tool at a speed below v_s. Each task
    axis has friction of its own, as if it had its own drive; friction in the joints of
    an arm is another matter.

    Args:
        num_axes: Number n of axes, >= 1.
        coulomb: F_C in N, >= 0.
        speed: v_s in m/s, > 0.
        viscous: B in N s/m, >= 0.

    Raises:
        ValueError: If a parameter is not allowed.
    """

    def __init__(self, *, num_axes: int, coulomb: float, speed: float, viscous: float):
        KernelBlock.__init__(self)
        CheckNumber("coulomb", coulomb, "N", minimum=0)
        CheckNumber("speed", speed, "m/s", above=0)
        CheckNumber("viscous", viscous, "N s/m", minimum=0)
        self._friction = np.array([coulomb, speed, viscous], dtype=float)
        self.DeclareVectorInputPort("drive_force", num_axes)
        self.DeclareVectorInputPort("tool_velocity", num_axes)
        self.DeclareOutputs(control_force=num_axes)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        return Kernel(
            parameters={"friction": self._friction},
            outputs={
                "control_force": (
                    delivered_force, "friction", "drive_force", "tool_velocity"
                )
            },
        )  # fmt: skip
