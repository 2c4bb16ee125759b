"""How large may the sample period be? `python tests/benchmarks/sample_period_study.py`

The thesis delays continuous signals; real haptics sends packets, commonly 1000 in a
second. Prints how far the metrics of a task are with a sampled channel each way from
what they are with an exact delay of 100 ms, in per cent, for a range of sample periods:
once with packets that take 100 ms, and once with packets that take half a period less.
A packet is held for one period, so the signal's mean delay is 100 ms plus half a period
in the first case and 100 ms in the second.
"""

import argparse

from teleop_drake.scenario import CONTROLLERS, LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.tasks.metrics import RunMetrics

DELAY = 0.1
PERIODS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
METRICS = {
    "start overshoot": ("start_velocity_overshoot",),
    "puncture overshoot": ("puncture", "velocity_overshoot"),
    "first impact": ("collision", "initial_impact_force"),
    "peak force": ("collision", "peak_force"),
    "rebound": ("collision", "rebound_velocity"),
    "rms velocity error": ("velocity_rms_error", 0),
}


def measure(task: str, controller: str, **channel: float | str) -> list[float | None]:
    overrides = {"controller.kind": controller}
    for way in ("forward", "return"):
        overrides |= {f"{way}_channel.{key}": value for key, value in channel.items()}
    metrics = RunMetrics(simulate(LoadScenario(task, overrides), engine="auto"))
    values = []
    for path in METRICS.values():
        value = None if metrics["diverged"] else metrics
        for key in path:
            value = None if value is None else value[key]
        values.append(value)
    return values


def measure_sampled(
    task: str, controller: str, delay: float, period: float
) -> list[float | None]:
    return measure(task, controller, kind="sampled", delay=delay, sample_period=period)


def changes(
    values: list[float | None], exact: list[float | None]
) -> list[float | None]:
    """Returns by how many per cent each metric differs, None where it has no value."""
    return [
        100 * (value / reference - 1) if value is not None and reference else None
        for value, reference in zip(values, exact, strict=True)
    ]


def largest(values: list[float | None]) -> str:
    """Returns the largest change, or that there is nothing to compare."""
    known = [abs(value) for value in values if value is not None]
    return f"{max(known):.2g}" if known else "diverges"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tasks", nargs="*", default=["one_dof", "two_dof_combined"])
    tasks = parser.parse_args().tasks
    summary: dict[float, list[str]] = {period: [] for period in PERIODS}
    for task in tasks:
        for controller in CONTROLLERS:
            exact = measure(task, controller, delay=DELAY)
            print(f"\n{task}, {controller}: change in % of")
            print("period ms | packets take ms | " + " | ".join(METRICS))
            print("|".join(["---"] * (2 + len(METRICS))))
            for period in PERIODS:
                worst = []
                for delay in (DELAY, DELAY - period / 2):
                    row = changes(
                        measure_sampled(task, controller, delay, period), exact
                    )
                    cells = [f"{1e3 * period:g}", f"{1e3 * delay:g}"]
                    cells += ["-" if x is None else f"{x:+.2f}" for x in row]
                    print(" | ".join(cells), flush=True)
                    worst.append(largest(row))
                summary[period].append("{} ({})".format(*worst))
    print("\nLargest change in %, (with the mean delay held):")
    heads = [f"{task}, {kind}" for task in tasks for kind in CONTROLLERS]
    print("| sample period | " + " | ".join(heads) + " |")
    print("|" + "---|" * (1 + len(heads)))
    for period, cells in summary.items():
        print(f"| {1e3 * period:g} ms | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
