"""Every task with every controller over every kind of channel."""

from benchmarks import accuracy
from benchmarks.channel_oracle import ChannelOracle
from benchmarks.contenders import Load
from benchmarks.options import Options
from benchmarks.tables import Table
from benchmarks.timing import Alternate

from teleop_drake.scenario import CONTROLLERS, LoadScenario
from teleop_drake.simulation import simulate

TASKS = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")
PERIOD = 0.01

# Both ways; the delay is the thesis's 0.1 s.
FIELDS: dict[str, dict] = {
    "transport": {},
    "variable": {"sinusoid": {"amplitude": 0.03, "frequency": 2.0, "phase": 0.0}},
    "sampled": {"sample_period": PERIOD},
    "network": {
        "sample_period": PERIOD,
        "jitter": {"kind": "gamma", "std": 0.02, "minimum": 0.05},
        "loss": {"kind": "independent", "probability": 0.05},
        "seed": 1,
    },
}


def MakeScenario(task: str, controller: str, kind: str, duration: float):
    overrides: dict = {"controller.kind": controller, "duration": duration}
    for way in ("forward_channel", "return_channel"):
        overrides[f"{way}.kind"] = kind
        overrides |= {f"{way}.{key}": value for key, value in FIELDS[kind].items()}
    return LoadScenario(task, overrides)


def Measure(options: Options) -> list[Table]:
    table = Table(
        name="tasks",
        title="Tasks, controllers and channels, with the package's own settings",
        note=f"CPU time, medians of alternating runs. Packets every {PERIOD:g} s; "
        "variable: 0.1 s + 0.03 s sin(2 t); network: gamma jitter of 20 ms and 5 % "
        "loss. Errors are the largest deviations from the independent solver, relative "
        "to the signal's range. Over packets a direct control force is a received "
        "value, and not compared.",
    )
    tasks = TASKS[::3] if options.quick else TASKS
    for task in tasks:
        duration = options.Duration(Load(task))
        cases = {
            (controller, kind): MakeScenario(task, controller, kind, duration)
            for controller in CONTROLLERS
            for kind in FIELDS
        }
        measured = Alternate(
            {
                case: lambda scenario=scenario: simulate(scenario, engine="drake")
                for case, scenario in cases.items()
            },
            options.repeats,
        )
        for (controller, kind), measurement in measured.items():
            recording = measurement.value
            names = set(accuracy.SIGNALS)
            if kind == "transport":
                oracle = accuracy.Oracle(task, controller, 0.1, duration)
            else:
                oracle = ChannelOracle(cases[controller, kind])
                if controller == "direct_force":
                    names -= {"control_force"}
            errors = accuracy.Errors(
                oracle, recording.time, {name: recording[name] for name in names}
            )
            solver = recording.solver
            table.Add(
                task=task,
                controller=controller,
                channel=kind,
                simulated_s=float(recording.time[-1]),
                steps=solver.steps,
                evaluations=solver.derivative_evaluations,
                CPU_s=measurement.cpu,
                us_per_evaluation=1e6 * measurement.cpu / solver.derivative_evaluations,
                real_time_factor=float(recording.time[-1]) / measurement.cpu,
                largest_error=max(errors.values()),
                velocity_error=errors["tool_velocity"],
                velocity_y_error=errors.get("velocity_y"),
            )
    return [table]
