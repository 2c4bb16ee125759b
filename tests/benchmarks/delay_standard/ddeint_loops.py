"""ddeint: delay differential equations, by a solver of scipy's from output to output.

Its laws read the state from the solution until the last output: what a law takes
without a delay is held from one output to the next.
"""

import numpy as np
from benchmarks.delay_standard.simulator import NotOffered, Simulator
from ddeint.ddeint import dde, ddeVar

# Between two outputs, s. The effort grows with the square of their number.
STEP = 1e-3
SHORT_STEP = 1e-4


class Ddeint(Simulator):
    name = "ddeint"

    @staticmethod
    def _solve(rate, past, start, times, step):
        """Returns the first state; before the start, the state was the past.

        Its function ddeint() takes VODE with scipy's tolerances, which are coarser.
        """
        solver = dde(rate)
        solver.set_integrator("dopri5", rtol=1e-9, atol=1e-9)
        solver.set_initial_value(ddeVar(lambda t: past, start))
        solver.set_f_params([])
        grid = start + step * np.arange(round((times[-1] - start) / step) + 1)
        values = [np.atleast_1d(past), *(solver.integrate(t) for t in grid[1:])]
        return np.interp(times, grid, np.array(values)[:, 0])

    def scalar_loop(self, k, T, times):
        return self._solve(lambda x, t: -k * x(t - T), 1.0, 0.0, times, STEP)

    def pd(self, sensor, actuator, times):
        """The mass rests until the first force has passed the actuator's delay."""
        if times[-1] > 30:
            raise NotOffered("long runs take minutes")
        T = sensor + actuator

        def rate(x, t):
            late = x(t - T)
            return np.array([x(t)[1], 4 * (1 - late[0]) - 2 * late[1]])

        return self._solve(rate, np.zeros(2), actuator, times, SHORT_STEP)
