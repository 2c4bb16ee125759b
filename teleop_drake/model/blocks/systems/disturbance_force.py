"""The force that disturbs the robot in the demonstration of chapter 3."""

from typing import ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import CheckChoice, Range, Refuse
from teleop_drake.loops.kernel import FixedBlock, Kernel, Term
from teleop_drake.model.laws.tracking import coupled_disturbance, linear_disturbance

_LAWS: dict[str, Term] = {
    "linear": (linear_disturbance, "gain", "tool_position"),
    "coupled": (coupled_disturbance, "gain", "tool_position", "tool_velocity"),
}


class DisturbanceForce(FixedBlock):
    """A force that depends on the position and velocity of the tool.

        linear    F_e = K r                                                      (3.7)
        coupled   F_e = K [x + x' z + 2 z' x + z^2, z + z' x + 2 z x' + x^2]     (3.8)

    | port | name              | size | unit                                       |
    |------|-------------------|------|--------------------------------------------|
    | in   | tool_position     | n    | m                                          |
    | in   | tool_velocity     | n    | m/s                                        |
    | out  | environment_force | n    | N, force of the robot ON the environment   |

    | parameter | name      | unit |
    |-----------|-----------|------|
    | 0         | gain      | N/m  |

    State: none. Direct feedthrough: from both inputs; if linear, only from
    tool_position.

    It is not a contact model: the force acts everywhere, and may be active.

    Args:
        kind: linear or coupled; coupled needs two task axes.
        gain: K in N/m (n, n).
    """

    numeric_parameters: ClassVar = {
        "gain": Range("N/m", is_matrix=True),
    }

    def __init__(self, kind: str, gain: ArrayLike):
        K = np.array(gain, dtype=float)
        CheckChoice("kind", kind, _LAWS)
        if K.ndim != 2 or K.shape[0] != K.shape[1] or not np.isfinite(K).all():
            Refuse("gain", gain, "a square, finite matrix")
        if kind == "coupled" and len(K) != 2:
            Refuse("gain", gain, "2 x 2 for kind coupled")
        n = len(K)
        FixedBlock.__init__(
            self,
            "disturbance_force",
            Kernel(
                parameters={"gain": K},
                outputs={"environment_force": _LAWS[kind]},
            ),
            inputs={"tool_position": n, "tool_velocity": n},
            outputs={"environment_force": n},
        )
