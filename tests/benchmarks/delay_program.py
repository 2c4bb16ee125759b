"""The programs that benchmarks.delays times: one study of many delays each.

    python -m benchmarks.delay_program '[kind, what, task, [delay, ...], duration]'

A kind is `pool`, where `what` is the name of a contender, or `sweep`, where it is the
settings of the solver.

Each imports only what it needs, because start-up counts.
"""

import itertools
import json
import multiprocessing
import sys

CONTROLLER = "adaptive_backstepping"
JOBS = 2


def AtDelay(settings: dict, delay: float) -> dict:
    """Returns settings of the solver without a longest step that exceeds the delay.

    Then the scenario's holds, which follows the delay.
    """
    if delay >= settings.get("max_step_size", 0.0):
        return settings
    return {key: value for key, value in settings.items() if key != "max_step_size"}


def Groups(settings: dict, delays: list[float]) -> list[tuple[dict, list[float]]]:
    """Returns the delays in groups with the same settings, which AtDelay() makes."""
    groups = itertools.groupby(delays, lambda x: len(AtDelay(settings, x)))
    lists = [list(group) for _, group in groups]
    return [(AtDelay(settings, values[0]), values) for values in lists]


def RunSweeps(task: str, delays: list[float], duration: float, settings: dict):
    """Runs the package's sweep; returns the peak control force of each run in N."""
    from teleop_drake.sweep import Sweep
    from teleop_drake.sweep.workers import WorkerProcesses

    base = {"controller.kind": CONTROLLER, "duration": duration}
    peaks = []
    with WorkerProcesses(JOBS) as executor:
        for settings_here, values in Groups(settings, delays):
            overrides = base | {
                f"simulator.{key}": value for key, value in settings_here.items()
            }
            result = Sweep(
                task, {"delay": values}, overrides=overrides, executor=executor
            )
            peaks += result.Values("control_force_peak.x").tolist()
    return peaks


def PeakForce(arguments) -> float:
    """Runs one contender once; returns the largest control force it sampled in N."""
    name, task, delay, duration = arguments
    if name in ("straightforward", "1 kHz DiscreteTimeDelay"):
        from benchmarks import straightforward

        from teleop_drake.scenario import LoadScenario

        overrides = {
            "controller.kind": CONTROLLER,
            "forward_channel.delay": delay,
            "return_channel.delay": delay,
            "duration": duration,
        }
        scenario = LoadScenario(task, overrides)
        if name == "straightforward":
            solution = straightforward.simulate(scenario)
        else:
            solution = straightforward.simulate_sampled(scenario)
    else:
        from benchmarks import contenders

        solution = contenders.Find(name)(task, CONTROLLER, delay, duration)
    return float(abs(solution.signals["control_force"][:, 0]).max())


def RunPool(name: str, task: str, delays: list[float], duration: float):
    """Maps PeakForce over processes, each with a few runs at most."""
    initializer, arguments = None, ()
    if name.startswith("JiTCDDE"):
        from benchmarks import jitcdde_peer

        file = jitcdde_peer.Compiled(task, CONTROLLER)
        initializer, arguments = jitcdde_peer.Adopt, (task, CONTROLLER, file)
    context = multiprocessing.get_context("spawn")
    with context.Pool(JOBS, initializer, arguments) as pool:
        runs = [(name, task, delay, duration) for delay in delays]
        return pool.map(PeakForce, runs, chunksize=1)


def main() -> None:
    kind, what, task, delays, duration = json.loads(sys.argv[1])
    if kind == "sweep":
        peaks = RunSweeps(task, delays, duration, what)
    else:
        peaks = RunPool(what, task, delays, duration)
    print(json.dumps(peaks))


if __name__ == "__main__":
    main()
