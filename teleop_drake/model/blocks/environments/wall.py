"""Environments behind one plane: walls with friction or relaxation."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.surface import (
    CONTACT,
    PlaneSurface,
    Surface,
    UnitNormal,
)
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    Config,
    Number,
    Range,
    RangeOfEach,
)
from teleop_drake.loops.kernel import FixedBlock, Kernel, Term
from teleop_drake.model.blocks.environments.base import EnvironmentConfig
from teleop_drake.model.laws.contact import creep_rate, solid_force, wall_force


@Config
class WallConfig(EnvironmentConfig):
    """Base of the environments behind one plane, which is the surface `contact`."""

    # Position of the plane along its normal from the origin, m.
    start: float = Number(REQUIRED, "m")
    # Normal into the material, n entries, of any length but 0. Null: along x.
    direction: np.ndarray | None = None

    def Check(self) -> None:
        """Checks every field."""
        super().Check()
        if self.direction is not None:
            UnitNormal(self.direction, np.size(self.direction), "direction")


class Wall(FixedBlock):
    """Base of the blocks behind one plane.

    | port | name              | size | unit                    |
    |------|-------------------|------|-------------------------|
    | in   | tool_position     | n    | m                       |
    | in   | tool_velocity     | n    | m/s                     |
    | out  | environment_force | n    | N, exerted BY the robot |

    Args:
        config: The plane and the material.
        start: p_WT at time 0 in m (n).
        parameters: The parameters of the material. The parameter `plane`, a point and
            the unit normal (2, n), is added to them.
        force: The kernel term of the force.
        rate: The kernel term of the state's rate; None: no state.

    Raises:
        ScenarioError: If a value is not allowed.
    """

    def __init__(
        self,
        config: WallConfig,
        start: ArrayLike,
        parameters: Mapping[str, Any],
        force: Term,
        rate: Term | None = None,
    ):
        config.Check()
        n = np.size(start)
        normal_W = UnitNormal(config.direction, n)
        self._surface = PlaneSurface(CONTACT, config.start, normal_W)
        plane = np.array([self._surface.point_W, normal_W])
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters={**parameters, "plane": plane},
                outputs={"environment_force": force},
                rate=rate,
            ),
            inputs={"tool_position": n, "tool_velocity": n},
            outputs={"environment_force": n},
            state=() if rate is None else (0.0,),
        )

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns the surface of the undeformed material."""
        return (self._surface,)


@Config
class HuntCrossleyConfig(WallConfig):
    """A wall with F = stiffness d^exponent (1 + 1.5 damping d') at the depth d > 0."""

    kind = "hunt_crossley"

    # Stiffness, N/m^exponent, > 0.
    stiffness: float = Number(REQUIRED, "N/m^exponent", above=0)
    # Exponent of the depth, >= 1. Assumed: 1.5, as for a sphere in Hertz's theory.
    exponent: float = Number(1.5, minimum=1)
    # alpha, s/m, >= 0. A body that hits the wall at a small speed v leaves it at the
    # speed (1 - damping v) v.
    damping: float = Number(0.0, "s/m", minimum=0)

    def MakeEnvironment(self, start: ArrayLike) -> "ContactWall":
        """Makes the block; see EnvironmentConfig.MakeEnvironment."""
        return ContactWall(self, start)


@Config
class FrictionWallConfig(HuntCrossleyConfig):
    """A wall with Coulomb friction, F_t = friction F_n v_t/sqrt(v_t^2 + creep_speed^2).

    Its normal force F_n is that of hunt_crossley, with a linear spring by default.
    """

    kind = "friction_wall"

    # Exponent of the depth, >= 1; 1 is a linear spring.
    exponent: float = 1.0
    # mu, >= 0. Assumed: 0.3.
    friction: float = Number(0.3, minimum=0)
    # v_s, the speed below which friction grows with the speed, m/s, > 0. Assumed: a
    # hundredth of the speeds of the tasks.
    creep_speed: float = Number(1e-3, "m/s", above=0)


class ContactWall(Wall):
    """Force of the tool on a wall, as the force sensor measures it.

        F_e = F_n (n + mu v_t / sqrt(v_t . v_t + v_s^2))
        F_n = max(k d^p (1 + 3/2 alpha d'), 0)   at the depth d > 0, else 0

    with the unit normal n into the wall, the depth d behind it, and the velocity v_t
    along it; see laws.contact. Without friction mu is 0. The model is not from the
    thesis.

    Ports: those of Wall. State: none. Direct feedthrough: from both inputs. The force
    is continuous; touching the wall needs no event.

    The wall does not move and keeps no dent. Its friction has no stiction: any force
    along the wall makes the tool creep.

    | parameter | name         | unit |
    |-----------|--------------|------|
    | 0         | normal_law   | -    |
    | 1         | friction_law | -    |
    """

    is_compiled = True

    numeric_parameters: ClassVar = {
        "normal_law": RangeOfEach(
            elements=(
                Range("N/m^exponent", above=0),
                Range(minimum=1),
                Range("s/m", minimum=0),
            )
        ),
        "friction_law": RangeOfEach(elements=(Range(minimum=0), Range("m/s", above=0))),
    }
    element_names = MappingProxyType(
        {
            "normal_law": ("stiffness", "exponent", "damping"),
            "friction_law": ("friction", "creep_speed"),
        }
    )

    def __init__(self, config: HuntCrossleyConfig, start: ArrayLike):
        normal_law = [config.stiffness, config.exponent, config.damping]
        friction_law = [0.0, 1e-3]
        if isinstance(config, FrictionWallConfig):
            friction_law = [config.friction, config.creep_speed]
        laws = {
            "normal_law": np.array(normal_law, dtype=float),
            "friction_law": np.array(friction_law, dtype=float),
        }
        force: Term = (wall_force, *laws, "plane", "tool_position", "tool_velocity")
        Wall.__init__(self, config, start, laws, force)


@Config
class StandardLinearSolidConfig(WallConfig):
    """A spring in parallel with a Maxwell branch: a spring and a dashpot in series.

    A step to the depth d gives the force
    (stiffness + branch_stiffness exp(-t/relaxation_time)) d.
    """

    kind = "standard_linear_solid"

    # Stiffness that remains after relaxation, N/m, >= 0; 0: a Maxwell body.
    stiffness: float = Number(REQUIRED, "N/m", minimum=0)
    # Stiffness of the Maxwell branch, which relaxes, N/m, > 0.
    branch_stiffness: float = Number(REQUIRED, "N/m", above=0)
    # Time constant, s, > 0. Assumed: that of soft tissue is between 1 s and minutes.
    relaxation_time: float = Number(1.0, "s", above=0)

    def MakeEnvironment(self, start: ArrayLike) -> "RelaxingTissue":
        """Makes the block; see EnvironmentConfig.MakeEnvironment."""
        return RelaxingTissue(self, start)


class RelaxingTissue(Wall):
    """Force of the tool on a standard linear solid, as the force sensor measures it.

        F_e = (k d + k_1 (d - z)) n,    dz/dt = (d - z)/tau

    with the unit normal n into the tissue and the indentation d; see laws.contact.
    The force of the Maxwell branch is k_1 (d - z). The model is not from the thesis.

    Ports: those of Wall; the velocity has no effect. State (continuous, 1): z, the
    displacement of the dashpot, m. Initial value: 0, the tissue is relaxed. Direct
    feedthrough: from tool_position. The force is continuous; touching the tissue needs
    no event.

    The tissue exerts no force along its surface, is not punctured, and does not stick
    to the tool.

    | parameter | name      | unit |
    |-----------|-----------|------|
    | 0         | solid     | -    |
    """

    numeric_parameters: ClassVar = {
        "solid": RangeOfEach(
            elements=(
                Range("N/m", minimum=0),
                Range("N/m", above=0),
                Range("s", above=0),
            )
        ),
    }
    element_names = MappingProxyType(
        {
            "solid": ("stiffness", "branch_stiffness", "relaxation_time"),
        }
    )

    def __init__(self, config: StandardLinearSolidConfig, start: ArrayLike):
        solid = [config.stiffness, config.branch_stiffness, config.relaxation_time]
        inputs = ("solid", "state", "plane", "tool_position")
        Wall.__init__(
            self,
            config,
            start,
            {"solid": np.array(solid, dtype=float)},
            force=(solid_force, *inputs),
            rate=(creep_rate, *inputs),
        )
