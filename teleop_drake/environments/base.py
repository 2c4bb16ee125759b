"""Base of the configs of environments."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import System

from teleop_drake.environments.slopes import StackSlopes, StiffnessAndDamping
from teleop_drake.environments.surface import Surface, SurfacesOf
from teleop_drake.kinds import KindConfig

Array = NDArray[np.float64]


@dataclass(kw_only=True, eq=False)
class EnvironmentConfig(KindConfig, ABC):
    """What the tool meets (thesis section 2.4).

    An environment of your own derives from this class, adds its fields, and makes its
    block in MakeEnvironment. It can be named in a scenario:
    `kind: my_module:MyEnvironment`.
    """

    def Check(self) -> None:
        """Checks every field; here those that Number() made.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        self.CheckNumbers()

    @abstractmethod
    def MakeEnvironment(self, start: ArrayLike) -> System:
        """Makes the block.

        | port | name              | size | unit                    |
        |------|-------------------|------|-------------------------|
        | in   | tool_position     | n    | m                       |
        | in   | tool_velocity     | n    | m/s                     |
        | out  | environment_force | n    | N, exerted BY the robot |

        If it has a method Surfaces(), which returns Surface objects, the operator feels
        contact where the one named `contact` is, and events and metrics are those of
        `contact` and `puncture`. Without it they are left out.

        Args:
            start: p_WT at time 0 in m (n).

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def Surfaces(self, start: ArrayLike) -> tuple[Surface, ...]:
        """Returns the surfaces that the block tells, none if it tells none.

        Args:
            start: p_WT at time 0 in m (n).
        """
        return SurfacesOf(self.MakeEnvironment(start)) or ()

    def StiffnessAndDamping(self, start: ArrayLike) -> tuple[Array, Array]:
        """Returns dF_e/dp in N/m and dF_e/dv in N s/m at rest (n, n).

        Args:
            start: p_WT in m (n).
        """
        told = StackSlopes(self.Surfaces(start), start)
        return told or StiffnessAndDamping(self.MakeEnvironment(start), start)
