"""The loop of one axis as a solver that locates nothing solves it."""

import bisect

import numpy as np
from scipy.integrate import RK45

from teleop_drake.environments import CONTACT, FindSurface
from teleop_drake.numerics.transfer_function import realize_transfer_function
from teleop_drake.scenario import Scenario


class _PlainLoop:
    """The loop with direct force, and the log of the steps that it remembers."""

    def __init__(self, scenario: Scenario):
        self._mass, self._damping = scenario.robot.mass, scenario.robot.damping
        surfaces = scenario.Surfaces()
        contact, force = FindSurface(surfaces, CONTACT), scenario.surgeon.contact_force
        self._surface, self._force = float(contact.point_W[0]), float(force[0])
        self._T_f = scenario.forward_channel.delay
        self._T_r = scenario.return_channel.delay
        self._velocity = float(scenario.surgeon.velocity[0])
        self._materials = [surface.material for surface in surfaces]
        self._starts = [float(surface.point_W[0]) for surface in surfaces]
        self._device = [
            np.asarray(matrix).tolist()
            for matrix in realize_transfer_function(
                scenario.haptic_device.numerator, scenario.haptic_device.denominator
            )
        ]
        self._in_force_mode = False
        self.time, self.x = [0.0], [float(scenario.robot.start[0])]
        self.v, self._F = [0.0], [0.0]

    def Rate(self, t: float, y: np.ndarray) -> np.ndarray:
        """Returns dy/dt of y = [x, v, the two states of the haptic device]."""
        x, v, a, b = y.tolist()
        A, B, _, _ = self._device
        i = bisect.bisect_right(self._starts, x) - 1
        material = self._materials[i] if i >= 0 else None
        F_e = 0.0 if material is None else material.Force(x, v)
        F_c = self._Delayed(self._F, t - self._T_f)
        error = self._Error(t)
        return np.array(
            [
                v,
                (F_c - F_e - self._damping * v) / self._mass,
                A[0][0] * a + A[0][1] * b + B[0][0] * error,
                A[1][0] * a + A[1][1] * b + B[1][0] * error,
            ]
        )

    def EndStep(self, t: float, y: np.ndarray) -> None:
        """Logs the end of a step; switches the operator if contact is felt then."""
        x, v, a, b = y.tolist()
        _, _, C, D = self._device
        if self._Delayed(self.x, t - self._T_r) >= self._surface:
            self._in_force_mode = True
        F_h = C[0][0] * a + C[0][1] * b + D[0][0] * self._Error(t)
        self.time.append(t)
        self.x.append(x)
        self.v.append(v)
        self._F.append(self._force if self._in_force_mode else F_h)

    def _Error(self, t: float) -> float:
        """Returns what the haptic device gets, v_d less the felt velocity."""
        command = 0.0 if self._in_force_mode else self._velocity
        return command - self._Delayed(self.v, t - self._T_r)

    def _Delayed(self, log: list[float], t: float) -> float:
        time = self.time
        if t <= 0.0 or len(time) == 1:
            return log[0]
        i = min(bisect.bisect_right(time, t), len(time) - 1)
        share = (t - time[i - 1]) / (time[i] - time[i - 1])
        return log[i - 1] + (log[i] - log[i - 1]) * share


def SolvePlainly(
    scenario: Scenario, *, tolerance: float, max_step: float, end: float
) -> tuple[list[float], list[float], list[float]]:
    """Returns times, positions and velocities at the ends of the steps of an ode45.

    Nothing is located; delays are interpolated linearly between the steps, and the
    operator switches at the first step after contact is felt.
    """
    loop = _PlainLoop(scenario)
    solver = RK45(
        loop.Rate,
        0.0,
        [loop.x[0], 0.0, 0.0, 0.0],
        end,
        max_step=max_step,
        first_step=min(max_step, 0.01),
        rtol=tolerance,
        atol=tolerance * abs(float(scenario.surgeon.velocity[0])),
    )
    while solver.status == "running":
        message = solver.step()
        assert message is None, message
        loop.EndStep(solver.t, solver.y)
        # The first stage of the next step knows what has just been logged.
        solver.f = loop.Rate(solver.t, solver.y)
    return loop.time, loop.x, loop.v


def CollisionNumbers(scenario: Scenario, x: list[float], v: list[float]) -> np.ndarray:
    """Returns first impact, largest force and rebound as read off at the steps."""
    bone = FindSurface(scenario.Surfaces(), CONTACT).material
    F = [bone.stiffness * max(position - bone.relaxed, 0.0) for position in x]
    begin = next(i for i, force in enumerate(F) if force > 0)
    end = next((i for i in range(begin, len(F)) if F[i] == 0), len(F))
    return np.array([max(F[begin:end]), max(F), min(v)])
