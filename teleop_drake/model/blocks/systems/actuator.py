"""The drive of a robot, between the control law and the tool."""

import math

import numpy as np
from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import LinearSystem, PassThrough, Saturation

from teleop_drake.loops.framework.validation import (
    CheckNumber,
    Config,
    FixedFields,
    Number,
)
from teleop_drake.loops.framework.wiring import Connections, Wire
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.model.laws.actuators import delivered_force


@Config
class ActuatorConfig(FixedFields):
    """The drive of the robot, in task space. The drive of the thesis is ideal.

    Each task axis is modelled with a drive of its own. An arm whose joints have equal
    drives of bandwidth w behaves in the same way while its joints turn slowly compared
    with w.
    """

    # Bandwidth w of the first-order lag of the force, rad/s, > 0. Null: no lag.
    bandwidth: float | None = Number(None, "rad/s", above=0)
    # Largest force on each axis, N, > 0. Null: no limit.
    force_limit: float | None = Number(None, "N", above=0)
    # Coulomb friction of the gears F_C, N, >= 0.
    coulomb_friction: float = Number(0.0, "N", minimum=0)
    # Speed v_s within which the Coulomb friction changes sign, m/s, > 0. Assumed.
    friction_speed: float = Number(1e-3, "m/s", above=0)
    # Viscous friction of the gears B, N s/m, >= 0.
    viscous_friction: float = Number(0.0, "N s/m", minimum=0)

    @property
    def is_ideal(self) -> bool:
        """Whether the drive delivers exactly the commanded force, as in the thesis."""
        return not (self.bandwidth or self.force_limit or self.has_friction)

    @property
    def has_friction(self) -> bool:
        """Whether the gears have friction."""
        return self.coulomb_friction > 0 or self.viscous_friction > 0


class GearFriction(FixedBlock):
    """Subtracts the friction of gears from a force.

        F_out = F_in - F_C v/sqrt(v^2 + v_s^2) - B v          on each axis

    with the Coulomb friction F_C, smoothed by the speed v_s, and the viscous friction
    B; see laws.actuators.

    | port | name          | size | unit |
    |------|---------------|------|------|
    | in   | drive_force   | n    | N    |
    | in   | tool_velocity | n    | m/s  |
    | out  | control_force | n    | N    |

    State: none. Direct feedthrough: from both inputs.

    It models no stiction: a force below F_C moves the tool at a speed below v_s or so.
    Each task axis has its own friction, as if it had its own drive. JointFriction
    models friction in the joints of an arm.

    Args:
        coulomb: F_C in N, >= 0.
        speed: v_s in m/s, > 0.
        viscous: B in N s/m, >= 0.
    """

    def __init__(self, *, num_axes: int, coulomb: float, speed: float, viscous: float):
        CheckNumber("coulomb", coulomb, "N", minimum=0)
        CheckNumber("speed", speed, "m/s", above=0)
        CheckNumber("viscous", viscous, "N s/m", minimum=0)
        inputs = ("drive_force", "tool_velocity")
        FixedBlock.__init__(
            self,
            "gear_friction",
            Kernel(
                parameters={"friction": np.array([coulomb, speed, viscous])},
                outputs={"control_force": (delivered_force, "friction", *inputs)},
            ),
            inputs=dict.fromkeys(inputs, num_axes),
            outputs={"control_force": num_axes},
        )


class Actuator(Diagram):
    """Delivers the commanded force with a limit, a lag and friction.

        F_l      = F_c between -limit and limit                  `force_limit`
        dF_m/dt  = w (F_l - F_m)                                 `force_lag`
        F        = F_m - F_C v/sqrt(v^2 + v_s^2) - B v           `gear_friction`

    on each axis. The lag models the current loop and the motor. The limit acts on the
    command of the lag, so that F_m does not exceed it either. The config determines
    which of the three parts exist.

    | port | name            | size | unit |
    |------|-----------------|------|------|
    | in   | commanded_force | n    | N    |
    | in   | tool_velocity   | n    | m/s  |
    | out  | control_force   | n    | N    |

    State: F_m (n) with a lag. Initial value: 0. Direct feedthrough: from
    commanded_force without a lag, from tool_velocity with friction.

    It models neither the inertia of motors nor limits of joint torques, which depend on
    the pose. Both belong to the robot.
    """

    def __init__(self, config: ActuatorConfig, *, num_axes: int):
        Diagram.__init__(self)
        config.CheckNumbers("actuator")
        n = num_axes
        # The chain of limit, lag and friction; `force` is its last block so far.
        limits = np.full(n, config.force_limit or math.inf)
        systems: dict[str, System] = {"force_limit": Saturation(-limits, limits)}
        connections: Connections = {}
        force = "force_limit"
        if config.bandwidth is not None:
            w = config.bandwidth * np.eye(n)
            systems["force_lag"] = LinearSystem(-w, w, np.eye(n), np.zeros((n, n)))
            connections["force_lag"] = force
            force = "force_lag"
        # The input port exists even if there is no friction that depends on it.
        systems["tool_velocity"] = PassThrough(n)
        if config.has_friction:
            systems["gear_friction"] = GearFriction(
                num_axes=n,
                coulomb=config.coulomb_friction,
                speed=config.friction_speed,
                viscous=config.viscous_friction,
            )
            connections["gear_friction.drive_force"] = force
            connections["gear_friction.tool_velocity"] = "tool_velocity"
            force = "gear_friction"
        Wire(
            self,
            "actuator",
            systems,
            inputs={
                "commanded_force": ["force_limit"],
                "tool_velocity": ["tool_velocity"],
            },
            connections=connections,
            outputs={"control_force": force},
        )
