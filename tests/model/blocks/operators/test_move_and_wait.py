"""The operator who moves and waits, on a tool that follows the delayed command."""

import math

import numpy as np
import pytest
from grids import Slow
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Integrator

from teleop_drake import (
    AnalyzeStability,
    LoadScenario,
    MoveAndWaitConfig,
    TransportDelay,
    simulate,
)
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.scenario import ScenarioError

START = np.array([0.2, 0.1])
WAY = np.array([0.3, -0.4])
SPEED = 0.25
SHARE = 0.7
TOLERANCE = 0.05
REACTION = 0.2
SHORTEST = 0.3


def Config(**changes):
    fields = {"velocity": np.array([SPEED, 0.0]), "goal": WAY, "share": SHARE}
    fields |= {"tolerance": TOLERANCE, "reaction_time": REACTION}
    return MoveAndWaitConfig(**fields | changes)


def MakeLoop(config, forward, back, surface=None):
    """A tool whose velocity is the command, `forward` late, and is seen `back` late."""
    builder = DiagramBuilder()
    operator = builder.AddNamedSystem(
        "operator", config.MakeOperator(start=START, contact_surface=surface)
    )
    there = builder.AddNamedSystem("there", TransportDelay(forward, 2))
    tool = builder.AddNamedSystem("tool", Integrator(START))
    back_velocity = builder.AddNamedSystem(
        "velocity", TransportDelay(forward + back, 2)
    )
    back_position = builder.AddNamedSystem("position", TransportDelay(back, 2, START))
    force = builder.AddNamedSystem("force", ConstantVectorSource([0.0, 0.0]))
    command = operator.GetOutputPort("velocity_command")
    builder.Connect(command, there.get_input_port())
    builder.Connect(there.get_output_port(), tool.get_input_port())
    builder.Connect(tool.get_output_port(), back_position.get_input_port())
    builder.Connect(command, back_velocity.get_input_port())
    for name, source in (
        ("felt_position", back_position),
        ("felt_velocity", back_velocity),
        ("haptic_force", force),
    ):
        builder.Connect(source.get_output_port(), operator.GetInputPort(name))
    builder.ExportOutput(command, "velocity_command")
    builder.ExportOutput(operator.GetOutputPort("mode"), "mode")
    builder.ExportOutput(tool.get_output_port(), "tool_position")
    diagram = builder.Build()
    diagram.set_name("loop")
    return diagram


def Moves(delay):
    """When each move begins and how long it takes in s, and d/share in m, on paper."""
    time = 0.0
    remaining = math.hypot(*WAY)
    moves = []
    tolerance = TOLERANCE * remaining
    rest_speed = 0.1 * tolerance / REACTION
    while remaining > tolerance:
        d = SHARE * remaining
        duration = max(1.875 * d / SPEED, SHORTEST)
        moves.append((time, duration, remaining))
        # Rest is seen where 30 d/T_m tau^2 (1 - tau)^2 falls to the speed of rest.
        q = math.sqrt(rest_speed * duration / (30 * d))
        tau = (1 + math.sqrt(1 - 4 * q)) / 2
        time += delay + tau * duration + REACTION
        remaining -= d
    return moves


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "forward", "back"),
    Slow([("compiled", 0.3, 0.5), ("drake", 0.3, 0.1), ("compiled", 0.0, 0.0)]),
)
def test_moves_as_on_paper(engine, forward, back):
    moves = Moves(forward + back)
    # ln 0.05 / ln 0.3, rounded up.
    assert len(moves) == 3
    recording = simulate(
        MakeLoop(Config(), forward, back),
        duration=9.0,
        simulator=SimulatorConfig(
            integration_scheme="runge_kutta5", accuracy=1e-8, max_step_size=0.05
        ),
        engine=engine,
    )
    direction = WAY / math.hypot(*WAY)
    for begin, duration, remaining in moves:
        times = begin + duration * np.array([0.02, 0.25, 0.5, 0.75, 0.98, 1.0])
        tau = np.clip((times - begin) / duration, 0, 1)
        speed = SHARE * remaining / duration * 30 * tau**2 * (1 - tau) ** 2
        found = recording.Interpolate("velocity_command", times)
        assert_allclose(found, np.outer(speed, direction), atol=1e-4)
        middle = recording.Interpolate("velocity_command", [begin + duration / 2])
        largest = min(SPEED, 1.875 * SHARE * remaining / SHORTEST)
        assert np.linalg.norm(middle) == pytest.approx(largest, rel=1e-3)
    end = START + WAY * (1 - 0.3**3)
    assert_allclose(recording["tool_position"][-1], end, atol=1e-4)


def test_each_move_waits_for_a_round_trip():
    """The time of the last move grows by a round trip for each move before it."""
    first = Moves(0.1)[-1][0]
    later = Moves(1.1)[-1][0]
    assert later - first == pytest.approx(2 * 1.0)
    recording = simulate(MakeLoop(Config(), 0.6, 0.5), duration=12.0)
    moving = np.linalg.norm(recording["velocity_command"], axis=1) > 1e-9
    begins = recording.time[1:][moving[1:] & ~moving[:-1]]
    assert begins[-1] == pytest.approx(later, abs=0.08)


def test_contact_and_stop_end_the_moves():
    surface = Surface("contact", [0.3, 0.0], [1.0, 0.0])
    config = Config(contact_force=np.array([0.2, 0.0]), stop_time=4.0)
    recording = simulate(MakeLoop(config, 0.1, 0.1, surface), duration=6.0)
    modes = recording.Interpolate("mode", [0.5, 3.0, 5.0])[:, 0]
    assert_allclose(modes, [0, 1, 2], rtol=1e-12)
    after = recording.time > 3.0
    assert np.all(recording["velocity_command"][after] == 0)


def test_the_analysis_says_what_it_leaves_out():
    scenario = LoadScenario("one_dof", {"surgeon.kind": "move_and_wait"})
    (note,) = (x for x in AnalyzeStability(scenario).notes if "operator" in x)
    assert (
        note == "The operator moves or waits: the plan of a next move is not modelled."
    )


def test_it_is_a_kind_of_scenarios():
    scenario = LoadScenario("two_dof_collision", {"surgeon.kind": "move_and_wait"})
    CheckKernel(scenario.surgeon.MakeOperator(start=[0.85, 0.0]))
    # Where the commanded velocity comes in 1 s.
    habits = scenario.surgeon.MakeHabits(np.array([0.85, 0.0]))
    assert_allclose(habits.goal, [0.95, 0.0])


@pytest.mark.parametrize(
    ("name", "field", "message"),
    [
        ("one_dof", "goal=[0.0]", "goal = [0.0]: must be non-zero"),
        ("one_dof", "goal=[1,2]", "goal = [1.0, 2.0]: must be a list of 1 finite"),
        ("one_dof", "share=1.5", "share = 1.5: must be a"),
        ("one_dof", "tolerance=0", "tolerance = 0.0: must be a"),
        ("puma560_six_axes", "waypoints=[]", "kind = 'move_and_wait': must be"),
    ],
)
def test_refused(name, field, message):
    with pytest.raises(ScenarioError) as error:
        LoadScenario(name, ["surgeon.kind=move_and_wait", f"surgeon.{field}"])
    assert str(error.value).startswith(f"surgeon.{message}")
