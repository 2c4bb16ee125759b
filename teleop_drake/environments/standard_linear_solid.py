"""Tissue whose force relaxes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.environments.surface import Surface
from teleop_drake.environments.wall import PlaneOf, WallConfig
from teleop_drake.kernel import Kernel, KernelBlock
from teleop_drake.laws.relaxation import creep_rate, solid_force
from teleop_drake.validation import REQUIRED, CheckNumber, Number

Array = NDArray[np.float64]


class RelaxingTissue(KernelBlock):
    """Force of the tool on a standard linear solid, as the sensor reads it.

        F_e = (k d + k_1 (d - z)) n,    dz/dt = (d - z)/tau

    with the unit normal n into the tissue and the indentation d; see laws.relaxation.
    The force of the Maxwell branch is k_1 (d - z). This is not the thesis's.

    | port | name              | size | unit                    |
    |------|-------------------|------|-------------------------|
    | in   | tool_position     | n    | m                       |
    | in   | tool_velocity     | n    | m/s, has no effect      |
    | out  | environment_force | n    | N, exerted BY the robot |

    State (continuous, 1): z, the way of the dashpot, m.

    Initial value: 0, the tissue has rested.

    Direct feedthrough: from tool_position. The force is continuous; touching the tissue
    needs no event.

    It does not act along the surface, is not pierced, and does not stick to the tool.

    Args:
        surface: Where it is.
        stiffness: k in N/m, >= 0: what is left for good.
        branch_stiffness: k_1 in N/m, > 0: what relaxes.
        relaxation_time: tau in s, > 0.

    Raises:
        ValueError: If a value is not allowed.
    """

    def __init__(
        self,
        *,
        surface: Surface,
        stiffness: float,
        branch_stiffness: float,
        relaxation_time: float,
    ):
        KernelBlock.__init__(self)
        CheckNumber("stiffness", stiffness, "N/m", minimum=0)
        CheckNumber("branch_stiffness", branch_stiffness, "N/m", above=0)
        CheckNumber("relaxation_time", relaxation_time, "s", above=0)
        self._surface = surface
        self._solid = np.array([stiffness, branch_stiffness, relaxation_time], float)
        self._plane = PlaneOf(surface)
        n = surface.normal_W.size
        self.DeclareVectorInputPort("tool_position", n)
        self.DeclareVectorInputPort("tool_velocity", n)
        self.DeclareContinuousState(1)
        self.DeclareOutputs(environment_force=n)

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns the surface of the tissue at rest."""
        return (self._surface,)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        inputs = ("solid", "state", "plane", "tool_position")
        return Kernel(
            parameters={"solid": self._solid, "plane": self._plane},
            outputs={"environment_force": (solid_force, *inputs)},
            rate=(creep_rate, *inputs),
            unused=("tool_velocity",),
        )


@dataclass(kw_only=True, eq=False)
class StandardLinearSolidConfig(WallConfig):
    """A spring beside a Maxwell branch, a spring in line with a dashpot.

    A step to the depth d gives the force
    (stiffness + branch_stiffness exp(-t/relaxation_time)) d.
    """

    kind = "standard_linear_solid"

    # What is left for good, N/m, >= 0; 0 is a Maxwell body.
    stiffness: float = Number(REQUIRED, "N/m", minimum=0)
    # What relaxes, N/m, > 0.
    branch_stiffness: float = Number(REQUIRED, "N/m", above=0)
    # s, > 0; assumed: that of soft tissue is between a second and minutes.
    relaxation_time: float = Number(1.0, "s", above=0)

    def MakeEnvironment(self, start: ArrayLike) -> RelaxingTissue:
        """Makes the block; see EnvironmentConfig.MakeEnvironment."""
        (surface,) = self.Surfaces(start)
        return RelaxingTissue(
            surface=surface,
            stiffness=self.stiffness,
            branch_stiffness=self.branch_stiffness,
            relaxation_time=self.relaxation_time,
        )
