"""Simulations that several tests look at; each is run once."""

import functools
import sys

from teleop_drake.recording import Recording
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate

TASKS = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")


@functools.cache
def Run(name: str, kind: str, *overrides: str) -> Recording:
    """Simulates a scenario with a controller; overrides are PATH=VALUE."""
    print("simulate", name, kind, *overrides, file=sys.stderr)
    return simulate(LoadScenario(name, [f"controller.kind={kind}", *overrides]))
