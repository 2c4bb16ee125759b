"""The baseline of the thesis: the haptic force acts on the tool as it arrives."""

from teleop_drake.loops.framework.validation import CheckNumber, Config
from teleop_drake.loops.kernel import Kernel
from teleop_drake.model.blocks.architectures.base import (
    ControlLawConfig,
    Facts,
    LawBlock,
)
from teleop_drake.model.kinds import NumberNames


class DirectForce(LawBlock):
    """Applies the haptic force as it arrives: no controller at the slave.

        F_c = F_hd = F_h(t - T_f)                                       (section 2.1)

    | port | name              | size | unit |
    |------|-------------------|------|------|
    | in   | haptic_force      | n    | N    |
    | in   | velocity_command  | n    | m/s  |
    | in   | tool_position     | n    | m    |
    | in   | tool_velocity     | n    | m/s  |
    | in   | environment_force | n    | N    |
    | out  | control_force     | n    | N    |

    The ports are those of every control law; all inputs but haptic_force are ignored
    and need not be connected.

    State: none.

    Direct feedthrough: from haptic_force only.

    It has no telemetry, and does not limit or filter the force.
    """

    def __init__(self, num_axes: int):
        CheckNumber("num_axes", num_axes, minimum=1)
        LawBlock.__init__(
            self,
            "direct_force",
            Kernel(outputs={"control_force": "haptic_force"}),
            num_axes,
        )


@Config
class DirectForceConfig(ControlLawConfig):
    """F_c(t) = F_h(t - T_f); it has no parameters."""

    kind = "direct_force"
    derives_from_channels = False

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        return {}

    def MakeControlLaw(self, facts: Facts, path: str) -> DirectForce:
        """Makes the law."""
        return DirectForce(num_axes=facts.num_axes)
