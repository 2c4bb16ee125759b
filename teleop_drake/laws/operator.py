"""The laws of the operators: stated intentions, and a human who closes the loop.

Stated intentions (2.5): a velocity until contact is felt, then a force.

    mode 0, velocity: v_d = velocity, F_h = force of the haptic device
    mode 1, force:    v_d = 0,        F_h = contact_force
    mode 2, stopped:  v_d = 0,        F_h = 0 if contact was perceived, otherwise that
                                      of the haptic device, which brakes the tool

What the operator knows is kept as two numbers, [contact perceived, stopped], 0 or 1.

A human who closes the loop: crossover model, neuromuscular lag, yielding arm.

    e       = start + velocity t - p(t - tau)          goal: position
    de/dt   = velocity - v(t - tau)                    goal: velocity, e(0) = 0
    lag dv_i/dt = crossover e - v_i                    what the muscles are told to do
    mass dw/dt  = -F_h - damping w - stiffness y,  dy/dt = w     how the arm yields
    v_d     = v_i + w

p and v are the tool's motion as it is felt, tau the human's reaction delay, F_h the
force that the hand applies to the device. With a tool that follows the command at once,
dp/dt = v_d, the open loop is crossover exp(-tau s)/(s (lag s + 1)): McRuer's crossover
model (McRuer and Jex, "A review of quasi-linear pilot models", IEEE Transactions on
Human Factors in Electronics 8, 1967, p. 231) with his neuromuscular lag. The arm is a
mass, a damper and a spring (Hogan, "Controlling impedance at the man/machine
interface", ICRA 1989; Tsuji, Morasso, Goto and Ito, "Human hand impedance
characteristics during maintained posture", Biological Cybernetics 72, 1995, p. 475).
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array


def operator_mode(state: Array) -> float:
    """Returns the mode."""
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
    """Every number of the human; the same on each axis.

    Attributes:
        start: p_WT at time 0 in m (n).
        velocity: Of the goal in m/s (n).
        crossover: omega_c in rad/s.
        lag: T_N in s.
        mass: Of the arm in kg.
        damping: Of the arm in N s/m.
        stiffness: Of the arm in N/m.
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
        state: [v_i, y, w], and e behind them if the goal is a velocity.
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
        felt: [p, v] of the tool, tau ago, in m and m/s (2 n).
        haptic_force: F_h in N (n).
    """
    n = human.velocity.size
    error = human.start + human.velocity * time - felt[:n]
    return _muscles_and_arm(state, error, haptic_force, human)


def rate_to_velocity(
    state: Array, felt: Array, haptic_force: Array, human: HumanOperator
) -> Array:
    """Returns d/dt [v_i, y, w, e] of a human who keeps a velocity.

    Args:
        state: [v_i, y, w, e] in m/s, m, m/s and m (4 n).
        felt: [p, v] of the tool, tau ago, in m and m/s (2 n).
        haptic_force: F_h in N (n).
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
