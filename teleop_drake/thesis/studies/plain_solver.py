"""The loop of one axis as a solver that locates nothing solves it."""

import bisect
from collections.abc import Sequence

import numpy as np

from teleop_drake.laws.layered_force import layer_force, layer_index
from teleop_drake.numerics.transfer_function import realize_transfer_function
from teleop_drake.scenario import Scenario

# Dormand and Prince's 5(4) pair, MATLAB's ode45.
_STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)


_TIMES = (1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)

_ERROR = (
    71 / 57600,
    0.0,
    -71 / 16695,
    71 / 1920,
    -17253 / 339200,
    22 / 525,
    -1 / 40,
)


def SolvePlainly(
    scenario: Scenario, *, tolerance: float, max_step: float, end: float
) -> tuple[list[float], list[float], list[float]]:
    """Solves the loop of one axis with direct force as a plain ode45 would.

    That is: Dormand-Prince 5(4) with error control relative to max(|y|, |v_d|) in each
    state; nothing located, so that a step may lie across a border of a layer; delays
    by linear interpolation between the steps, and extrapolation where a step is longer
    than the delay; the surgeon's switch at the first step after contact is felt.

    Args:
        scenario: One axis, transport channels, a contact force; its simulator and its
            controller are ignored.
        tolerance: Relative tolerance.
        max_step: Longest step in s.
        end: When to stop, in s.

    Returns:
        Times in s, positions in m and velocities in m/s at the ends of the steps.
    """
    mass, damping = scenario.robot.mass, scenario.robot.damping
    assert mass is not None and damping is not None
    surface, force = scenario.contact_surface, scenario.surgeon.contact_force
    assert surface is not None and force is not None
    T_f, T_r = scenario.forward_channel.delay, scenario.return_channel.delay
    velocity = float(scenario.surgeon.velocity[0])
    layers = scenario.environment.layers
    starts = [layer.start for layer in layers]
    A, B, C, D = (
        np.asarray(matrix).tolist()
        for matrix in realize_transfer_function(
            scenario.haptic_device.numerator, scenario.haptic_device.denominator
        )
    )
    time, x_log, v_log, F_log = [0.0], [float(scenario.robot.start[0])], [0.0], [0.0]
    in_force_mode = False

    def Delayed(log: list[float], t: float) -> float:
        if t <= 0.0 or len(time) == 1:
            return log[0]
        i = min(bisect.bisect_right(time, t), len(time) - 1)
        share = (t - time[i - 1]) / (time[i] - time[i - 1])
        return log[i - 1] + (log[i] - log[i - 1]) * share

    def Rate(t: float, y: Sequence[float]) -> list[float]:
        x, v, a, b = y
        i = layer_index(starts, x)
        F_e = layer_force(layers[i], x, v) if i >= 0 else 0.0
        error = (0.0 if in_force_mode else velocity) - Delayed(v_log, t - T_r)
        return [
            v,
            (Delayed(F_log, t - T_f) - F_e - damping * v) / mass,
            A[0][0] * a + A[0][1] * b + B[0][0] * error,
            A[1][0] * a + A[1][1] * b + B[1][0] * error,
        ]

    t, y = 0.0, [x_log[0], 0.0, 0.0, 0.0]
    h = min(max_step, 0.01)
    first = Rate(t, y)
    while t < end:
        h = min(h, max_step)
        while True:
            rates = [first]
            for weights, share in zip(_STAGES, _TIMES, strict=True):
                new = [
                    y[i]
                    + h * sum(w * k[i] for w, k in zip(weights, rates, strict=True))
                    for i in range(4)
                ]
                rates.append(Rate(t + share * h, new))
            error = max(
                abs(h * sum(w * k[i] for w, k in zip(_ERROR, rates, strict=True)))
                / max(abs(y[i]), abs(new[i]), abs(velocity))
                for i in range(4)
            )
            if error <= tolerance or h < 1e-9:
                break
            h *= max(0.1, 0.8 * (tolerance / error) ** 0.2)
        t, y = t + h, new
        if not in_force_mode and Delayed(x_log, t - T_r) >= surface:
            in_force_mode = True
        v_error = (0.0 if in_force_mode else velocity) - Delayed(v_log, t - T_r)
        F_h = C[0][0] * y[2] + C[0][1] * y[3] + D[0][0] * v_error
        time.append(t)
        x_log.append(y[0])
        v_log.append(y[1])
        F_log.append(float(force[0]) if in_force_mode else F_h)
        first = Rate(t, y)
        h *= min(5.0, 0.8 * (tolerance / max(error, 1e-30)) ** 0.2)
    return time, x_log, v_log
