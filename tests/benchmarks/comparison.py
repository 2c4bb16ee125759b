"""One run, by everything that can do it, at equal error."""

from collections.abc import Iterator
from functools import partial

from benchmarks import accuracy
from benchmarks.contenders import CONTENDERS, PEER, TARGETS, Find, Load
from benchmarks.tables import Table
from benchmarks.timing import Alternate, Options

CASES = {
    ("one_dof", "adaptive_backstepping"): "1-DOF",
    ("two_dof_combined", "adaptive_backstepping"): "2-DOF, case III",
}
DELAY = 0.1


def Measure(options: Options) -> Iterator[Table]:
    for (task, controller), title in CASES.items():
        scenario = Load(task, controller, DELAY)
        target = TARGETS[scenario.num_axes]
        duration = options.Duration(scenario)
        oracle = accuracy.Oracle(task, controller, DELAY, duration)
        table = Table(
            name=f"comparison_{task}",
            title=f"{title}: {task}, {controller}, {DELAY:g} s each way, "
            f"{duration:g} s",
            note=f"Target: every error at most {target:g}. CPU time of one process "
            "with everything from building the model to arrays of signals; medians "
            "of alternating runs. Errors are the largest deviations from the "
            "independent solver, relative to each signal's range, more than 1 ms "
            "away from a jump; the straightforward variant is 1 in the ratios. "
            "JiTCDDE's compiling is apart. With 1 kHz blocks the target is out of "
            "reach: their delays are sampled.",
        )
        arguments = (task, controller, DELAY, duration)
        calls, preparation = {}, {}
        for name, contender in CONTENDERS.items():
            calls[name] = partial(contender, *arguments)
        if options.peers:
            from benchmarks import jitcdde_peer

            preparation[PEER] = jitcdde_peer.Prepare(*arguments)
            calls[PEER] = partial(Find(PEER), *arguments)
        measured = Alternate(calls, options.repeats)
        base = measured["straightforward"]
        base_cost = base.cpu / base.value.derivative_evaluations
        for name, measurement in measured.items():
            solution = measurement.value
            errors = accuracy.Errors(oracle, solution.time, solution.signals)
            evaluations = solution.derivative_evaluations
            cost = measurement.cpu / evaluations if evaluations else None
            table.Add(
                contender=name,
                CPU_s=measurement.cpu,
                ratio=measurement.cpu / base.cpu,
                steps=solution.steps,
                evaluations=evaluations,
                us_per_evaluation=cost and 1e6 * cost,
                ratio_per_evaluation=cost and cost / base_cost,
                real_time_factor=duration / measurement.cpu,
                largest_error=max(errors.values()),
                velocity_error=errors["tool_velocity"],
                velocity_y_error=errors.get("velocity_y"),
                compile_s=preparation.get(name),
            )
        yield table
