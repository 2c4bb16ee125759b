"""Direct force with local damping injection: the plain way to come to rest."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.architectures.base import LAW_INPUTS, ControlLawConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.kernel import FixedBlock, Kernel
from teleop_drake.laws.proportional import braked_force, damper_force
from teleop_drake.validation import CheckGain, GainField, GainMatrix


class DampedForce(FixedBlock):
    """Applies the haptic force as it arrives, and brakes the tool without delay.

        F_c = F_h(t - T_f) - B v

    This is DirectForce with a damper between the tool and the ground. The damper needs
    no force sensor, no model and no message, and so it does not know the delay.

    | port | name              | size | unit | is                                |
    |------|-------------------|------|------|-----------------------------------|
    | in   | haptic_force      | n    | N    | F_h(t - T_f)                      |
    | in   | velocity_command  | n    | m/s  | ignored                           |
    | in   | tool_position     | n    | m    | ignored                           |
    | in   | tool_velocity     | n    | m/s  | v                                 |
    | in   | environment_force | n    | N    | ignored                           |
    | out  | control_force     | n    | N    | F_c                               |
    | out  | damping_force     | n    | N    | B v, what the damper takes of F_h |

    State: none.

    Direct feedthrough: haptic_force and tool_velocity to control_force; tool_velocity
    to damping_force.

    It does not compensate the damper: the haptic device's integral action has to
    overcome B v_d as well, and the tool reaches v_d later.

    Args:
        damping: B in N s/m, a number or (n, n), symmetric, not negative.
    """

    def __init__(self, *, num_axes: int, damping: ArrayLike):
        B = CheckGain("damping", damping, num_axes, may_be_zero=True)
        FixedBlock.__init__(
            self,
            "damped_force",
            Kernel(
                parameters={"damping": B},
                outputs={
                    "control_force": (
                        braked_force, "haptic_force", "tool_velocity", "damping"
                    ),
                    "damping_force": (damper_force, "tool_velocity", "damping"),
                },
                unused=("velocity_command", "tool_position", "environment_force"),
            ),
            inputs=dict.fromkeys(LAW_INPUTS, num_axes),
            outputs={"control_force": num_axes, "damping_force": num_axes},
        )  # fmt: skip


@dataclass(kw_only=True, eq=False)
class DampedForceConfig(ControlLawConfig):
    """Direct force and a damper at the tool; see architectures.damped_force."""

    kind = "damped_force"

    # B, N s/m, >= 0. Null: 2 sqrt(K m), with the stiffness K of the haptic device at
    # low frequency, H(s) = K/s + ..., and the largest apparent mass m at the start
    # pose. Without delay the damper then brings the tool, on the spring K in free
    # space, to rest without an oscillation in any direction. That is 2 N s/m for the
    # thesis's slider and 2.4 N s/m for its arm. Assumed.
    damping: np.ndarray | float | None = GainField(None, may_be_zero=True)

    def Resolve(self, facts: Facts, path: str) -> Any:
        """Returns the config with its default derived."""
        damping = self.damping
        if damping is None:
            field = f"{path}.damping"
            mass = np.linalg.eigvalsh(facts.Told("inertia", field))[-1]
            damping = 2 * math.sqrt(facts.OperatorStiffness(field) * mass)
        return replace(self, damping=GainMatrix(damping, facts.num_axes))

    def MakeControlLaw(self, facts: Facts, path: str) -> DampedForce:
        """Makes the law."""
        damping = self.Resolve(facts, path).damping
        return DampedForce(num_axes=facts.num_axes, damping=damping)
