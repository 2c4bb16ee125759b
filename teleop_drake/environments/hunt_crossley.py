"""A wall that pushes back as Hunt and Crossley have it, and perhaps rubs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.environments.surface import Surface
from teleop_drake.environments.wall import PlaneOf, WallConfig
from teleop_drake.kernel import Kernel, KernelBlock
from teleop_drake.laws.contact import wall_force
from teleop_drake.validation import REQUIRED, CheckNumber, Number

Array = NDArray[np.float64]


class ContactWall(KernelBlock):
    """Force of the tool on a wall, as the sensor reads it.

        F_e = F_n (n + mu v_t / sqrt(v_t . v_t + v_s^2))
        F_n = max(k d^p (1 + 3/2 alpha d'), 0)   at the depth d > 0, else 0

    with the unit normal n into the wall, the depth d behind it, and the velocity v_t
    along it; see laws.contact. This is not the thesis's.

    | port | name              | size | unit                    |
    |------|-------------------|------|-------------------------|
    | in   | tool_position     | n    | m                       |
    | in   | tool_velocity     | n    | m/s                     |
    | out  | environment_force | n    | N, exerted BY the robot |

    State: none. Direct feedthrough: from both inputs. The force is continuous; touching
    the wall needs no event.

    The wall does not move or stay dented. Its friction has no stiction: whatever pulls
    at a tool along it makes it creep.

    Args:
        surface: Where it is.
        stiffness: k in N/m^p, > 0.
        exponent: p, >= 1.
        damping: alpha in s/m, >= 0.
        friction: mu, >= 0.
        creep_speed: v_s in m/s, > 0; of no effect without friction.

    Raises:
        ValueError: If a value is not allowed.
    """

    is_compiled = True

    def __init__(
        self,
        *,
        surface: Surface,
        stiffness: float,
        exponent: float = 1.0,
        damping: float = 0.0,
        friction: float = 0.0,
        creep_speed: float = 1e-3,
    ):
        KernelBlock.__init__(self)
        CheckNumber("stiffness", stiffness, "N/m^exponent", above=0)
        CheckNumber("exponent", exponent, minimum=1)
        CheckNumber("damping", damping, "s/m", minimum=0)
        CheckNumber("friction", friction, minimum=0)
        CheckNumber("creep_speed", creep_speed, "m/s", above=0)
        self._surface = surface
        self._parameters = {
            "normal_law": np.array([stiffness, exponent, damping], dtype=float),
            "friction_law": np.array([friction, creep_speed], dtype=float),
            "plane": PlaneOf(surface),
        }
        n = surface.normal_W.size
        self.DeclareVectorInputPort("tool_position", n)
        self.DeclareVectorInputPort("tool_velocity", n)
        self.DeclareOutputs(environment_force=n)

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns the surface of the wall."""
        return (self._surface,)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        inputs = (*self._parameters, "tool_position", "tool_velocity")
        return Kernel(
            parameters=self._parameters,
            outputs={"environment_force": (wall_force, *inputs)},
        )


@dataclass(kw_only=True, eq=False)
class HuntCrossleyConfig(WallConfig):
    """A wall with F = stiffness d^exponent (1 + 1.5 damping d') at the depth d > 0."""

    kind = "hunt_crossley"

    # N/m^exponent, > 0.
    stiffness: float = Number(REQUIRED, "N/m^exponent", above=0)
    # >= 1; assumed: 1.5, that of a sphere by Hertz.
    exponent: float = Number(1.5, minimum=1)
    # s/m, >= 0; a body that meets the wall slowly, with v, leaves it with
    # (1 - damping v) v.
    damping: float = Number(0.0, "s/m", minimum=0)

    def MakeEnvironment(self, start: ArrayLike) -> ContactWall:
        """Makes the block; see EnvironmentConfig.MakeEnvironment."""
        (surface,) = self.Surfaces(start)
        return ContactWall(
            surface=surface,
            stiffness=self.stiffness,
            exponent=self.exponent,
            damping=self.damping,
        )
