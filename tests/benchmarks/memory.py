"""Does the memory of a long sweep grow? Resident memory over many runs."""

import os
import sys

from benchmarks.options import Options
from benchmarks.tables import Table

from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.sweep.workers import WorkerProcesses

OVERRIDES = {"duration": 0.2, "simulator.max_step_size": 0.05}


def ResidentMegabytes() -> float:
    """Returns the resident memory of this process in MB, which Linux tells."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def RunOnce(engine: str = "drake") -> tuple[int, float]:
    """Simulates a little; returns the process and its resident memory in MB."""
    simulate(LoadScenario("one_dof", OVERRIDES), engine=engine)
    return os.getpid(), ResidentMegabytes()


def Measure(options: Options) -> list[Table]:
    num_runs = 40 if options.quick else 1000
    table = Table(
        name="memory",
        title=f"Resident memory over {num_runs} runs",
        note="MB of the process that runs, after the run with that number (one_dof, "
        "0.2 s). A Sweep works in processes that are recycled every 100 runs; the "
        "first row is one process that is not.",
    )
    if not sys.platform.startswith("linux"):
        table.Add(variant="not measured: only Linux tells the resident memory")
        return [table]
    variants = {"one process, never recycled": (num_runs + 1, "drake")}
    if not options.quick:
        variants["as a Sweep, recycled"] = 100, "drake"
    else:
        variants["recycled every 10 runs"] = 10, "drake"
    variants["one process, compiled"] = num_runs + 1, "compiled"
    for variant, (calls, engine) in variants.items():
        with WorkerProcesses(1, calls_per_process=calls) as executor:
            samples = [
                executor.submit(RunOnce, engine).result() for _ in range(num_runs)
            ]
        memory = [megabytes for _, megabytes in samples]
        largest = {}
        for process, megabytes in samples:
            largest[process] = max(megabytes, largest.get(process, 0.0))
        marks = [max(1, num_runs * k // 10) for k in (0, 1, 2, 5, 10)]
        table.Add(
            variant=variant,
            processes=len({process for process, _ in samples}),
            **{f"run_{mark}": memory[mark - 1] for mark in marks},
            largest=max(memory),
            largest_of_first_process=largest[samples[0][0]],
            largest_of_last_process=largest[samples[-1][0]],
        )
    return [table]
