"""Work and precision: what an error costs, over accuracies and maximum steps."""

from collections.abc import Iterator
from functools import partial

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from benchmarks import accuracy, straightforward
from benchmarks.contenders import (
    TARGETS,
    FromRecording,
    Load,
    Sampled,
    Scipy,
)
from benchmarks.options import Options
from benchmarks.tables import Format, Table
from benchmarks.timing import Alternate

from teleop_drake.simulation import simulate

DELAY = 0.1
CASES = (
    ("one_dof", "adaptive_backstepping"),
    ("two_dof_combined", "adaptive_backstepping"),
    ("two_dof_combined", "direct_force"),
)
ACCURACIES = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
STEPS = (0.01, 0.03, 0.1)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
# Okabe and Ito's colours, which the colour-blind tell apart, and a marker each.
STYLES = {
    "package": ("#0072B2", "o"),
    "package, its own settings": ("#000000", "*"),
    "straightforward": ("#D55E00", "s"),
    "scipy, method of steps": ("#009E73", "^"),
    "1 kHz DiscreteTimeDelay": ("#CC79A7", "D"),
}


def Measure(options: Options) -> Iterator[Table]:
    accuracies = ACCURACIES[:2] if options.quick else ACCURACIES
    tolerances = TOLERANCES[:2] if options.quick else TOLERANCES
    steps = STEPS[-1:] if options.quick else STEPS
    cases = CASES[:1] if options.quick else CASES
    for task, controller in cases:
        duration = options.Duration(Load(task))
        target = TARGETS[Load(task).num_axes]
        arguments = (task, controller, DELAY, duration)
        calls = _Calls(arguments, accuracies, steps, tolerances)
        measured = Alternate(calls, 1)
        oracle = accuracy.Oracle(*arguments)
        table = Table(
            name=f"precision_{task}_{controller}",
            title=f"Work and precision: {task}, {controller}, {duration:g} s",
            note=f"CPU time, one run each. Target: {target:g}; `cheapest` marks each "
            "contender's cheapest setting within it.",
        )
        cheapest: dict[str, float] = {}
        rows = []
        for (contender, setting), measurement in measured.items():
            solution = measurement.value
            error = accuracy.LargestError(oracle, solution)
            rows.append((contender, setting, measurement.cpu, solution, error))
            if error <= target:
                cost = min(measurement.cpu, cheapest.get(contender, measurement.cpu))
                cheapest[contender] = cost
        for contender, setting, cpu, solution, error in rows:
            table.Add(
                contender=contender,
                setting=setting,
                CPU_s=cpu,
                steps=solution.steps,
                evaluations=solution.derivative_evaluations,
                largest_error=error,
                cheapest="yes" if cheapest.get(contender) == cpu else "",
            )
        yield table
        if options.out is not None:
            _Plot(rows, target, table.title, options.out / f"{table.name}.png")


def _Calls(arguments, accuracies, steps, tolerances) -> dict:
    """Returns what to run by contender and setting."""

    def Package(**setting):
        return FromRecording(simulate(Load(*arguments, **setting), engine="drake"))

    def Straightforward(**setting):
        return straightforward.simulate(Load(*arguments), **setting)

    calls = {("package, its own settings", ""): Package}
    for step in steps:
        for tolerance in accuracies:
            setting = {"accuracy": tolerance, "max_step_size": step}
            text = f"accuracy {tolerance:g}, max step {step:g} s"
            calls["package", text] = partial(Package, **setting)
            calls["straightforward", text] = partial(Straightforward, **setting)
    for tolerance in tolerances:
        name = "scipy, method of steps", f"rtol {tolerance:g}"
        calls[name] = partial(Scipy, *arguments, tolerance)
    calls["1 kHz DiscreteTimeDelay", "Drake's"] = partial(Sampled, *arguments)
    return calls


def _Plot(rows, target, title, path) -> None:
    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    for contender, (colour, marker) in STYLES.items():
        points = [(error, cpu) for name, _, cpu, _, error in rows if name == contender]
        axes.loglog(
            *zip(*points, strict=True),
            linestyle="none",
            marker=marker,
            markersize=11 if marker == "*" else 6,
            color=colour,
            label=contender,
        )
    axes.axvline(target, color="0.5", linestyle="--", label=f"target {Format(target)}")
    axes.set_xlabel("largest error, relative to the signal's range")
    axes.set_ylabel("CPU time in s")
    axes.set_title(title, fontsize="medium")
    axes.grid(which="both", color="0.9")
    axes.legend(fontsize="small")
    figure.savefig(path, dpi=130)
    plt.close(figure)
