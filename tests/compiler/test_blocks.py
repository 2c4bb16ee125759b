"""Every block of the package has a kernel that computes what the block does."""

import pytest

from teleop_drake.compiler.check import CheckKernel
from teleop_drake.scenario import LoadScenario
from teleop_drake.teleoperator import MakeTeleoperator

CONTROLLERS = ["direct_force", "adaptive_backstepping"]


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("name", ["one_dof", "two_dof_combined"])
def test_a_scenario_compiles(name, controller):
    scenario = LoadScenario(name)
    scenario.controller.kind = controller
    CheckKernel(MakeTeleoperator(scenario), num_states=3)
