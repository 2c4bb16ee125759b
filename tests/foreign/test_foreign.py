"""Copies of systems that others published, in Drake and compiled.

`python tests/benchmarks/published_systems.py --write` makes the documentation's table.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from benchmarks.measuring import OneDigit
from benchmarks.published_systems import HEAD, SYSTEMS, CellsOf
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    DiscreteTimeDelay,
    Gain,
)

from teleop_drake.loops import WritePage, simulate
from teleop_drake.loops.draw.block_diagram import DiagramDot
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.run import CompiledRun

COMPILED = [system for system in SYSTEMS if not system.obstacle]
OTHERS = [system for system in SYSTEMS if system.obstacle]

TABLE = Path(__file__).parents[2] / "teleop_drake/docs/published_systems.md"

# Not where discrete updates happen, s.
TIMES = (0.0123, 0.317, 0.5432)


def in_drake(diagram, context):
    """Returns a Simulator whose errors are far below what is compared."""
    simulator = Simulator(diagram, context.Clone())
    config = SimulatorConfig(
        integration_scheme="runge_kutta5", max_step_size=0.005, accuracy=1e-13
    )
    ApplySimulatorConfig(config, simulator)
    return simulator


@pytest.mark.mostly_slow
@pytest.mark.parametrize("system", SYSTEMS, ids=lambda system: system.name)
def test_it_is_drawn_and_runs(system):
    diagram, context = system.Make()
    assert DiagramDot(diagram).startswith("digraph")
    simulator = in_drake(diagram, context)
    simulator.AdvanceTo(0.1)
    assert simulator.get_context().get_time() == 0.1


@pytest.mark.mostly_slow
@pytest.mark.parametrize("system", COMPILED, ids=lambda system: system.name)
def test_it_compiles_and_moves_as_in_drake(system):
    diagram, context = system.Make()
    simulator = in_drake(diagram, context)
    evaluator = Evaluator(diagram, context, as_machine_code=True)
    run = CompiledRun(evaluator, context, end=1.0, accuracy=1e-13, max_step=0.005)
    for time in TIMES:
        run.Sample(time)
        simulator.AdvanceTo(time)
        own = simulator.get_context()
        x = own.get_continuous_state_vector().CopyToVector()
        groups = range(own.num_discrete_state_groups())
        m = [own.get_discrete_state(i).CopyToVector() for i in groups]
        for value, expected in [
            (run.memory.x, x),
            (run.memory.m, np.concatenate([np.empty(0), *m])),
        ]:
            scale = max(1.0, np.abs(expected).max(initial=0.0))
            np.testing.assert_allclose(value, expected, rtol=0, atol=1e-9 * scale)


def rows_of_the_table():
    """Returns the rows of the documentation's table of copies."""
    table = TABLE.read_text(encoding="utf-8").partition(HEAD)[2]
    return re.findall(r"^\| .*", table, re.M)


def test_the_table_of_the_documentation_is_what_the_command_finds():
    """But for the times, which another test reads."""
    found = [row.strip("| ").split(" | ")[:6] for row in rows_of_the_table()]
    assert found == [CellsOf(system) for system in SYSTEMS]


def test_the_documentation_calls_them_copies():
    text = TABLE.read_text(encoding="utf-8")
    index = (TABLE.parent / "index.md").read_text(encoding="utf-8")
    assert text.startswith("# Copies of ") and "\n| copy of | " in text
    assert "[Copies of published systems](published_systems.md)" in index


def test_the_times_have_one_significant_digit():
    """Of ratios on a busy machine no more is repeatable."""
    times = [x for row in rows_of_the_table() for x in row.split(" | ")[6:]]
    known = [x.strip(" |") for x in times if re.search(r"\d", x)]
    assert len(known) > 80
    assert known == [OneDigit(float(x)) for x in known]


@pytest.mark.parametrize(
    ("ratio", "text"), [(0.66, "0.7"), (1.04, "1"), (26.5, "30"), (129.0, "100")]
)
def test_one_significant_digit(ratio, text):
    assert OneDigit(ratio) == text


@pytest.mark.slow
@pytest.mark.parametrize("system", COMPILED, ids=lambda system: system.name)
def test_it_becomes_a_page(system, tmp_path):
    diagram, context = system.Make()
    WritePage(diagram, tmp_path / "page.html", context=context, vary={})
    assert (tmp_path / "page.html").stat().st_size > 50_000


@pytest.mark.parametrize("system", OTHERS, ids=lambda system: system.name)
def test_what_does_not_compile_is_named(system):
    diagram, context = system.Make()
    obstacle = re.escape(system.obstacle)
    with pytest.raises(UnsupportedSystem, match=f"cannot be compiled: {obstacle}"):
        Evaluator(diagram, context)


@pytest.mark.parametrize("h", [0.1, 0.001])
@pytest.mark.parametrize("k", [0.5, 2.0])
def test_a_sampled_delay_does_not_solve_an_algebraic_loop(h, k):
    """y = r - k y(before) is a sum of (-k)^i r, with a term more every other sample."""
    builder = DiagramBuilder()
    blocks = [Adder(2, 1), DiscreteTimeDelay(h, 1, 1), Gain(-k, 1)]
    for block in blocks:
        builder.AddSystem(block)
    r = builder.AddSystem(ConstantVectorSource([1.0]))
    total, delay, gain = blocks
    builder.Connect(r.get_output_port(), total.get_input_port(0))
    builder.Connect(total.get_output_port(), delay.get_input_port())
    builder.Connect(delay.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), total.get_input_port(1))
    builder.ExportOutput(total.get_output_port(), "y")
    run = simulate(builder.Build(), duration=30.5 * h)
    expected = sum((-k) ** i for i in range(16))
    assert run["y"][-1, 0] == pytest.approx(expected, rel=1e-9)
