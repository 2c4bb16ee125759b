"""The drive of a robot, between the control law and the tool."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import LinearSystem, PassThrough, Saturation

from teleop_drake.systems.gear_friction import GearFriction
from teleop_drake.validation import FixedFields, Number


@dataclass(kw_only=True, eq=False)
class ActuatorConfig(FixedFields):
    """The drive of the robot, in the task space. The thesis has an ideal one.

    Each task axis is as if it had its own drive: an arm whose joints have equal drives
    of bandwidth w has the same, as long as it turns slowly against w.
    """

    # Bandwidth w of the first-order lag of the force, rad/s, > 0. Null: no lag.
    bandwidth: float | None = Number(None, "rad/s", above=0)
    # Largest force on each axis, N, > 0. Null: no limit.
    force_limit: float | None = Number(None, "N", above=0)
    # Coulomb's friction of the gears F_C, N, >= 0.
    coulomb_friction: float = Number(0.0, "N", minimum=0)
    # Speed v_s over which it changes its sign, m/s, > 0. Assumed.
    friction_speed: float = Number(1e-3, "m/s", above=0)
    # Viscous friction of the gears B, N s/m, >= 0.
    viscous_friction: float = Number(0.0, "N s/m", minimum=0)

    @property
    def is_ideal(self) -> bool:
        """Whether the robot gets the force that the law asks for, as in the thesis."""
        return not (self.bandwidth or self.force_limit or self.has_friction)

    @property
    def has_friction(self) -> bool:
        """Whether the gears have friction."""
        return self.coulomb_friction > 0 or self.viscous_friction > 0


class Actuator(Diagram):
    """Delivers the force that a control law asks for, late, limited and with losses.

        F_l      = F_c between -limit and limit                  `force_limit`
        dF_m/dt  = w (F_l - F_m)                                 `force_lag`
        F        = F_m - F_C v/sqrt(v^2 + v_s^2) - B v           `gear_friction`

    on each axis. The lag stands for the current loop and the motor; the limit acts on
    its command, so that F_m keeps it as well. What the config leaves out is not there.

    | port | name            | size | unit |
    |------|-----------------|------|------|
    | in   | commanded_force | n    | N    |
    | in   | tool_velocity   | n    | m/s  |
    | out  | control_force   | n    | N    |

    State: F_m (n) with a lag. Initial value: 0. Direct feedthrough: from
    commanded_force without a lag, from tool_velocity with friction.

    A motor's inertia is the robot's; a limit of torques in the joints, which depends on
    the pose, is too.

    Args:
        config: What the drive is like.
        num_axes: Number n of axes, >= 1.

    Raises:
        ValueError: If a parameter is not allowed.
    """

    def __init__(self, config: ActuatorConfig, *, num_axes: int):
        Diagram.__init__(self)
        config.CheckNumbers("actuator")
        builder, n = DiagramBuilder(), num_axes
        limit = math.inf if config.force_limit is None else config.force_limit
        first = builder.AddNamedSystem(
            "force_limit", Saturation(np.full(n, -limit), np.full(n, limit))
        )
        builder.ExportInput(first.get_input_port(), "commanded_force")
        force = first.get_output_port()
        if config.bandwidth is not None:
            w, zero = config.bandwidth * np.eye(n), np.zeros((n, n))
            lag = builder.AddNamedSystem(
                "force_lag", LinearSystem(-w, w, np.eye(n), zero)
            )
            builder.Connect(force, lag.get_input_port())
            force = lag.get_output_port()
        velocity = builder.AddNamedSystem("tool_velocity", PassThrough(n))
        builder.ExportInput(velocity.get_input_port(), "tool_velocity")
        if config.has_friction:
            gears = builder.AddNamedSystem(
                "gear_friction",
                GearFriction(
                    num_axes=n,
                    coulomb=config.coulomb_friction,
                    speed=config.friction_speed,
                    viscous=config.viscous_friction,
                ),
            )
            builder.Connect(force, gears.GetInputPort("drive_force"))
            builder.Connect(
                velocity.get_output_port(), gears.GetInputPort("tool_velocity")
            )
            force = gears.get_output_port()
        builder.ExportOutput(force, "control_force")
        builder.BuildInto(self)
        self.set_name("actuator")
