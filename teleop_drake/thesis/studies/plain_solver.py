"""The loop of one axis as a solver that locates nothing solves it."""

import bisect

import numpy as np

from teleop_drake.environments import CONTACT, FindSurface
from teleop_drake.numerics.transfer_function import realize_transfer_function
from teleop_drake.robots import SliderConfig
from teleop_drake.scenario import Scenario


def SolvePlainly(
    scenario: Scenario, *, tolerance: float, max_step: float, end: float
) -> tuple[list[float], list[float], list[float]]:
    """Solves the loop of one axis with direct force as a plain ode45 would.

    That is: Dormand-Prince 5(4), here scipy's RK45, with error control relative to
    |y| + |v_d| in each state; nothing located, so that a step may lie across a border
    of a layer; delays by linear interpolation between the steps, and extrapolation
    where a step is longer than the delay; the surgeon's switch at the first step after
    contact is felt.

    Args:
        scenario: One axis, transport channels, a contact force; its simulator and its
            controller are ignored.
        tolerance: Relative tolerance.
        max_step: Longest step in s.
        end: When to stop, in s.

    Returns:
        Times in s, positions in m and velocities in m/s at the ends of the steps.

    Raises:
        ImportError: If scipy is not installed.
        RuntimeError: If the solver cannot meet the tolerance.
    """
    # Only this study needs scipy, which the package can do without.
    from scipy.integrate import RK45

    assert isinstance(scenario.robot, SliderConfig)
    mass, damping = scenario.robot.mass, scenario.robot.damping
    assert mass is not None and damping is not None
    surfaces = scenario.Surfaces()
    contact, force = FindSurface(surfaces, CONTACT), scenario.surgeon.contact_force
    assert contact is not None and force is not None
    surface = float(contact.point_W[0])
    T_f, T_r = scenario.forward_channel.delay, scenario.return_channel.delay
    velocity = float(scenario.surgeon.velocity[0])
    materials = [surface.material for surface in surfaces]
    starts = [float(surface.point_W[0]) for surface in surfaces]
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

    def Rate(t: float, y: np.ndarray) -> np.ndarray:
        x, v, a, b = y.tolist()
        i = bisect.bisect_right(starts, x) - 1
        material = materials[i] if i >= 0 else None
        F_e = 0.0 if material is None else material.Force(x, v)
        error = (0.0 if in_force_mode else velocity) - Delayed(v_log, t - T_r)
        return np.array(
            [
                v,
                (Delayed(F_log, t - T_f) - F_e - damping * v) / mass,
                A[0][0] * a + A[0][1] * b + B[0][0] * error,
                A[1][0] * a + A[1][1] * b + B[1][0] * error,
            ]
        )

    solver = RK45(
        Rate,
        0.0,
        [x_log[0], 0.0, 0.0, 0.0],
        end,
        max_step=max_step,
        first_step=min(max_step, 0.01),
        rtol=tolerance,
        atol=tolerance * abs(velocity),
    )
    while solver.status == "running":
        message = solver.step()
        if message is not None:
            raise RuntimeError(f"the plain solver at {solver.t} s: {message}")
        t, (x, v, a, b) = solver.t, solver.y.tolist()
        if not in_force_mode and Delayed(x_log, t - T_r) >= surface:
            in_force_mode = True
        error = (0.0 if in_force_mode else velocity) - Delayed(v_log, t - T_r)
        F_h = C[0][0] * a + C[0][1] * b + D[0][0] * error
        time.append(t)
        x_log.append(x)
        v_log.append(v)
        F_log.append(float(force[0]) if in_force_mode else F_h)
        # The first stage of the next step knows what has just been logged.
        solver.f = Rate(t, solver.y)
    return time, x_log, v_log
