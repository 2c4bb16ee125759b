"""The planar arm of the thesis.

Its model file has the masses, lengths and inertias of Appendix A, from which Drake
computes

    M(q) (A.1, A.2), C(q, q') (A.3, A.4), G(q) (A.5, A.6), J(q) (A.7, A.8),
    p_WT(q) (A.13);

c21 of (A.4) is misprinted in the thesis; see thesis/errata. This module has the inverse
kinematics, (A.14).
"""

import functools
import math

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import CheckChoice, Config, Number, Refuse
from teleop_drake.model.blocks.robots.base import (
    LoadModel,
    PlantRobotConfig,
    PointOf,
    ReadModel,
)
from teleop_drake.model.blocks.robots.inverse_kinematics import TOOL

# Sign of q2, the bend of the elbow. If the tool is on the positive x axis, `down` puts
# the elbow at y < 0.
_ELBOW_SIGNS = {"up": -1.0, "down": 1.0}

_OWN_LINK_MASS = 0.5  # kg, of each link in the model file.

# The arm must not start closer to a singularity than this |sin(q2)|; the determinant
# of its Jacobian is L1 L3 sin(q2).
_MINIMUM_ELBOW_SINE = 0.05


@Config
class TwoLinkArmConfig(PlantRobotConfig):
    """Two equal links in the horizontal plane (thesis eq. 2.13; Appendix A)."""

    kind = "two_link_arm"
    is_frictionless = True

    # Bend of the elbow at the start pose: up (y > 0) or down (y < 0).
    elbow: str | None = None
    # Mass of each link, kg, > 0; the inertia scales with it. Null: that of the model.
    link_mass: float | None = Number(None, "kg", above=0)

    def LoadPlant(self, gravity: ArrayLike | None = None) -> MultibodyPlant:
        """Returns the plant; see PlantRobotConfig.LoadPlant."""
        self.CheckNumbers()
        model = ReadModel(self.kind)
        share = 1.0 if self.link_mass is None else self.link_mass / _OWN_LINK_MASS
        for path in ("mass", "inertia/ixx", "inertia/iyy", "inertia/izz"):
            for number in model.iterfind(f".//inertial/{path}"):
                number.text = repr(share * float(str(number.text)))
        return LoadModel(model, gravity)

    def JointPositions(self, p_WT: ArrayLike) -> Array:
        """Returns the joint angles that put the tool at a point, (A.14).

        The arm keeps |sin(q2)| >= 0.05, away from its singular poses, stretched and
        folded.
        """
        p = PointOf(p_WT, 2)
        CheckChoice("elbow", self.elbow, _ELBOW_SIGNS)
        L1, L3 = _LinkLengths()
        cosine_limit = math.sqrt(1 - _MINIMUM_ELBOW_SINE**2)
        reach = math.hypot(*p)
        nearest, farthest = (
            math.sqrt(L1**2 + L3**2 + sign * 2 * L1 * L3 * cosine_limit)
            for sign in (-1, 1)
        )
        if not nearest <= reach <= farthest:
            Refuse(
                "start",
                p,
                f"{nearest:.6g} to {farthest:.6g} m from the shoulder, not "
                f"{reach:.6g} m",
            )
        c2 = (reach**2 - L1**2 - L3**2) / (2 * L1 * L3)
        s2 = _ELBOW_SIGNS[str(self.elbow)] * math.sqrt(1 - c2**2)
        q1 = math.atan2(p[1], p[0]) - math.atan2(L3 * s2, L1 + L3 * c2)
        return np.array([q1, math.atan2(s2, c2)])


@functools.cache
def _LinkLengths() -> tuple[float, float]:
    """Returns the lengths L1 and L3 of the model file in m."""
    plant = TwoLinkArmConfig().LoadPlant()
    context = plant.CreateDefaultContext()
    elbow, tool = (
        plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name)).translation()
        for name in ("lower_link", TOOL)
    )
    # At q = 0 the arm lies stretched along x.
    return elbow[0], tool[0] - elbow[0]
