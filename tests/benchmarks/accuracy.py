"""How wrong a solution is, measured against tests/independent_solver.py."""

import functools

import numpy as np
from independent_solver import solve, thesis_task
from references import SIGNALS

# A jump is at one instant, which two solutions place on either side of a sample.
JUMP_WINDOW = 1e-3


def Solve(task, controller, delay, duration, **options):
    """Solves one of the thesis's tasks with the independent solver."""
    adaptive = controller == "adaptive_backstepping"
    problem = thesis_task(task, adaptive, delays=(delay, delay))
    limit = 5 * np.linalg.norm(problem.velocity)
    return solve(problem, duration, speed_limit=limit, **options)


@functools.cache
def Oracle(task, controller, delay, duration):
    """Returns the converged solution; test_independent_solver.py says how much."""
    return Solve(task, controller, delay, duration, rtol=1e-11)


def Errors(oracle, time, signals) -> dict[str, float]:
    """Largest deviations of a solution, each relative to that signal's range.

    At the solution's own samples (N,) and (N, k), so that nothing is interpolated. The
    range is that of the signal's largest axis; "velocity_y" is relative to its own.
    """
    keep = (time < oracle.end - JUMP_WINDOW) & (time > 0)
    for jump in oracle.jumps:
        keep &= np.abs(time - jump) > JUMP_WINDOW
    reference = oracle.sample(time[keep])
    errors = {}
    for name, key in SIGNALS.items():
        if name not in signals:
            continue
        scale = np.ptp(reference[key], axis=0).max()
        errors[name] = float(np.abs(signals[name][keep] - reference[key]).max() / scale)
    v = reference["v_WT"]
    if v.shape[1] > 1:
        error = np.abs(signals["tool_velocity"][keep][:, 1] - v[:, 1]).max()
        errors["velocity_y"] = float(error / np.ptp(v[:, 1]))
    return errors


def LargestError(oracle, solution) -> float:
    """Returns the largest of the Errors of a Solution."""
    return max(Errors(oracle, solution.time, solution.signals).values())
