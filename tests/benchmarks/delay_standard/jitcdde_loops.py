"""JiTCDDE: delay differential equations; here without its C compiler, by lambdas."""

import warnings

import numpy as np
from benchmarks.delay_standard.simulator import Simulator
from jitcdde import jitcdde, t, y

TOLERANCE = 1e-9


class Jitcdde(Simulator):
    name = "JiTCDDE"

    @staticmethod
    def _solve(law, T, past, start, times):
        """Integrates from a start on, before which the state was constant."""
        dde = jitcdde(law, delays=[0, T], verbose=False)
        dde.constant_past(past, time=start)
        dde.generate_lambdas(simplify=False)
        dde.set_integration_parameters(
            rtol=TOLERANCE, atol=TOLERANCE, first_step=1e-4, min_step=1e-12, max_step=T
        )
        dde.step_on_discontinuities()
        later = times[times > start + 1e-9]
        before = [past[0]] * (len(times) - len(later))
        with warnings.catch_warnings():  # That steps are longer than these.
            warnings.filterwarnings("ignore", "The target time is smaller")
            return np.array([*before, *(dde.integrate(t)[0] for t in later)])

    def scalar_loop(self, k, T, times):
        return self._solve([-k * y(0, t - T)], T, [1.0], 0.0, times)

    def pd(self, sensor, actuator, times):
        """The mass rests until the first force has passed the actuator's delay."""
        T = sensor + actuator
        law = [y(1), 4 * (1 - y(0, t - T)) - 2 * y(1, t - T)]
        return self._solve(law, T, [0.0, 0.0], actuator, times)
