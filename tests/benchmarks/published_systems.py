"""Copies of published systems: drawn, run, compiled, a page, and times.

`python tests/benchmarks/published_systems.py` prints a row for each system of
tests/foreign, or for those that are named. The last two columns say how many
times as much processor time as a compiled run of 10 s Drake's Simulator takes: with its
default settings, where the compiled run has the same accuracy, and with the same
settings in both. They are ratios of medians of runs that take turns, to one significant
digit. Compiling is not a part of it. A dash: Drake's run ends with an error.
"""

import functools
import math
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.measuring import Alternate, OneDigit
from foreign.test_foreign import SYSTEMS
from foreign.wiring import Published
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, System

from teleop_drake import WritePage
from teleop_drake.loops.draw.block_diagram import DiagramDot
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.run import CompiledRun

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


def row(system: Published) -> list[str]:
    """Returns the cells of a system."""
    diagram, context = system.Make()
    drawn = "yes" if DiagramDot(diagram) else "no"
    try:
        evaluator = Evaluator(diagram, context, as_machine_code=True)
    except UnsupportedSystem:
        simulator = Simulator(diagram, context)
        simulator.get_mutable_context().SetAccuracy(1e-3)
        simulator.AdvanceTo(0.1)
        return [system.name, drawn, "yes", "no", "no", "", ""]
    has_page = "yes" if is_page(diagram) else "no"
    ratios = [time_ratio(evaluator, context, config) for config in (DEFAULT, SAME)]
    return [system.name, drawn, "yes", "yes", has_page, *ratios]


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


def is_page(diagram: Diagram) -> bool:
    """Returns whether a diagram becomes a page."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            WritePage(diagram, Path(folder) / "page.html")
        except (ValueError, KeyError) as error:
            print(f"{diagram.get_name()}: {error}", file=sys.stderr)
            return False
    return True


if __name__ == "__main__":
    # Of all systems, or of those that are named.
    chosen = [x for x in SYSTEMS if not sys.argv[1:] or x.name in sys.argv[1:]]
    print("| copy of | drawn | run | compiled | page | default | same settings |")
    print("|---|---|---|---|---|---|---|")
    for each in chosen:
        print(f"| {' | '.join(row(each))} |", flush=True)
