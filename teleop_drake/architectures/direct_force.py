"""The thesis's baseline: the haptic force acts on the tool as it arrives."""

from dataclasses import dataclass

from teleop_drake.architectures.base import ControlLawConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.systems.direct_force import DirectForce


@dataclass(kw_only=True, eq=False)
class DirectForceConfig(ControlLawConfig):
    """F_c(t) = F_h(t - T_f); it has no parameters."""

    kind = "direct_force"

    def MakeControlLaw(self, facts: Facts, path: str) -> DirectForce:
        """Makes the law.

        Args:
            facts: Its number of axes is used.
            path: Has no effect.
        """
        return DirectForce(num_axes=facts.num_axes)
