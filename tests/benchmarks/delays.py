"""Fifty delays on all processors, start-up included: what a study of delay costs.

Every contender is a program of its own, timed from outside: imports, processes, and
what compiling there is, count.
"""

import functools
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks import accuracy, contenders, delay_program
from benchmarks.delay_program import CONTROLLER, JOBS
from benchmarks.options import Options
from benchmarks.peers import Peers
from benchmarks.tables import Table
from benchmarks.timing import Alternate

from teleop_drake.simulation import simulate

DELAYS = np.linspace(0.02, 0.4, 50)

# Looser than contenders.PACKAGE_SETTINGS, which are for one delay: long delays magnify
# errors. The longest step stays below the delay.
SWEEP_SETTINGS: dict[str, dict[str, float]] = {
    "one_dof": {"accuracy": 1e-9, "max_step_size": 0.08},
    "two_dof_combined": {"accuracy": 1e-6, "max_step_size": 0.05},
}


def Delays(options: Options) -> list[float]:
    return (DELAYS[::25] if options.quick else DELAYS).tolist()


def Measure(options: Options) -> Iterator[Table]:
    for task in ("one_dof",) if options.quick else ("one_dof", "two_dof_combined"):
        delays = Delays(options)
        scenario = contenders.Load(task)
        duration = options.Duration(scenario)
        programs: dict[str, list] = {
            "package Sweep, its own settings": ["sweep", {}],
            "package Sweep, looser": ["sweep", SWEEP_SETTINGS[task]],
            "straightforward": ["pool", "straightforward"],
            "scipy, method of steps": ["pool", "scipy, method of steps"],
            "scipy, within target": ["pool", "scipy, within target"],
        }
        for peer in Peers(options):
            if peer.sweeps:
                programs[peer.name] = ["pool", peer.name]
        sampled = "1 kHz DiscreteTimeDelay"
        programs[sampled] = ["pool", sampled]
        measured = Alternate(
            {
                name: partial(_Spawn, [*program, task, delays, duration])
                for name, program in programs.items()
            },
            1,
        )
        base = measured["straightforward"]
        table = Table(
            name=f"delays_{task}",
            title=f"{len(delays)} delays, {task}, {CONTROLLER}, {duration:g} s, "
            f"{JOBS} processes",
            note="CPU time of a fresh program and its processes, with start-up and "
            "compiling; the straightforward variant is 1. Wall time depends on what "
            "else the machine does. The error is the largest deviation "
            "from the independent solver, relative to the signal's range, at the "
            "shortest, the middle and the longest delay, and of the package and of "
            "scipy at every delay. That the sampled delays are whole milliseconds is "
            "part of it.",
        )
        for name, measurement in measured.items():
            kind, what = programs[name]
            some = delays[:: max(1, (len(delays) - 1) // 2)]
            is_fast = kind == "sweep" or what.startswith("scipy")
            if kind == "sweep":
                errors = _SweepErrors(task, delays, duration, what)
            else:
                errors = {
                    delay: _Error(what, task, duration, delay)
                    for delay in (delays if is_fast else some)
                }
            table.Add(
                contender=name,
                CPU_s=measurement.cpu,
                ratio=measurement.cpu / base.cpu,
                CPU_s_per_run=measurement.cpu / len(delays),
                wall_s=measurement.wall,
                largest_error=max(errors[delay] for delay in some),
                at_every_delay=max(errors.values()) if is_fast else None,
            )
        yield table


@functools.cache
def _Oracle(task: str, delay: float, duration: float):
    return accuracy.Oracle(task, CONTROLLER, delay, duration)


def _Error(name: str, task: str, duration: float, delay: float) -> float:
    """Returns the error of one run of a contender, measured outside of its time."""
    solution = contenders.Find(name)(task, CONTROLLER, delay, duration)
    return accuracy.LargestError(_Oracle(task, delay, duration), solution)


def _SweepErrors(
    task: str, delays: list[float], duration: float, settings: dict
) -> dict[float, float]:
    """Returns the error of each run of a sweep, measured outside of its time."""
    errors = {}
    for delay in delays:
        settings_here = delay_program.AtDelay(settings, delay)
        recording = simulate(
            contenders.Load(task, CONTROLLER, delay, duration, **settings_here),
            engine="drake",
        )
        solution = contenders.FromRecording(recording)
        errors[delay] = accuracy.LargestError(_Oracle(task, delay, duration), solution)
    return errors


def _Spawn(program: list) -> list[float]:
    """Runs a program of benchmarks.delay_program; returns its peak forces in N."""
    paths = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        [
            *(sys.executable, "-m", "benchmarks.all_processes"),
            *("benchmarks.delay_program", json.dumps(program)),
        ],
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        stdout=subprocess.PIPE,
        text=True,
    )
    return json.loads(done.stdout.splitlines()[-1])
