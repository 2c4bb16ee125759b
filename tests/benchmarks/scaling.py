"""What a run costs, against the size of the problem."""

from benchmarks.options import Options
from benchmarks.tables import Table
from benchmarks.timing import Alternate

from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate

NOTE = "CPU time of `simulate`, medians of alternating runs; ratios to the first row."
DELAYS = (0.005, 0.02, 0.05, 0.1, 0.2, 0.4, 1.0)
PERIODS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02)
LATTICES = {
    "one_dof": ([5], [20], [100], [500]),
    "two_dof_combined": ([3, 2], [5, 5], [10, 10], [25, 20]),
}


def Measure(options: Options) -> list[Table]:
    few = slice(None, 2) if options.quick else slice(None)
    delays = {
        f"{delay:g} s": {
            "forward_channel.delay": delay,
            "return_channel.delay": delay,
            # Else the shortest delays would also be those with the shortest steps.
            "simulator.max_step_size": min(0.005, delay),
        }
        for delay in DELAYS[few]
    }
    periods = {
        f"{1e3 * period:g} ms": {
            f"{way}_channel.{key}": value
            for way in ("forward", "return")
            for key, value in (("kind", "sampled"), ("sample_period", period))
        }
        for period in PERIODS[few]
    }
    tables = [
        _Table(options, "delay", "one_dof", delays),
        _Table(options, "sample_period", "two_dof_combined", periods),
    ]
    for task, counts in LATTICES.items():
        lattices = {
            " x ".join(map(str, count)): {"controller.network.count": count}
            for count in counts[few]
        }
        tables.append(_Table(options, "lattice", task, lattices))
    tables.append(_Dimensions(options))
    return tables


def _Table(options: Options, what: str, task: str, variants: dict) -> Table:
    duration = 0.5 if options.quick else 5.0
    measured = Alternate(
        {
            name: lambda overrides=overrides: simulate(
                LoadScenario(task, {"duration": duration} | overrides), engine="drake"
            )
            for name, overrides in variants.items()
        },
        options.repeats,
    )
    table = Table(
        name=f"scaling_{what}_{task}",
        title=f"Cost against {what.replace('_', ' ')}: {task}, {duration:g} s",
        note=NOTE,
    )
    first = next(iter(measured.values()))
    for name, measurement in measured.items():
        solver = measurement.value.solver
        table.Add(
            **{what: name},
            CPU_s=measurement.cpu,
            ratio=measurement.cpu / first.cpu,
            steps=solver.steps,
            evaluations=solver.derivative_evaluations,
            us_per_evaluation=1e6 * measurement.cpu / solver.derivative_evaluations,
        )
    return table


def _Dimensions(options: Options) -> Table:
    """The same number of steps and of basis functions with one axis and with two."""
    duration = 0.5 if options.quick else 5.0
    shared = {"duration": duration, "simulator.max_step_size": 0.005}
    variants = {
        "one_dof": {"controller.network.count": [25]},
        "two_dof_combined": {"controller.network.count": [5, 5]},
    }
    measured = Alternate(
        {
            (task, controller): lambda task=task, controller=controller: simulate(
                LoadScenario(
                    task, shared | variants[task] | {"controller.kind": controller}
                ),
                engine="drake",
            )
            for task in variants
            for controller in ("direct_force", "adaptive_backstepping")
        },
        options.repeats,
    )
    table = Table(
        name="scaling_dimension",
        title=f"Cost against the task's dimension, {duration:g} s",
        note="CPU time, medians of alternating runs; the ratio per evaluation is to "
        "one axis with the same controller. The arm's dynamics are dearer too.",
    )
    costs = {
        key: measurement.cpu / measurement.value.solver.derivative_evaluations
        for key, measurement in measured.items()
    }
    for (task, controller), measurement in measured.items():
        table.Add(
            axes=1 if task == "one_dof" else 2,
            controller=controller,
            CPU_s=measurement.cpu,
            evaluations=measurement.value.solver.derivative_evaluations,
            us_per_evaluation=1e6 * costs[task, controller],
            ratio_per_evaluation=costs[task, controller] / costs["one_dof", controller],
        )
    return table
