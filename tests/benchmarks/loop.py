"""Times the four tasks with both controllers: `python tests/benchmarks/loop.py`.

Prints, for each run, the simulated time, the solver's steps and derivative
evaluations, the wall time (best of three), and what that is per evaluation.
"""

from teleop_drake.scenario import CONTROLLERS, LoadScenario, ScenarioNames
from teleop_drake.simulation import simulate


def main() -> None:
    print(f"{'run':<44}{'sim s':>7}{'steps':>7}{'evals':>8}{'wall s':>8}{'us/eval':>9}")
    for name in ScenarioNames():
        for kind in CONTROLLERS:
            scenario = LoadScenario(name)
            if scenario.controller.kind not in CONTROLLERS:
                continue
            scenario.controller.kind = kind
            runs = [simulate(scenario).solver for _ in range(3)]
            best = min(runs, key=lambda solver: solver.wall_time_s)
            evaluations = best.derivative_evaluations
            print(
                f"{name + ', ' + kind:<44}"
                f"{best.real_time_factor * best.wall_time_s:>7.2f}"
                f"{best.steps:>7}{evaluations:>8}{best.wall_time_s:>8.2f}"
                f"{1e6 * best.wall_time_s / evaluations:>9.1f}"
            )


if __name__ == "__main__":
    main()
