"""The default solver, and the most steps that a run may need."""

from pydrake.systems.analysis import SimulatorConfig

MAX_STEPS = 1_000_000
"""The largest number of steps that a scenario may require of a simulation."""


def DefaultSimulator() -> SimulatorConfig:
    """Returns the solver of a System, and of a scenario that names no solver."""
    # Dormand-Prince 5(4), the thesis's ode45. The tolerance is absolute in Drake.
    return SimulatorConfig(
        integration_scheme="runge_kutta5",
        use_error_control=True,
        accuracy=1e-8,
        max_step_size=0.005,
    )
