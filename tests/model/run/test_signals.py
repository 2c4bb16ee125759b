"""The signals that a run records, and the bound that ends it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.primitives import Adder, ConstantVectorSource, Gain, Integrator
from wired import Wired

from teleop_drake.loops.framework.signals import SelectSignals
from teleop_drake.model.run.compile import Compile
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.signals import NamedSignals
from teleop_drake.model.teleoperator import MakeTeleoperator

ENGINES = ["drake", "compiled"]


def nested():
    """Returns x' = 1 - x from 0, in a diagram in a diagram."""
    diagram = Wired(
        {"plant": Integrator(1), "minus": Gain(-1.0, 1), "sum": Adder(2, 1)},
        {"minus": "plant", "sum.u0": "minus", "plant": "sum"},
        {"x": "plant"},
        inputs={"u": "sum.u1"},
    )
    return Wired(
        {"inner": diagram, "source": ConstantVectorSource([1.0])},
        {"inner": "source"},
        {"shown": "inner"},
    )


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_records_the_chosen_signals_of_any_depth(engine):
    names = ["inner/sum.sum", "shown", "source.y0"]
    recording = simulate(nested(), duration=1.0, engine=engine, signals=names)
    assert list(recording) == names
    rate = np.exp(-recording.time)
    assert_allclose(recording["inner/sum.sum"][:, 0], rate, atol=1e-6)
    assert_allclose(recording["shown"][:, 0], 1 - rate, atol=1e-6)


def test_a_program_records_ports_by_names_of_the_user():
    diagram = nested()
    ports = SelectSignals(diagram, ["inner/minus.y0"])
    program = Compile(diagram, duration=1.0, signals={"-x": ports["inner/minus.y0"]})
    recording = program.Run()
    assert list(recording) == ["-x"]
    assert recording["-x"][-1, 0] == pytest.approx(np.exp(-1) - 1, abs=1e-8)


def test_a_signal_that_does_not_exist_is_refused():
    with pytest.raises(ScenarioError, match=r"'inner/sum.sun'.*'inner/sum.sum'"):
        simulate(nested(), duration=1.0, signals=["inner/sum.sun"])
    with pytest.raises(ScenarioError, match=r"signals = 'shown': must be a list"):
        simulate(nested(), duration=1.0, signals="shown")
    with pytest.raises(ScenarioError, match=r"signals = 'torque': must be one of"):
        simulate("one_dof", signals=["torque"])


def test_a_scenario_keeps_the_chosen_signals_and_its_events():
    scenario = LoadScenario("two_dof_combined", {"duration": 2.5})
    whole = simulate(scenario)
    chosen = simulate(scenario, signals=["control_force"])
    assert list(chosen) == ["control_force"]
    assert chosen.events == whole.events
    assert_array_equal(chosen["control_force"], whole["control_force"])


def test_the_names_of_systems_alone_make_no_loop():
    """A teleoperator that is simulated as a Diagram has the signals of a Diagram."""
    diagram = MakeTeleoperator("one_dof")
    plain = simulate(diagram, duration=0.1)
    assert "robot.tool_velocity" in plain
    assert "tool_velocity" not in plain
    named = NamedSignals(diagram.GetSystems())
    loop = simulate(diagram, duration=0.1, signals=named)
    assert_array_equal(loop["tool_velocity"], plain["robot.tool_velocity"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("one_dof", {"controller.kind": "time_domain_passivity"}),
        ("wall_sliding", {}),
    ],
)
def test_a_run_names_the_signals_that_are_not_accurate_between_rows(name, changes):
    recording = simulate(LoadScenario(name, changes))
    exact = simulate(LoadScenario(name, {**changes, "simulator.max_step_size": 5e-4}))
    named = recording.notes[-1].partition(":")[0].split(", ")
    times = np.linspace(0, recording.time[-1], 200_000)
    wrong = set()
    for signal, rows in recording.signals.items():
        error = recording.Interpolate(signal, times) - exact.Interpolate(signal, times)
        if np.any(np.abs(error) > 1e-4 * np.ptp(rows, axis=0) + 1e-12):
            wrong.add(signal)
    assert wrong
    assert wrong <= set(named)
