"""Fifty delays: python -m benchmarks.delays CONTENDER TASK DURATION "[DELAY, ...]"."""

import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks.tables import Table
from benchmarks.timing import Alternate, Options

CONTROLLER = "adaptive_backstepping"
DELAYS = np.linspace(0.02, 0.4, 50)
JOBS = 2
PACKAGE = ("package, Sweep", "package, from the shell with figures")


def Measure(options: Options) -> Iterator[Table]:
    from benchmarks import accuracy, contenders

    for task in ("one_dof",) if options.quick else ("one_dof", "two_dof_combined"):
        delays = (DELAYS[::25] if options.quick else DELAYS).tolist()
        duration = options.Duration(contenders.Load(task))
        names = [*PACKAGE, "straightforward", "scipy, method of steps"]
        if options.peers:
            names.append(contenders.PEER)
        measured = Alternate(
            {name: partial(_Spawn, name, task, duration, delays) for name in names},
            1,
        )
        table = Table(
            name=f"delays_{task}",
            title=f"{len(delays)} delays, {task}, {CONTROLLER}, {duration:g} s, "
            f"{JOBS} processes",
            note="CPU time of a fresh program and its processes, with start-up and "
            "compiling; the straightforward variant is 1. Wall time depends on what "
            "else the machine does. The error is the largest deviation from the "
            "independent solver, relative to the signal's range, at the shortest, the "
            "middle and the longest delay.",
        )
        base = measured["straightforward"]
        for name, measurement in measured.items():
            simulate = contenders.Find("package, compiled" if name in PACKAGE else name)
            cases = [
                (task, CONTROLLER, delay, duration)
                for delay in delays[:: max(1, (len(delays) - 1) // 2)]
            ]
            table.Add(
                contender=name,
                CPU_s=measurement.cpu,
                ratio=measurement.cpu / base.cpu,
                wall_s=measurement.wall,
                largest_error=max(
                    accuracy.LargestError(accuracy.Oracle(*case), simulate(*case))
                    for case in cases
                ),
            )
        yield table


def _Spawn(*arguments) -> None:
    """Runs this file as a program; waits for every process that it starts."""
    paths = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    texts = [x if isinstance(x, str) else json.dumps(x) for x in arguments]
    subprocess.run(
        [sys.executable, "-m", "benchmarks.all_processes", "benchmarks.delays", *texts],
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
    )


def _PeakForce(name: str, task: str, delay: float, duration: float) -> float:
    """Returns the largest control force that a contender sampled, in N."""
    from benchmarks import contenders

    solution = contenders.Find(name)(task, CONTROLLER, delay, duration)
    return float(abs(solution.signals["control_force"][:, 0]).max())


def main() -> None:
    name, task, *rest = sys.argv[1:]
    duration, delays = map(json.loads, rest)
    if name == PACKAGE[0]:
        from teleop_drake.sweep import Sweep

        overrides = {"controller.kind": CONTROLLER, "duration": duration}
        Sweep(task, {"delay": delays}, overrides=overrides)
        return
    if name == PACKAGE[1]:
        from teleop_drake.cli import main as command

        options = ["--controllers", CONTROLLER, "--duration", str(duration)]
        values = ",".join(map(str, delays))
        with tempfile.TemporaryDirectory() as out:
            command(["sweep", task, "--delay", values, *options, "--out", out])
        return
    initializer, arguments = None, ()
    if name.startswith("JiTCDDE"):
        from benchmarks import jitcdde_peer

        file = jitcdde_peer.Compiled(task, CONTROLLER)
        initializer, arguments = jitcdde_peer.Adopt, (task, CONTROLLER, file)
    context = multiprocessing.get_context("spawn")
    with context.Pool(JOBS, initializer, arguments) as pool:
        cases = [(name, task, delay, duration) for delay in delays]
        pool.starmap(_PeakForce, cases, chunksize=1)


if __name__ == "__main__":
    main()
