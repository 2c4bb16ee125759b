"""Coulomb friction of an arm's joints."""

import numpy as np

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.loops.kernel import FixedBlock, Kernel, Term
from teleop_drake.model.laws.actuators import friction_torque


class JointFriction(FixedBlock):
    """Torque of smoothed Coulomb friction in the joints; see laws.actuators.

        tau = -s ((C_+ + C_-)/2 + (C_+ - C_-)/2 s),   s = v/sqrt(v^2 + v_s^2)

    | port | name            | size | unit         |
    |------|-----------------|------|--------------|
    | in   | joint_velocity  | nv   | rad/s or m/s |
    | out  | friction_torque | nv   | N m or N     |

    State: none. Direct feedthrough: yes.

    It models no stiction: a joint that is pushed creeps. Viscous friction is part of
    the plant.

    Args:
        forward: C_+, the friction of each joint while v > 0, in N m or N, >= 0 (nv).
        backward: C_-, the friction of each joint while v < 0, in N m or N, >= 0 (nv).
        speed: v_s in rad/s or m/s, > 0.
    """

    def __init__(self, *, forward: ArrayLike, backward: ArrayLike, speed: float):
        for name, value in (("forward", forward), ("backward", backward)):
            if np.shape(value) != np.shape(forward) or not (
                np.isfinite(value).all() and (np.asarray(value) >= 0).all()
            ):
                Refuse(name, value, "finite numbers >= 0, one for each joint (N m)")
        CheckNumber("speed", speed, "rad/s", above=0)
        parameters = {
            "forward": np.array(forward, dtype=float),
            "backward": np.array(backward, dtype=float),
            "speed": float(speed),
        }
        law: Term = (friction_torque, *parameters, "joint_velocity")
        nv = np.size(forward)
        FixedBlock.__init__(
            self,
            "joint_friction",
            Kernel(parameters=parameters, outputs={"friction_torque": law}),
            inputs={"joint_velocity": nv},
            outputs={"friction_torque": nv},
        )
