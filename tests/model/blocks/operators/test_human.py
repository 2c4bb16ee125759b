"""The human in the loop: linear model, margin and simulation against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.stability import AnalyzeStability

DELAY = 0.1
REACTION = 0.15
LAG = 0.1


def Load(**overrides):
    return LoadScenario(
        "one_dof",
        {
            "surgeon.kind": "human",
            "surgeon.reaction_delay": REACTION,
            "surgeon.neuromuscular_lag": LAG,
            "controller.kind": "direct_force",
            "environment.layers": [],
            "duration": 30.0,
        }
        | overrides,
    )


def test_reaction_is_an_exact_delay():
    dut = Load().surgeon.MakeOperator(start=[0.2])
    reaction = dut.GetSubsystemByName("reaction")
    assert isinstance(reaction, TransportDelay)
    assert reaction.delay == REACTION


@pytest.mark.parametrize("goal", ["position", "velocity"])
def test_linear_model_of_the_master(goal):
    """[F_h; v_d] against [p; v] as they return, with the exact reaction delay."""
    scenario = Load(**{"surgeon.goal": goal})
    (point,) = OperatingPoints(scenario)
    loop = Linearizer(scenario).Loop(point)
    states = np.arange(loop.system.num_states)
    model = loop.system.part(states, loop.signals.back, loop.signals.forward)
    w_c = scenario.surgeon.crossover_frequency
    for w in (0.3, 2.0, 9.0):
        s = 1j * w
        H = (25 * s + 50) / (s * s + 25 * s)
        muscles = -w_c * np.exp(-s * REACTION) / (LAG * s + 1)
        by_p, by_v = (muscles, 0) if goal == "position" else (0, muscles / s)
        yielding = s / (1.0 * s**2 + 20 * s + 200)
        # v_d = by_p p + by_v v - yielding F_h, F_h = H (v_d - v)
        F_p = H * by_p / (1 + H * yielding)
        F_v = H * (by_v - 1) / (1 + H * yielding)
        expected = [
            [F_p, F_v],
            [by_p - yielding * F_p, by_v - yielding * F_v],
        ]
        G = model.C @ np.linalg.solve(s * np.eye(len(model.A)) - model.A, model.B)
        assert_allclose(G + model.D, expected, rtol=2e-4, atol=1e-7)


def test_the_two_port_does_not_know_who_holds_it():
    scenario = Load()
    thesis = Load(**{"surgeon.kind": "constant_velocity"})
    (point,) = OperatingPoints(scenario)
    mine, theirs = (
        Linearizer(x, at_ports=True).TwoPort(point) for x in (scenario, thesis)
    )
    assert_array_equal(mine.system.A, theirs.system.A)


@pytest.mark.slow
def test_the_loop_grows_as_its_analysis_says():
    """A human who wants too much through too long a delay runs away."""
    is_stable = []
    for crossover, delay in ((1.0, 0.02), (2.0, 0.1)):
        scenario = Load(
            **{
                "surgeon.crossover_frequency": crossover,
                "forward_channel.delay": delay,
                "return_channel.delay": delay,
                "simulator.accuracy": 1e-6,
                "simulator.max_step_size": 0.02,
                "duration": 9.0,
            }
        )
        analysis = AnalyzeStability(scenario)
        assert any("reaction delay" in note for note in analysis.notes)
        is_stable.append(analysis.points[0].is_stable)
        recording = simulate(scenario)
        assert (recording.termination == "completed") == is_stable[-1]
        if is_stable[-1]:
            error = np.abs(recording["tool_velocity"][:, 0] - 0.001)
            early = error[(recording.time > 1) & (recording.time < 4)].max()
            assert error[recording.time > 6].max() < early
    assert is_stable == [True, False]
