"""The drive of a robot, between the control law and the tool."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import LinearSystem, PassThrough, Saturation

from teleop_drake.kernel import FixedBlock, Kernel
from teleop_drake.laws.actuators import delivered_force
from teleop_drake.validation import CheckNumber, FixedFields, Number


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


class GearFriction(FixedBlock):
    """Takes the friction of gears from a force.

        F_out = F_in - F_C v/sqrt(v^2 + v_s^2) - B v          on each axis

    Coulomb's friction F_C, made smooth by the speed v_s, and viscous friction B; see
    laws.actuators.

    | port | name          | size | unit |
    |------|---------------|------|------|
    | in   | drive_force   | n    | N    |
    | in   | tool_velocity | n    | m/s  |
    | out  | control_force | n    | N    |

    State: none. Direct feedthrough: from both inputs.

    It does not stick: a force below F_C moves the tool at a speed below v_s. Each task
    axis has friction of its own, as if it had its own drive; friction in the joints of
    an arm is another matter.

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
    """

    def __init__(self, config: ActuatorConfig, *, num_axes: int):
        Diagram.__init__(self)
        config.CheckNumbers("actuator")
        builder, n = DiagramBuilder(), num_axes
        limit = config.force_limit or math.inf
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
            gears = builder.AddSystem(
                GearFriction(
                    num_axes=n,
                    coulomb=config.coulomb_friction,
                    speed=config.friction_speed,
                    viscous=config.viscous_friction,
                )
            )
            builder.Connect(force, gears.GetInputPort("drive_force"))
            builder.Connect(
                velocity.get_output_port(), gears.GetInputPort("tool_velocity")
            )
            force = gears.get_output_port()
        builder.ExportOutput(force, "control_force")
        builder.BuildInto(self)
        self.set_name("actuator")
