"""The compiled engine: an evaluation, a run, a network, the first run, and sizes.

Errors stand beside the times, so that nobody is fast by being wrong.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial

import numpy as np
from benchmarks import straightforward
from benchmarks.comparison import CASES, DELAY
from benchmarks.contenders import Load
from benchmarks.evaluation import SETTINGS
from benchmarks.options import Options
from benchmarks.tables import Table
from benchmarks.timing import Alternate
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)

from teleop_drake.compiler.engine import CompiledRun
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.teleoperator import MakeTeleoperator

NETWORK = {
    f"{way}_channel.{key}": value
    for way in ("forward", "return")
    for key, value in (("kind", "network"), ("sample_period", 0.001))
}
LATTICES = ([3, 2], [5, 5], [10, 10], [25, 20])
JOINTS = (1, 2, 3, 6, 10)
DELAYS = (0.005, 0.02, 0.1, 0.4, 1.0)


def Measure(options: Options) -> Iterator[Table]:
    yield _Evaluation(options)
    yield _Network(options)
    yield _FirstRun(options)
    yield from _Sizes(options)


def Step(system, duration, accuracy, max_step_size) -> dict:
    """Steps a diagram as machine code.

    Returns:
        CPU time in s of stepping alone, evaluations, and CPU time of what comes before,
        which is compiling where nothing is kept.
    """
    begin = time.process_time()
    context = system.CreateDefaultContext()
    context.SetAccuracy(1e-4)
    system.ExecuteInitializationEvents(context)
    run = CompiledRun(
        system, context, end=duration, accuracy=accuracy, max_step=max_step_size
    )
    run.Advance(min(1e-6, duration))
    start = time.process_time()
    while run.time < duration and not run.failure:
        run.Advance(duration)
    return {
        "stepping": time.process_time() - start,
        "evaluations": run.num_evaluations,
        "before": start - begin,
    }


def _Evaluation(options: Options) -> Table:
    table = Table(
        name="machine_code_evaluation",
        title="One evaluation as machine code, at steps of "
        f"{1e3 * SETTINGS['max_step_size']:g} ms, {DELAY:g} s each way",
        note="CPU time by the number of evaluations; medians of alternating runs. "
        "`stepping` is the integrator with all evaluations, delays and records; "
        "`run` has everything, from the scenario to the recording.",
    )
    for (task, controller), title in CASES.items():
        duration = options.Duration(Load(task))
        scenario = Load(task, controller, DELAY, duration, **SETTINGS)
        measured = Alternate(
            {
                "straightforward": partial(
                    straightforward.simulate, scenario, **SETTINGS
                ),
                "run": lambda s=scenario: simulate(s, engine="compiled").solver,
                "stepping": lambda s=scenario: Step(
                    MakeTeleoperator(s), s.duration, **SETTINGS
                ),
            },
            options.repeats,
        )
        evaluations = measured["run"].value.derivative_evaluations
        base = measured["straightforward"]
        costs = {
            "straightforward": base.cpu / base.value.derivative_evaluations,
            "run": measured["run"].cpu / evaluations,
            "stepping": measured["stepping"].value["stepping"]
            / measured["stepping"].value["evaluations"],
        }
        for name, cost in costs.items():
            table.Add(
                case=title,
                contender=name,
                us_per_evaluation=1e6 * cost,
                ratio=cost / costs["straightforward"],
            )
    return table


def _Network(options: Options) -> Table:
    duration = 0.5 if options.quick else 8.0
    scenario = LoadScenario(
        "two_dof_combined",
        NETWORK | {"controller.kind": "adaptive_backstepping", "duration": duration},
    )
    measured = Alternate(
        {
            engine: lambda engine=engine: simulate(scenario, engine=engine)
            for engine in ("drake", "compiled")
        },
        options.repeats,
    )
    table = Table(
        name="machine_code_network",
        title="Case III over 1 kHz networks both ways, adaptive_backstepping, "
        f"{duration:g} s",
        note="CPU time of `simulate`, medians of alternating runs; `speed-up` is to "
        "Drake's Simulator. `difference` is the largest between the two recordings, "
        "linearly interpolated, as a share of the signal's range; away from jumps.",
    )
    drake = measured["drake"]
    for engine, measurement in measured.items():
        solver = measurement.value.solver
        table.Add(
            engine=engine,
            CPU_s=measurement.cpu,
            speed_up=drake.cpu / measurement.cpu,
            steps=solver.steps,
            evaluations=solver.derivative_evaluations,
            difference=_Difference(measurement.value, drake.value),
        )
    return table


def _Difference(a, b) -> float:
    """Returns how far two recordings are apart, as a share of a signal's range."""
    t = np.linspace(0.05, 0.99, 997) * b.time[-1]
    largest = 0.0
    for name in ("tool_position", "tool_velocity"):
        for i in range(a[name].shape[1]):
            x, y = (np.interp(t, r.time, r[name][:, i]) for r in (a, b))
            largest = max(largest, float(np.abs(x - y).max() / np.ptp(b[name])))
    return largest


def _FirstRun(options: Options) -> Table:
    """A fresh process each time: with nothing kept, with the code kept, in Drake."""
    task = "one_dof" if options.quick else "two_dof_combined"
    table = Table(
        name="machine_code_first_run",
        title=f"The first run of a process: {task}, adaptive_backstepping",
        note="CPU time of a fresh process, imports included; medians of alternating "
        "ones. Drake's run has the laws' machine code on disk.",
    )
    with tempfile.TemporaryDirectory() as folder:
        measured = Alternate(
            {
                "Drake's Simulator": partial(_Spawn, task, "drake", None),
                "compiled, nothing kept": partial(_Spawn, task, "compiled", ""),
                "compiled, code kept": partial(_Spawn, task, "compiled", folder),
            },
            options.repeats,
        )
    base = measured["Drake's Simulator"].cpu
    for name, measurement in measured.items():
        table.Add(run=name, CPU_s=measurement.cpu, ratio=measurement.cpu / base)
    return table


def _Spawn(task: str, engine: str, cache: str | None) -> None:
    """Runs a program with the user's caches (None), with a folder's, or with none."""
    program = (
        "from teleop_drake.scenario import LoadScenario as L\n"
        "from teleop_drake.simulation import simulate as s\n"
        f"s(L({task!r}, {{'controller.kind': 'adaptive_backstepping'}}), "
        f"engine={engine!r})"
    )
    with tempfile.TemporaryDirectory() as empty:
        environment = dict(os.environ)
        if cache is not None:
            names = "XDG_CACHE_HOME", "LOCALAPPDATA"
            environment |= dict.fromkeys(names, cache or empty)
        subprocess.run([sys.executable, "-c", program], check=True, env=environment)


def _Sizes(options: Options) -> Iterator[Table]:
    few = slice(None, 2) if options.quick else slice(None)
    duration = 0.5 if options.quick else 5.0
    settings = {"accuracy": 1e-6, "max_step_size": 0.005}
    adaptive = {"controller.kind": "adaptive_backstepping", "duration": duration}

    def Teleoperator(overrides: dict):
        return MakeTeleoperator(LoadScenario("two_dof_combined", adaptive | overrides))

    groups = {
        "delay": {
            f"{delay:g} s": partial(
                Teleoperator,
                {f"{way}_channel.delay": delay for way in ("forward", "return")},
            )
            for delay in DELAYS[few]
        },
        "lattice": {
            " x ".join(map(str, count)): partial(
                Teleoperator, {"controller.network.count": count}
            )
            for count in LATTICES[few]
        },
        "joints": {str(n): partial(MakeChain, n) for n in JOINTS[few]},
    }
    for what, systems in groups.items():
        table = Table(
            name=f"machine_code_{what}",
            title=f"Machine code against {what}, {duration:g} s at steps of 5 ms",
            note="CPU time of stepping alone, medians of alternating runs, and of what "
            "comes before the first of them: compiling, where the code is not kept. "
            + (
                "A chain that swings freely."
                if what == "joints"
                else "two_dof_combined, adaptive_backstepping."
            ),
        )
        first = {name: Step(make(), 1e-3, **settings) for name, make in systems.items()}
        measured = Alternate(
            {
                name: lambda make=make: Step(make(), duration, **settings)
                for name, make in systems.items()
            },
            options.repeats,
        )
        for name, measurement in measured.items():
            stepping = measurement.value["stepping"]
            evaluations = measurement.value["evaluations"]
            table.Add(
                **{what: name},
                stepping_s=stepping,
                evaluations=evaluations,
                us_per_evaluation=1e6 * stepping / evaluations,
                compile_s=first[name]["before"],
            )
        yield table


def MakeChain(num_joints: int) -> MultibodyPlant:
    """Returns a chain of links that swings about axes across each other."""
    plant = MultibodyPlant(0.0)
    parent = plant.world_body()
    inertia = SpatialInertia(1.0, [0.02, 0.0, -0.1], UnitInertia(0.03, 0.03, 0.02))
    for i in range(num_joints):
        body = plant.AddRigidBody(f"link_{i}", inertia)
        offset = RigidTransform([0.0, 0.0, -0.2 if i else 0.0])
        frame = FixedOffsetFrame(f"end_{i}", parent.body_frame(), offset)
        axis = np.eye(3)[i % 2]
        joint = RevoluteJoint(
            f"joint_{i}", plant.AddFrame(frame), body.body_frame(), axis, 0.1
        )
        plant.AddJoint(joint).set_default_angle(0.3)
        parent = body
    plant.Finalize()
    return plant
