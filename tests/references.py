"""The reference runs: `python tests/references.py` writes them.

They are made by independent_solver.py, which shares no code with the package.
"""

from pathlib import Path

import numpy as np
from independent_solver import solve_thesis_task

FOLDER = Path(__file__).parents[1] / "teleop_drake" / "references"
DURATIONS = {"one_dof": 18.0, "two_dof_puncture": 5.0}
DURATIONS |= {"two_dof_collision": 4.0, "two_dof_combined": 4.0}
CONTROLLERS = "direct_force", "adaptive_backstepping"
SIGNALS = {
    "tool_position": "p_WT",
    "tool_velocity": "v_WT",
    "environment_force": "F_e",
    "control_force": "F_c",
}
# The scenario and the controller of each.
REFERENCES = {f"{x}_{kind}": (x, kind) for x in DURATIONS for kind in CONTROLLERS}

# Of a signal's range; no sample is nearer to a jump, s.
TUBE, MARGIN, NUM_TIMES = 1e-3, 2e-3, 200


def write(path, name, columns, tubes=()):
    """Writes a run: a comment with the reference's name, columns, twelve digits."""
    lines = [f"# reference: {name}"]
    if tubes:
        lines.append("# tubes: " + ", ".join(f"{tube:.3g}" for tube in tubes))
    lines.append(",".join(columns))
    lines += [
        ",".join(f"{x:.12g}" for x in row)
        for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def split(times, signals):
    """Returns a column for each component."""
    return {"time": times} | {
        f"{name}_{axis}": values[:, axis]
        for name, values in signals.items()
        for axis in range(values.shape[1])
    }


def solve(name):
    """Returns the columns of a reference, and the half width of each one's tube."""
    task, kind = REFERENCES[name]
    is_adaptive = kind == "adaptive_backstepping"
    result = solve_thesis_task(task, is_adaptive, (0.1, 0.1), DURATIONS[task])
    # The operator's jump at 0, in the force a delay later; and its echo at the events.
    jumps = [0.1 * k for k in range(4)]
    jumps += [e.time + 0.1 * k for e in result.events for k in range(4)]
    end = result.pieces[-1].end
    times = np.linspace(0, end, NUM_TIMES + 2)[1:-1]
    near = np.abs(times[:, np.newaxis] - jumps).min(axis=1) < MARGIN
    sample = result.sample(times[~near])
    columns = split(times[~near], {name: sample[key] for name, key in SIGNALS.items()})
    ranges = [np.ptp(sample[key], axis=0) for key in SIGNALS.values()]
    tubes = [TUBE * width.max() for width in ranges for _ in width]
    return columns, tubes


if __name__ == "__main__":
    for reference in REFERENCES:
        write(FOLDER / f"{reference}.csv", reference, *solve(reference))
