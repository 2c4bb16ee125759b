"""The default solver, the accuracy of events and the most steps of a run."""

from pydrake.systems.analysis import SimulatorConfig

MAX_STEPS = 1_000_000
"""The largest number of steps that a scenario may require of a simulation."""

EVENT_ACCURACY = 1e-4
"""The accuracy of the Context, with which Drake locates events.

It locates them to better than a microsecond.
"""

CONFIG = "Drake's SimulatorConfig"
"""What an argument that sets the solver has to be, for messages."""


def DefaultSimulator() -> SimulatorConfig:
    """Returns the solver of a System, and of a scenario that names no solver."""
    # Dormand-Prince 5(4), the thesis's ode45. The tolerance is absolute in Drake.
    return SimulatorConfig(
        integration_scheme="runge_kutta5",
        use_error_control=True,
        accuracy=1e-8,
        max_step_size=0.005,
    )
