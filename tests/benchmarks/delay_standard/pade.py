"""python-control: Padé's approximation of a delay, made for linear design."""

import control
import numpy as np
from benchmarks.delay_standard.simulator import Input, Simulator

ORDER = 8
INNER = 1e-3


def delay(T: float):
    """Returns the approximation in state space."""
    return control.ss(control.tf(*control.pade(T, ORDER)))


class Pade(Simulator):
    name = "python-control, Padé 8"

    def echo(self, signal: Input, path, times):
        grid = np.arange(round(times[-1] / INNER) + 1) * INNER
        values = np.array([signal(t) for t in grid]).T
        columns = []
        for row in values:
            delayed = row
            for T in path:
                delayed = control.forced_response(delay(T), grid, delayed).outputs
            columns.append(np.interp(times, grid, delayed))
        return np.column_stack(columns)

    def scalar_loop(self, k, T, times):
        """The state is x - 1, which is 0 before; then k acts as a constant input."""
        plant = control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]])
        loop = control.feedback(plant, k * delay(T))
        grid = np.concatenate([[0.0], times])
        return 1 - k * control.step_response(loop, grid).outputs[1:]

    def pd(self, sensor, actuator, times):
        plant = control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), np.zeros((2, 1)))
        gains = control.ss([], [], [], [[4.0, 2.0]])
        if actuator:
            plant = plant * delay(actuator)
        if sensor:
            gains = gains * control.append(delay(sensor), delay(sensor))
        loop = control.feedback(plant, gains) * 4
        grid = np.concatenate([[0.0], times])
        return control.step_response(loop, grid).outputs[0, 0, 1:]
