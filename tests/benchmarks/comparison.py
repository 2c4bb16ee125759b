"""One run, by everything that can do it, at equal error."""

from collections.abc import Iterator
from functools import partial

from benchmarks import accuracy
from benchmarks.contenders import CONTENDERS, PEER, Load
from benchmarks.measuring import Alternate, Options, Table

# Largest error, relative to the signal's range, by the task.
TARGETS = {"one_dof": 1e-5, "two_dof_combined": 1e-4}
CONTROLLER = "adaptive_backstepping"
DELAY = 0.1


def Measure(options: Options) -> Iterator[Table]:
    for task, target in TARGETS.items():
        duration = options.Duration(Load(task, CONTROLLER, DELAY))
        case = (task, CONTROLLER, DELAY, duration)
        oracle = accuracy.Oracle(*case)
        preparation = {}
        names = [name for name in CONTENDERS if name != PEER]
        if options.peers:
            from benchmarks import jitcdde_peer

            preparation[PEER] = jitcdde_peer.Prepare(*case)
            names.append(PEER)
        calls = {name: partial(CONTENDERS[name], *case) for name in names}
        measured = Alternate(calls, options.repeats)
        base = measured["straightforward"]
        base_cost = base.cpu / base.value.derivative_evaluations
        rows = []
        for name, measurement in measured.items():
            solution = measurement.value
            errors = accuracy.Errors(oracle, solution.time, solution.signals)
            evaluations = solution.derivative_evaluations
            cost = measurement.cpu / evaluations if evaluations else None
            rows.append(
                {
                    "contender": name,
                    "CPU s": measurement.cpu,
                    "ratio": measurement.cpu / base.cpu,
                    "steps": solution.steps,
                    "evaluations": evaluations,
                    "us per evaluation": cost and 1e6 * cost,
                    "ratio per evaluation": cost and cost / base_cost,
                    "real time factor": duration / measurement.cpu,
                    "largest error": max(errors.values()),
                    "velocity error": errors["tool_velocity"],
                    "velocity y error": errors.get("velocity_y"),
                    "compile s": preparation.get(name),
                }
            )
        yield Table(
            title=f"{task}, {CONTROLLER}, {DELAY:g} s each way, {duration:g} s",
            note=f"Target: every error at most {target:g}. CPU time of one process "
            "with everything from building the model to arrays of signals; medians "
            "of alternating runs. Errors are the largest deviations from the "
            "independent solver, relative to each signal's range, more than 1 ms "
            "away from a jump; the straightforward variant is 1 in the ratios. "
            "JiTCDDE's compiling is apart. With 1 kHz blocks the target is out of "
            "reach: their delays are sampled.",
            rows=rows,
        )
