"""Direct force with local damping injection, against the ground or the command."""

import math
from typing import ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import (
    CheckGain,
    Config,
    GainField,
    GainRange,
    Gains,
)
from teleop_drake.loops.kernel import Kernel
from teleop_drake.model.blocks.architectures.base import (
    ControlLawConfig,
    Facts,
    LawBlock,
)
from teleop_drake.model.blocks.architectures.local_damper import (
    BrakedVelocity,
    LocalDamperConfig,
)
from teleop_drake.model.kinds import NumberNames
from teleop_drake.model.laws.proportional import braked_force, damper_force


class DampedForce(LawBlock):
    """Applies the haptic force as it arrives, and damps the tool without delay.

        F_c = F_h(t - T_f) - B v                           against the ground    (1)
        F_c = F_h(t - T_f) - B (v - v_d(t - T_f))          against the command   (2)

    Both are DirectForce with a local damper at the tool; see local_damper. Neither
    needs a force sensor, a model or a network. v_d is part of the thesis's forward
    packet, so (2) needs no other packet.

    (2) is a special case of the thesis's law, (4.23) and (5.22): with z = 0 and without
    networks that law is

        F_c = F_e - Psi^-1 G1 (v - v_dd) - Psi^-1 G1 Lambda (F_e - F_hd),

    and with Psi^-1 G1 Lambda = 1 the sensed force cancels. The remaining law is (2)
    with B = Psi^-1 G1 = Lambda^-1.

    | port | name              | size | unit | is                                |
    |------|-------------------|------|------|-----------------------------------|
    | in   | haptic_force      | n    | N    | F_h(t - T_f)                      |
    | in   | velocity_command  | n    | m/s  | v_d(t - T_f), ignored by (1)      |
    | in   | tool_position     | n    | m    | ignored                           |
    | in   | tool_velocity     | n    | m/s  | v                                 |
    | in   | environment_force | n    | N    | ignored                           |
    | out  | control_force     | n    | N    | F_c                               |
    | out  | damping_force     | n    | N    | F_h(t - T_f) - F_c                |

    | parameter | name      | unit  |
    |-----------|-----------|-------|
    | 0         | damping   | N s/m |

    State: none.

    Direct feedthrough: haptic_force and tool_velocity to control_force; tool_velocity
    to damping_force. With (2) also velocity_command to both.

    (1) does not compensate the damper: the haptic device's integral action has to
    overcome B v_d as well, and the tool reaches v_d later.

    Args:
        damping: B in N s/m, a number or (n, n), symmetric, not negative.
        against: "ground" for (1), "command" for (2).

    Raises:
        ScenarioError: If an argument is not allowed.
    """

    numeric_parameters: ClassVar = {"damping": GainRange("N s/m", may_be_zero=True)}

    def __init__(self, num_axes: int, damping: ArrayLike, *, against: str = "ground"):
        B = CheckGain("damping", damping, num_axes, may_be_zero=True)
        LawBlock.__init__(
            self,
            "damped_force",
            Kernel(
                parameters={"damping": B},
                outputs={
                    "braked_velocity": BrakedVelocity(
                        against, "tool_velocity", "velocity_command"
                    ),
                    "control_force": (
                        braked_force, "haptic_force", "braked_velocity", "damping"
                    ),
                    "damping_force": (damper_force, "braked_velocity", "damping"),
                },
                sizes={"braked_velocity": num_axes},
            ),
            num_axes,
        )  # fmt: skip


@Config
class DampedForceConfig(LocalDamperConfig, ControlLawConfig):
    """Direct force and a damper at the tool; see architectures.damped_force."""

    kind = "damped_force"
    derives_from_channels = False

    # B, N s/m, >= 0. Null: 2 sqrt(K m), with the stiffness K of the haptic device at
    # low frequency, H(s) = K/s + ..., and the largest apparent mass m at the start
    # pose. Without delay the damper then brings the tool, on the spring K in free
    # space, to rest without an oscillation in any direction. That is 2 N s/m for the
    # thesis's slider and 2.4 N s/m for its arm. Assumed.
    damping: Gains | None = GainField(None, may_be_zero=True)

    def DeriveDefaults(self, facts: Facts) -> None:
        """Derives the damping if it is null; see ArchitectureConfig.DeriveDefaults."""
        if self.damping is None:
            mass = np.linalg.eigvalsh(facts.Told("inertia", "damping"))[-1]
            self.damping = 2 * math.sqrt(facts.OperatorStiffness("damping") * mass)

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        return {"damping": ("controller.damping",)}

    def MakeControlLaw(self, facts: Facts, path: str) -> DampedForce:
        """Makes the law."""
        return DampedForce(
            num_axes=facts.num_axes,
            damping=self.Resolve(facts, path).damping,
            against=self.against,
        )
