"""Base of the environments' configs; stiffness and damping at a point."""

from abc import ABC, abstractmethod

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.surface import (
    MaterialAt,
    StackNormal,
    Surface,
    SurfacesOf,
)
from teleop_drake.loops.framework.validation import Config
from teleop_drake.loops.numerics.differences import differentiate
from teleop_drake.model.kinds import KindConfig

# Largest steps of the finite differences in position, m, and in velocity, m/s. The step
# in position is at most _STEP_SHARE of the distance to the nearest surface.
_STEP = 1e-4
_SPEED_STEP = 1e-3
_STEP_SHARE = 1 / 50


@Config
class EnvironmentConfig(KindConfig, ABC):
    """The environment of the tool (thesis section 2.4).

    An environment of your own derives from this class, adds its fields, and makes its
    block in MakeEnvironment. A scenario selects it by the name of its class:
    `kind: my_module:MyEnvironment`.
    """

    def Check(self) -> None:
        """Checks every field; by default, the fields that are declared by Number().

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

        The block may have a method Surfaces(), which returns Surface objects. The
        operator then perceives contact at the surface named `contact`, and the surfaces
        `contact` and `puncture` have events and metrics. Without the method, all of
        these are left out.

        Args:
            start: p_WT at time 0 in m (n).

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def Surfaces(self, start: ArrayLike) -> tuple[Surface, ...]:
        """Returns the surfaces that the block declares, or an empty tuple.

        Args:
            start: p_WT at time 0 in m (n).
        """
        return SurfacesOf(self.MakeEnvironment(start)) or ()

    def StiffnessAndDamping(self, start: ArrayLike) -> tuple[Array, Array]:
        """Returns dF_e/dp in N/m and dF_e/dv in N s/m at rest (n, n).

        Args:
            start: p_WT in m (n).
        """
        # The surfaces spare making the block, which takes ten times as long.
        told = StackSlopes(self.Surfaces(start), start)
        return told or StiffnessAndDamping(self.MakeEnvironment(start), start)


def StackSlopes(
    surfaces: tuple[Surface, ...], p_WT: ArrayLike
) -> tuple[Array, Array] | None:
    """Returns stiffness and damping in a stack of materials; see StackNormal.

    Args:
        surfaces: The surfaces of the environment.
        p_WT: The point in m (n).

    Returns:
        K in N/m and D in N s/m (n, n), or None if the surfaces are not a stack.
    """
    normal = StackNormal(surfaces)
    if normal is None:
        return None
    along = np.outer(normal, normal)
    material = MaterialAt(surfaces, p_WT)
    if material is None:
        return 0 * along, 0 * along
    return material.stiffness * along, material.damping * along


def StiffnessAndDamping(environment: System, p_WT: ArrayLike) -> tuple[Array, Array]:
    """Returns dF_e/dp and dF_e/dv of an environment, at rest.

    They follow from the materials if the surfaces are a stack, and otherwise from
    finite differences of the force.

    Args:
        environment: A block with the ports of EnvironmentConfig.MakeEnvironment.
        p_WT: The point in m (n).

    Returns:
        K in N/m and D in N s/m (n, n).
    """
    p = np.asarray(p_WT, dtype=float)
    surfaces = SurfacesOf(environment) or ()
    told = StackSlopes(surfaces, p)
    if told is not None:
        return told
    n = p.size
    gap = min((abs(float(x.Depth(p))) for x in surfaces), default=np.inf)
    step = min(_STEP, _STEP_SHARE * gap) or _STEP
    steps = np.repeat([step, _SPEED_STEP], n)
    slope = differentiate(
        lambda x: ForceAt(environment, x[:n], x[n:]), np.append(p, 0 * p), steps
    )
    return slope[:, :n], slope[:, n:]


def ForceAt(environment: System, p_WT: Array, v_WT: Array) -> Array:
    """Returns the force on an environment in N (n), in its default state.

    Args:
        p_WT: Position of the tool in m (n).
        v_WT: Velocity of the tool in m/s (n).
    """
    context = environment.CreateDefaultContext()
    environment.GetInputPort("tool_position").FixValue(context, p_WT)
    environment.GetInputPort("tool_velocity").FixValue(context, v_WT)
    return environment.GetOutputPort("environment_force").Eval(context)
