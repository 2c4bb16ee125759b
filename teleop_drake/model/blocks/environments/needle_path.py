"""Tissue that holds a needle on a curved path, so that the tool's rotation matters."""

import math
from dataclasses import field
from typing import ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.surface import PlaneSurface, Surface, UnitNormal
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckVector,
    Config,
    Number,
    Range,
    Refuse,
)
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.loops.kernel.linear_part import LinearPart
from teleop_drake.model.blocks.environments.base import EnvironmentConfig
from teleop_drake.model.blocks.environments.layered_force_field import (
    LAYER_HERE,
    LEAVES_LAYER,
    LayerLimits,
)
from teleop_drake.model.laws.needle import NeedlePath, needle_wrench


@Config
class NeedlePathConfig(EnvironmentConfig):
    """Tissue behind a plane, with a path that a straight needle has to follow.

    The path enters the tissue where the line through the tool's start along `direction`
    does. Six task axes are required. See laws.needle for the equations, which are not
    from the thesis.
    """

    kind = "needle_path"

    # Position of the surface along `direction` from the origin, m. There is no force in
    # front of it.
    start: float = Number(REQUIRED, "m")
    # Direction into the tissue, 3 entries, of any length but 0. Null: along x.
    direction: np.ndarray | None = None
    # Direction of the needle, toward its tip, while the tool has its rotation at the
    # robot's posture; 3 entries, less than a right angle from `direction`. Null: along
    # `direction`.
    needle: np.ndarray | None = None
    # Curvature of the path at the surface, 1/m, 3 entries, normal to `direction`.
    bend: np.ndarray = field(default_factory=lambda: np.zeros(3))
    # Stiffness of the tissue beside the needle, per metre of depth, N/m^2, >= 0.
    stiffness: float = Number(REQUIRED, "N/m^2", minimum=0)
    # Viscous drag on the moving needle, per metre of depth, N s/m^2, >= 0.
    drag: float = Number(0.0, "N s/m^2", minimum=0)

    def Check(self) -> None:
        """Checks every field."""
        super().Check()
        inwards = UnitNormal(self.direction, 3, "direction")
        needle = inwards if self.needle is None else self.needle
        if not UnitNormal(needle, 3, "needle") @ inwards > 1e-3:
            Refuse("needle", self.needle, "less than a right angle from direction")
        CheckVector("bend", self.bend, 3, "1/m")
        if abs(inwards @ self.bend) > 1e-9 * np.linalg.norm(self.bend):
            Refuse("bend", self.bend, "across direction")

    def MakeEnvironment(self, start: ArrayLike) -> "NeedleInTissue":
        """Makes the block; see EnvironmentConfig.MakeEnvironment."""
        return NeedleInTissue(self, start)

    def Path(self, start: ArrayLike) -> NeedlePath:
        """Returns the path of a needle whose tip starts at `start`, m (3 or more)."""
        inwards = UnitNormal(self.direction, 3)
        p = np.array(start, dtype=float)[:3]
        needle = self.direction if self.needle is None else self.needle
        return NeedlePath(
            entry=p + (self.start - inwards @ p) * inwards,
            inwards=inwards,
            bend=np.array(self.bend, dtype=float),
            needle=UnitNormal(needle, 3),
            stiffness=float(self.stiffness),
            drag=float(self.drag),
        )


class NeedleInTissue(FixedBlock):
    """Wrench of a needle on tissue, measured by a sensor at its tip; see laws.needle.

    | port | name              | size | unit                              |
    |------|-------------------|------|-----------------------------------|
    | in   | tool_position     | 6    | [m; rad]                          |
    | in   | tool_velocity     | 6    | [m/s; rad/s]                      |
    | out  | environment_force | 6    | [N; N m about T], BY the robot    |

    | parameter | name      | unit    |
    |-----------|-----------|---------|
    | 0         | stiffness | N/m^2   |
    | 1         | drag      | N s/m^2 |

    State (discrete, 1): whether the tip is in the tissue. The force jumps there unless
    the tip enters on the path; the instant is located, as in LayeredForceField.

    Initial value: determined by the initial position. Direct feedthrough: from both
    inputs. The needle must stay within a right angle of the direction into the tissue.

    The tissue is not cut, and closes at once behind the needle. There is no Coulomb
    friction: the drag is viscous. The path is given; the needle neither bends nor cuts
    a path of its own.
    """

    is_compiled = True

    numeric_parameters: ClassVar = {
        "stiffness": Range("N/m^2", minimum=0),
        "drag": Range("N s/m^2", minimum=0),
    }

    def __init__(self, config: NeedlePathConfig, start: ArrayLike):
        config.Check()
        n = np.size(start)
        if n != 6:
            Refuse("environment.kind", config.kind, f"another one for {n} task axes")
        normal_W = UnitNormal(config.direction, n)
        self._surface = PlaneSurface("entry", config.start, normal_W)
        # Two layers as in LayeredForceField: empty space, mode 0, and tissue, mode 1.
        starts = np.array([-math.inf, config.start])
        law = (needle_wrench, "path", "mode", "tool_position", "tool_velocity")
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters={
                    "path": config.Path(start),
                    "layers": starts[:, np.newaxis],
                    "axis": normal_W[np.newaxis],
                    **LayerLimits(starts),
                },
                outputs={"environment_force": law},
                initial_mode=LAYER_HERE,
                transitions={"crosses_surface": LEAVES_LAYER},
            ),
            inputs={"tool_position": 6, "tool_velocity": 6},
            outputs={"environment_force": 6},
            mode=[0.0],
        )

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns the surface of the tissue."""
        return (self._surface,)

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns that the mode stays: the tip is in the tissue, or in front of it."""
        return LinearPart(has_modes=True)
