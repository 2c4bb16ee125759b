"""Published systems: drawn, run, compiled, a page, and times against Drake's Simulator.

`python tests/benchmarks/published_systems.py` prints a row for each system of
tests/foreign, or for those that are named. The last two columns say how many times as
long as a compiled run of 10 s Drake's Simulator takes: with its default settings, where
the compiled run has the same accuracy, and with the same settings in both. Compiling is
not a part of it. A dash: Drake's run ends with an error.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from foreign.test_foreign import SYSTEMS
from foreign.wiring import Published
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, System

from teleop_drake import WritePage
from teleop_drake.engine.evaluator import Evaluator
from teleop_drake.engine.flatten import UnsupportedSystem
from teleop_drake.engine.run import CompiledRun
from teleop_drake.figures.block_diagram import DiagramDot

DURATION = 10.0
DEFAULT = SimulatorConfig()
SAME = SimulatorConfig(
    integration_scheme="runge_kutta5", accuracy=1e-6, max_step_size=0.1
)


def best_time(run: Callable[[], object]) -> float:
    """Returns the shortest of three times in s."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def time_in_drake(diagram: System, context: Context, config: SimulatorConfig) -> float:
    """Returns how long Drake's Simulator takes, s."""

    def run() -> None:
        simulator = Simulator(diagram, context.Clone())
        # Where events are located.
        simulator.get_mutable_context().SetAccuracy(config.accuracy)
        ApplySimulatorConfig(config, simulator)
        simulator.AdvanceTo(context.get_time() + DURATION)

    return best_time(run)


def time_compiled(
    evaluator: Evaluator, context: Context, config: SimulatorConfig
) -> float:
    """Returns how long a run of a compiled program takes, s."""

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

    run()  # What is compiled once a process is no part of a run.
    return best_time(run)


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
    try:
        in_drake = time_in_drake(evaluator.system, context, config)
    except RuntimeError:
        return "-"
    return f"{in_drake / time_compiled(evaluator, context, config):.1f}"


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
