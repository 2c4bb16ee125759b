"""How a Sweep uses more processes."""

from benchmarks.options import Options
from benchmarks.tables import Table
from benchmarks.timing import Alternate

from teleop_drake.scenario import CONTROLLERS
from teleop_drake.sweep import Sweep

WORKERS = (1, 2)


def Measure(options: Options) -> list[Table]:
    num_delays = 2 if options.quick else 20
    grid = {
        "controller": CONTROLLERS,
        "delay": [0.02 + 0.01 * i for i in range(num_delays)],
    }
    overrides = {"duration": 0.5 if options.quick else 5.0}
    num_runs = len(CONTROLLERS) * num_delays
    calls = {
        jobs: lambda jobs=jobs: Sweep("one_dof", grid, overrides=overrides, jobs=jobs)
        for jobs in WORKERS
    }
    measured = Alternate(calls, options.repeats)
    table = Table(
        name="throughput",
        title=f"Throughput of a Sweep: {num_runs} runs of one_dof, "
        f"{overrides['duration']:g} s",
        note="Wall time, the start of the processes included. Other work on the "
        "machine limits the speed-up.",
    )
    for jobs, measurement in measured.items():
        table.Add(
            workers=jobs,
            wall_s=measurement.wall,
            runs_per_s=num_runs / measurement.wall,
            speed_up=measured[1].wall / measurement.wall,
        )
    return [table]
