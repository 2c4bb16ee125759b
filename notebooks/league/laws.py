"""A control law that takes part in the league: a plain function, see own_law."""

from teleop_drake.loops.framework.arrays import Array


def linear_core(
    haptic_force: Array,
    velocity_command: Array,
    tool_position: Array,
    tool_velocity: Array,
    environment_force: Array,
    B: float = 2.0,
    Lambda: float = 0.5,
) -> Array:
    """Returns the force of the adaptive law's linear core in N (n).

        F_c = F_e - B (v - v_dd) - B Lambda (F_e - F_hd)

    That is (4.23) and (5.22) with z = 0 and without networks, B = Psi^-1 G1. With
    B Lambda = 1, as by default, it is a damper against the command.

    Args:
        B: Damping in N s/m.
        Lambda: Weight of the force error in m/(N s).
    """
    velocity_error = tool_velocity - velocity_command
    force_error = environment_force - haptic_force
    return environment_force - B * (velocity_error + Lambda * force_error)
