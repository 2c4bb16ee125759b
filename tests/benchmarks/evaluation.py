"""What one evaluation of the derivatives costs, at the same short steps.

At its own settings a contender that needs few steps spreads its start over few
evaluations. Here all of them are made to take the same steps, and almost all of the
time is spent stepping.
"""

from functools import partial

from benchmarks import straightforward
from benchmarks.comparison import CASES, DELAY
from benchmarks.contenders import FromRecording, Load
from benchmarks.options import Options
from benchmarks.tables import Table
from benchmarks.timing import Alternate

from teleop_drake.simulation import simulate

SETTINGS = {"accuracy": 1e-4, "max_step_size": 0.005}


def Measure(options: Options) -> list[Table]:
    table = Table(
        name="evaluation",
        title="One evaluation at steps of "
        f"{1e3 * SETTINGS['max_step_size']:g} ms, {DELAY:g} s each way",
        note="CPU time by the number of evaluations, everything between them included; "
        "medians of alternating runs. Error control has nothing to do at these steps.",
    )
    for (task, controller), title in CASES.items():
        duration = options.Duration(Load(task))
        scenario = Load(task, controller, DELAY, duration, **SETTINGS)
        measured = Alternate(
            {
                "package": lambda s=scenario: FromRecording(
                    simulate(s, engine="drake")
                ),
                "straightforward": partial(
                    straightforward.simulate, scenario, **SETTINGS
                ),
            },
            options.repeats,
        )
        cost = {
            name: measurement.cpu / measurement.value.derivative_evaluations
            for name, measurement in measured.items()
        }
        for name, measurement in measured.items():
            table.Add(
                case=title,
                contender=name,
                steps=measurement.value.steps,
                evaluations=measurement.value.derivative_evaluations,
                us_per_evaluation=1e6 * cost[name],
                ratio=cost[name] / cost["straightforward"],
            )
    return [table]
