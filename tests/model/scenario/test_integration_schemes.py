"""Tests that every accepted integration scheme solves the robot's equations."""

import functools

import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem
from wired import Wired

from teleop_drake.model.blocks.robots import MakeRobot
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.scenario.config import INTEGRATION_SCHEMES

# The position of a slider of 0.5 kg and 0.1 N s/m after 1 s of a force of 1 N through
# the filter 1/(s/5 + 1). It was computed by runge_kutta5, whose results with steps from
# 0.02 to 0.005 s agree to 2e-11.
EXACT = 0.6416652272


@functools.cache
def filtered_push(scheme, step):
    """Returns the position of a slider that is pushed through a filter.

    The filter is added to the Diagram before the slider.
    """
    diagram = Wired(
        {
            "push": ConstantVectorSource([1.0]),
            "lag": LinearSystem([[-5.0]], [[5.0]], [[1.0]], [[0.0]]),
            "robot": MakeRobot(model="slider", start=[0.0]),
            "nothing": ConstantVectorSource([0.0]),
        },
        {
            "lag": "push",
            "robot.control_force": "lag",
            "robot.environment_force": "nothing",
        },
        {"tool_position": "robot.tool_position"},
    )
    simulator = Simulator(diagram)
    config = SimulatorConfig(
        integration_scheme=scheme, use_error_control=False, max_step_size=step
    )
    ApplySimulatorConfig(config, simulator)
    simulator.AdvanceTo(1.0)
    return diagram.GetOutputPort("tool_position").Eval(simulator.get_context())[0]


@pytest.mark.mostly_slow
@pytest.mark.parametrize("scheme", INTEGRATION_SCHEMES)
def test_accepted_schemes_converge_to_one_motion(scheme):
    coarse, fine = (filtered_push(scheme, step) for step in (0.02, 0.01))
    # Half the step has at most half the error. Extrapolation removes an error of first
    # order and leaves one of second order.
    assert abs(fine - EXACT) < max(0.51 * abs(coarse - EXACT), 1e-10)
    assert 2 * fine - coarse == pytest.approx(EXACT, abs=5e-5)


def test_a_scheme_that_takes_a_diagrams_state_for_one_systems_is_refused():
    # If Drake corrects this scheme, it may be accepted.
    assert abs(filtered_push("velocity_implicit_euler", 0.01) - EXACT) > 0.1
    with pytest.raises(ScenarioError, match=r"simulator\.integration_scheme"):
        LoadScenario(
            "one_dof", {"simulator.integration_scheme": "velocity_implicit_euler"}
        )
