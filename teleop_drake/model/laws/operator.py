"""The laws of the operators: planned commands, and a human who closes the loop.

Planned commands (2.5): a velocity until contact is perceived, then a force.

    mode 0, velocity: v_d = velocity, F_h = force of the haptic device
    mode 1, force:    v_d = 0,        F_h = contact_force
    mode 2, stopped:  v_d = 0,        F_h = 0 if contact was perceived, otherwise the
                                      force of the haptic device, which brakes the tool

The operator's state is two numbers, [contact perceived, stopped], each 0 or 1.

A human who closes the loop: crossover model, neuromuscular lag, compliant arm.

    e       = start + velocity t - p(t - tau)          goal: position
    de/dt   = velocity - v(t - tau)                    goal: velocity, e(0) = 0
    lag dv_i/dt = crossover e - v_i                    intended velocity
    mass dw/dt  = -F_h - damping w - stiffness y,  dy/dt = w     deflection of the arm
    v_d     = v_i + w

p and v are the tool's felt position and velocity, tau is the human's reaction delay,
and F_h is the force of the hand on the device. If the tool follows the command without
delay, dp/dt = v_d, the open loop is crossover exp(-tau s)/(s (lag s + 1)). This is the
crossover model with neuromuscular lag (McRuer and Jex, "A review of quasi-linear pilot
models", IEEE Transactions on Human Factors in Electronics 8, 1967, p. 231). The arm is
a mass, a damper and a spring (Hogan, "Controlling impedance at the man/machine
interface", ICRA 1989; Tsuji, Morasso, Goto and Ito, "Human hand impedance
characteristics during maintained posture", Biological Cybernetics 72, 1995, p. 475).
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array


def operator_mode(state: Array) -> float:
    """Returns the mode, 0, 1 or 2, of a state [contact perceived, stopped]."""
    return 2.0 if state[1] else state[0]


def velocity_command(state: Array, velocity: Array) -> Array:
    """Returns v_d in m/s (n)."""
    return velocity if operator_mode(state) == 0 else np.zeros_like(velocity)


def force_command(state: Array, haptic_force: Array, contact_force: Array) -> Array:
    """Returns F_h in N (n)."""
    if not state[0]:
        return haptic_force
    return np.zeros_like(contact_force) if state[1] else contact_force


class HumanOperator(NamedTuple):
    """The constants of a human; the numbers hold for every axis.

    Attributes:
        start: Position p_WT of the tool at time 0 in m (n).
        velocity: Velocity of the goal in m/s (n).
        crossover: Crossover frequency omega_c in rad/s.
        lag: Neuromuscular lag T_N in s.
        mass: Mass of the arm in kg.
        damping: Damping of the arm in N s/m.
        stiffness: Stiffness of the arm in N/m.
    """

    start: Array
    velocity: Array
    crossover: float
    lag: float
    mass: float
    damping: float
    stiffness: float


def intended_velocity(state: Array, human: HumanOperator) -> Array:
    """Returns v_d = v_i + w in m/s (n).

    Args:
        state: [v_i, y, w], followed by e if the goal is a velocity (3n or 4n).
        human: The constants.
    """
    n = human.velocity.size
    return state[:n] + state[2 * n : 3 * n]


def rate_to_position(
    state: Array, time: float, felt: Array, haptic_force: Array, human: HumanOperator
) -> Array:
    """Returns d/dt [v_i, y, w] of a human who follows a position.

    Args:
        state: [v_i, y, w] in m/s, m and m/s (3 n).
        time: t in s.
        felt: [p, v] of the tool, delayed by tau, in m and m/s (2 n).
        haptic_force: F_h in N (n).
        human: The constants.
    """
    n = human.velocity.size
    error = human.start + human.velocity * time - felt[:n]
    return _muscles_and_arm(state, error, haptic_force, human)


def rate_to_velocity(
    state: Array, felt: Array, haptic_force: Array, human: HumanOperator
) -> Array:
    """Returns d/dt [v_i, y, w, e] of a human who follows a velocity.

    Args:
        state: [v_i, y, w, e] in m/s, m, m/s and m (4 n).
        felt: [p, v] of the tool, delayed by tau, in m and m/s (2 n).
        haptic_force: F_h in N (n).
        human: The constants.
    """
    n = human.velocity.size
    rest = _muscles_and_arm(state, state[3 * n :], haptic_force, human)
    return np.concatenate((rest, human.velocity - felt[n:]))


def _muscles_and_arm(
    state: Array, error: Array, haptic_force: Array, human: HumanOperator
) -> Array:
    """Returns d/dt [v_i, y, w]."""
    n = human.velocity.size
    v_i = state[:n]
    y = state[n : 2 * n]
    w = state[2 * n : 3 * n]
    dv_i = (human.crossover * error - v_i) / human.lag
    dw = (-haptic_force - human.damping * w - human.stiffness * y) / human.mass
    return np.concatenate((dv_i, w, dw))
