"""Copies of published systems: drawn, run, compiled, a page, and times.

`python tests/benchmarks/published_systems.py` tries the systems of tests/foreign, or
those that are named, and prints a row for each; `--write` writes the rows into
docs/published_systems.md, where it keeps the others. The last two columns say how many
times as much processor time as a compiled run of 10 s Drake's Simulator takes: with its
default settings, where the compiled run has the same accuracy, and with the same
settings in both. They are ratios of medians of runs that take turns, to one significant
digit. Compiling is not a part of it. A dash: Drake's run ends with an error.
"""

import argparse
import functools
import math
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.measuring import Alternate, OneDigit
from foreign.drake_examples import DRAKE
from foreign.manipulation import MANIPULATION
from foreign.underactuated import UNDERACTUATED
from foreign.wiring import Published
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, System

from teleop_drake import WritePage
from teleop_drake.loops.draw.block_diagram import DiagramDot
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.run import CompiledRun

SYSTEMS = [*DRAKE, *UNDERACTUATED, *MANIPULATION]

PAGE = Path(__file__).parents[2] / "teleop_drake/docs/published_systems.md"
HEAD = (
    "| copy of | stands for | drawn | run | compiled | page | default | same settings |"
)

DURATION = 10.0
REPEATS = 7
SHORTEST = 0.05  # s of processor time, of a measurement
DEFAULT = SimulatorConfig()
SAME = SimulatorConfig(
    integration_scheme="runge_kutta5", accuracy=1e-6, max_step_size=0.1
)


def runner_in_drake(
    diagram: System, context: Context, config: SimulatorConfig
) -> Callable[[], None]:
    """Returns a function that simulates in Drake's Simulator."""

    def run() -> None:
        simulator = Simulator(diagram, context.Clone())
        # Where events are located.
        simulator.get_mutable_context().SetAccuracy(config.accuracy)
        ApplySimulatorConfig(config, simulator)
        simulator.AdvanceTo(context.get_time() + DURATION)

    return run


def compiled_runner(
    evaluator: Evaluator, context: Context, config: SimulatorConfig
) -> Callable[[], None]:
    """Returns a function that runs a compiled program."""

    def run() -> None:
        program = CompiledRun(
            evaluator,
            context,
            end=DURATION,
            accuracy=config.accuracy,
            max_step=config.max_step_size,
        )
        while program.time < DURATION and not program.failure:
            program.Advance(DURATION)

    return run


def CellsOf(system: Published) -> list[str]:
    """Returns what the tests hold a system to, the cells before the times."""
    compiled = f"no: {system.obstacle}" if system.obstacle else "yes"
    page = "no" if system.obstacle else "yes"
    return [system.name, system.stands_for, "yes", "yes", compiled, page]


def row(system: Published) -> str:
    """Returns the row of a system, of which everything is tried."""
    diagram, context = system.Make()
    assert DiagramDot(diagram).startswith("digraph")
    simulator = Simulator(diagram, context.Clone())
    simulator.get_mutable_context().SetAccuracy(1e-3)
    simulator.AdvanceTo(0.1)
    ratios = ["", ""]
    try:
        evaluator = Evaluator(diagram, context, as_machine_code=True)
    except UnsupportedSystem as error:
        assert system.obstacle
        assert system.obstacle in str(error)
    else:
        assert not system.obstacle
        with tempfile.TemporaryDirectory() as folder:
            WritePage(diagram, Path(folder) / "page.html", context=context)
        ratios = [time_ratio(evaluator, context, x) for x in (DEFAULT, SAME)]
    return f"| {' | '.join([*CellsOf(system), *ratios])} |"


def time_ratio(evaluator: Evaluator, context: Context, config: SimulatorConfig) -> str:
    """Returns how many times as long as a compiled run Drake's Simulator takes."""
    contenders = {
        "drake": runner_in_drake(evaluator.system, context, config),
        "compiled": compiled_runner(evaluator, context, config),
    }
    try:
        counts = {name: runs_of_a_measurement(run) for name, run in contenders.items()}
    except RuntimeError:
        return "-"
    repeated = {
        name: functools.partial(repeat, run, counts[name])
        for name, run in contenders.items()
    }
    taken = Alternate(repeated, REPEATS)
    drake, compiled = (taken[name].cpu / counts[name] for name in contenders)
    return OneDigit(drake / compiled)


def runs_of_a_measurement(run: Callable[[], None]) -> int:
    """Returns how many runs take SHORTEST; the first one is not counted."""
    run()  # What is loaded or compiled once a process is no part of a run.
    start = time.process_time()
    run()
    return math.ceil(SHORTEST / max(time.process_time() - start, 1e-6))


def repeat(run: Callable[[], None], count: int) -> None:
    """Runs several times."""
    for _ in range(count):
        run()


def WriteRows(rows: dict[str, str]) -> None:
    """Writes the rows of systems, by name, into the page; the others remain."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    first = lines.index(HEAD)
    before = {line.split(" | ")[0].strip("| "): line for line in lines[first + 2 :]}
    known = before | rows
    table = [known[system.name] for system in SYSTEMS if system.name in known]
    text = "\n".join([*lines[: first + 2], *table])
    PAGE.write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of systems; none: all")
    parser.add_argument("--write", action="store_true", help="into the page")
    arguments = parser.parse_args()
    found = {}
    for each in SYSTEMS:
        if not arguments.names or each.name in arguments.names:
            found[each.name] = row(each)
            print(found[each.name], flush=True)
    if arguments.write:
        WriteRows(found)
