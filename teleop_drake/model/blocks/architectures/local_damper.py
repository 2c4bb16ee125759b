"""The local damper of an architecture, at the hand or at the robot.

    F = F_0 - D v               against the ground     (1)
    F = F_0 - D (v - v_d)       against the command    (2)

F_0 is the force that the architecture itself applies at this place, v the velocity of
the handle (v_m) or of the tool, D the damping in N s/m (n, n), and v_d the commanded
velocity: v_d(t) at the hand, v_d(t - T_f) at the robot. The damper of (1) connects the
place to the ground, that of (2) to a point that moves as commanded. (1) resists the
commanded motion with the force D v_d; (2) does not.

Passivity. (2) is (1) with the force D v_d added. v_d is an input from outside, like the
hand's own force, and depends on no state of the loop. So the two-port between hand and
environment, its passivity, the loop and what the hand feels of the environment are
those of (1). Energy enters through the moving point: at most D v_d^2/4 in W per axis,
because -D (v - v_d) v <= D v_d^2/4, and none while the operator commands no velocity.
An operator whose v_d depends on what it feels closes another loop.
"""

from teleop_drake.loops.framework.validation import CheckChoice, Config
from teleop_drake.loops.kernel import Name, Term
from teleop_drake.model.blocks.architectures.base import ArchitectureConfig
from teleop_drake.model.laws.proportional import driven_force, velocity_error

AGAINST = ("ground", "command")
"""The reference of the damper: the ground, or the commanded velocity."""


@Config
class LocalDamperConfig(ArchitectureConfig):
    """An architecture with local dampers, at the hand, at the robot or at both."""

    # Reference of the local dampers: `ground` damps v, `command` damps v - v_d.
    against: str = "ground"

    @property
    def follows_command(self) -> bool:
        """Whether the dampers connect to points that move as commanded."""
        return self.against == "command"

    def Check(self, path: str, num_axes: int) -> None:
        """Checks each field, also the reference."""
        super().Check(path, num_axes)
        CheckChoice(f"{path}.against", self.against, AGAINST)


def BrakedVelocity(against: str, velocity: Name, command: Name) -> Term:
    """Returns the term of the velocity that the damper brakes, v or v - v_d."""
    CheckChoice("against", against, AGAINST)
    return (velocity_error, velocity, command) if against == "command" else velocity


def DrivenForce(against: str, force: Name, command: Name, damping: Name) -> Term:
    """Returns the term of the force beside -D v, F_0 or F_0 + D v_d.

    It serves at a hand whose velocity follows from the force.
    """
    CheckChoice("against", against, AGAINST)
    return (driven_force, force, command, damping) if against == "command" else force
