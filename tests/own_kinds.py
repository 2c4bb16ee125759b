"""A control law of a user's own, as a module that scenarios name."""

from dataclasses import dataclass

from pydrake.systems.framework import LeafSystem

from teleop_drake.architectures import ControlLawConfig
from teleop_drake.validation import CheckNumber


class BrakedForceLaw(LeafSystem):
    """F_c = F_h - damping v."""

    def __init__(self, *, num_axes: int, damping: float):
        LeafSystem.__init__(self)
        self.set_name("braked_force")
        names = (
            "haptic_force",
            "velocity_command",
            "tool_position",
            "tool_velocity",
            "environment_force",
        )
        ports = {name: self.DeclareVectorInputPort(name, num_axes) for name in names}
        force, velocity = ports["haptic_force"], ports["tool_velocity"]
        self.DeclareVectorOutputPort(
            "control_force",
            num_axes,
            lambda context, output: output.SetFromVector(
                force.Eval(context) - damping * velocity.Eval(context)
            ),
            prerequisites_of_calc={force.ticket(), velocity.ticket()},
        )


@dataclass(kw_only=True, eq=False)
class BrakedForce(ControlLawConfig):
    """Direct force with local damping."""

    # N s/m, >= 0.
    damping: float = 0.2

    def Check(self, path: str, num_axes: int) -> None:
        CheckNumber(f"{path}.damping", self.damping, "N s/m", minimum=0)

    def MakeControlLaw(self, facts, path):
        return BrakedForceLaw(num_axes=facts.num_axes, damping=self.damping)
