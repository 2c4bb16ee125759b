"""What bouncing costs: direct force, never at rest on the bone, against adaptive."""

from functools import partial

from benchmarks import accuracy
from benchmarks.contenders import Load, Package, PackageAtTarget, Straightforward
from benchmarks.options import Options
from benchmarks.tables import Table
from benchmarks.timing import Alternate

DELAY = 0.1


def Measure(options: Options) -> list[Table]:
    table = Table(
        name="bounces",
        title="Many bounces: direct force against the adaptive controller",
        note="CPU time, medians of alternating runs; the ratio is to the adaptive run "
        "of the same contender.",
    )
    for task in ("two_dof_collision", "two_dof_combined"):
        duration = 2.0 if options.quick else Load(task).duration
        calls = {
            (name, controller): partial(run, task, controller, DELAY, duration)
            for name, run in (
                ("package, its own settings", Package),
                ("package, loosest within target", PackageAtTarget),
                ("straightforward", Straightforward),
            )
            for controller in ("adaptive_backstepping", "direct_force")
        }
        measured = Alternate(calls, options.repeats)
        for (name, controller), measurement in measured.items():
            oracle = accuracy.Oracle(task, controller, DELAY, duration)
            solution = measurement.value
            table.Add(
                task=task,
                contender=name,
                controller=controller,
                contacts=sum(event.kind == "contact" for event in oracle.events),
                CPU_s=measurement.cpu,
                ratio=measurement.cpu / measured[name, "adaptive_backstepping"].cpu,
                steps=solution.steps,
                evaluations=solution.derivative_evaluations,
                largest_error=accuracy.LargestError(oracle, solution),
            )
    return [table]
