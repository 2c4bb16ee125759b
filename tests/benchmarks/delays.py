"""Fifty delays: python -m benchmarks.delays CONTENDER TASK DURATION "[DELAY, ...]"."""

import contextlib
import ctypes
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks.measuring import Alternate, Options, Table

CONTROLLER = "adaptive_backstepping"
DELAYS = np.linspace(0.02, 0.4, 50)
JOBS = 2
PACKAGE = ("package, Sweep", "package, from the shell with figures")
_PR_SET_CHILD_SUBREAPER = 36


def Measure(options: Options) -> Iterator[Table]:
    from benchmarks import accuracy
    from benchmarks.contenders import CONTENDERS, PEER, Load

    for task in ("one_dof",) if options.quick else ("one_dof", "two_dof_combined"):
        delays = (DELAYS[::25] if options.quick else DELAYS).tolist()
        duration = options.Duration(Load(task, CONTROLLER, 0.1))
        names = [*PACKAGE, "straightforward", "scipy, method of steps"]
        if options.peers:
            names.append(PEER)
        calls = {name: partial(_Spawn, name, task, duration, delays) for name in names}
        measured = Alternate(calls, 1)
        cases = [
            (task, CONTROLLER, delay, duration)
            for delay in delays[:: max(1, (len(delays) - 1) // 2)]
        ]
        rows = []
        for name, measurement in measured.items():
            simulate = CONTENDERS["package, compiled" if name in PACKAGE else name]
            errors = [
                accuracy.LargestError(accuracy.Oracle(*case), simulate(*case))
                for case in cases
            ]
            rows.append(
                {
                    "contender": name,
                    "CPU s": measurement.cpu,
                    "ratio": measurement.cpu / measured["straightforward"].cpu,
                    "wall s": measurement.wall,
                    "largest error": max(errors),
                }
            )
        yield Table(
            title=f"{len(delays)} delays, {task}, {CONTROLLER}, {duration:g} s, "
            f"{JOBS} processes",
            note="CPU time of a fresh program and its processes, with start-up and "
            "compiling; the straightforward variant is 1. Wall time depends on what "
            "else the machine does. The error is the largest deviation from the "
            "independent solver, relative to the signal's range, at the shortest, the "
            "middle and the longest delay.",
            rows=rows,
        )


def _Spawn(*arguments) -> None:
    """Runs this file as a program; waits for every process that it starts."""
    paths = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    texts = [x if isinstance(x, str) else json.dumps(x) for x in arguments]
    program = [sys.executable, "-m", "benchmarks.delays"]
    subprocess.run(
        [*program, "--wait", *program, *texts],
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
    )


def _Wait(*command: str) -> int:
    """Runs a program and waits for what it leaves behind: its CPU time counts."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    done = subprocess.run(command, check=False)
    with contextlib.suppress(ChildProcessError):
        while True:
            os.wait()
    return done.returncode


def _PeakForce(name: str, task: str, delay: float, duration: float) -> float:
    """Returns the largest control force that a contender sampled, in N."""
    from benchmarks.contenders import CONTENDERS

    solution = CONTENDERS[name](task, CONTROLLER, delay, duration)
    return float(abs(solution.signals["control_force"][:, 0]).max())


def main(name: str, task: str, *rest: str) -> None:
    duration, delays = map(json.loads, rest)
    if name == PACKAGE[0]:
        from teleop_drake.study.sweep import Sweep

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
    initializer = None
    arguments = ()
    if name.startswith("JiTCDDE"):
        from benchmarks import jitcdde_peer

        file = jitcdde_peer.Compiled(task, CONTROLLER)
        initializer = jitcdde_peer.Adopt
        arguments = (task, CONTROLLER, file)
    context = multiprocessing.get_context("spawn")
    # multiprocessing.Pool waits for ever if one of its processes dies.
    with ProcessPoolExecutor(JOBS, context, initializer, arguments) as executor:
        peak_force = partial(_PeakForce, name, task, duration=duration)
        list(executor.map(peak_force, delays))


if __name__ == "__main__":
    if sys.argv[1] == "--wait":
        sys.exit(_Wait(*sys.argv[2:]))
    main(*sys.argv[1:])
