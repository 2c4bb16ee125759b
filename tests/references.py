"""The reference runs: `python tests/references.py` writes them.

They are made by independent_solver.py, which shares no code with the package.
"""

import functools
from pathlib import Path

import independent_solver as oracle
import numpy as np

FOLDER = Path(__file__).parents[1] / "teleop_drake" / "references"
# By packet: when it is sent, s; how long it takes, ms, nothing if it is lost.
PACKETS = {way: FOLDER / "packets" / f"{way}.csv" for way in ("forward", "return")}
PERIOD = 0.01
DURATIONS = {"one_dof": 18.0, "two_dof_puncture": 5.0, "two_dof_collision": 4.0}
DURATIONS |= {"two_dof_combined": 4.0, "needle_insertion": 6.0}
SIGNALS = {
    "tool_position": "p_WT",
    "tool_velocity": "v_WT",
    "environment_force": "F_e",
    "control_force": "F_c",
}
# The scenario and the controller of each.
REFERENCES = {
    f"{task}_{kind}": (task, kind)
    for task, kind in (
        ("one_dof", "direct_force"),
        ("one_dof", "adaptive_backstepping"),
        ("two_dof_puncture", "direct_force"),
        ("two_dof_collision", "adaptive_backstepping"),
        ("two_dof_combined", "direct_force"),
        ("two_dof_combined", "adaptive_backstepping"),
        ("needle_insertion", "adaptive_backstepping"),
    )
}
NETWORK = "two_dof_combined_network"
REFERENCES[NETWORK] = "two_dof_combined", "adaptive_backstepping"

# Of a signal's range; no sample is nearer to a jump, s.
TUBE = 1e-3
MARGIN = 2e-3
NUM_TIMES = 200


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


def overrides(name):
    """Returns what makes a reference's run of its scenario, as PATH=VALUE."""
    task, _ = REFERENCES[name]
    changes = [f"duration={DURATIONS[task]}"]
    for way, packets in PACKETS.items() if name == NETWORK else ():
        channel = {"kind": "network", "delay": 0.0, "sample_period": PERIOD}
        channel["trace"] = packets
        changes += [f"{way}_channel.{key}={value}" for key, value in channel.items()]
    return changes


def write_packets():
    """Writes delays that jitter about 0.1 s and overtake; one of 20 packets is lost."""
    random = np.random.default_rng(1)
    count = round(DURATIONS[REFERENCES[NETWORK][0]] / PERIOD) + 1
    delays = random.gamma(6.0, 8.0, (count, 2)) + 52.0
    texts = np.char.mod("%.3f", delays)
    texts[random.random((count, 2)) < 0.05] = ""
    for packets, column in zip(PACKETS.values(), texts.T, strict=True):
        rows = [f"{k * PERIOD:.2f},{delay}" for k, delay in enumerate(column)]
        text = "\n".join(["time_s,delay_ms", *rows, ""])
        packets.write_text(text, encoding="utf-8")


def read_packets():
    """Returns when the packets of both ways arrive, s, inf if never."""
    arrivals = []
    for packets in PACKETS.values():
        lines = packets.read_text("utf-8").splitlines()[1:]
        rows = [line.split(",") for line in lines]
        arrivals.append([float(t) + float(delay or "inf") / 1e3 for t, delay in rows])
    return arrivals


def run(name):
    """Returns the solver's result."""
    task, kind = REFERENCES[name]
    is_adaptive = kind == "adaptive_backstepping"
    duration = DURATIONS[task]
    if name == NETWORK:
        make = functools.partial(oracle.Packets, period=PERIOD, arrivals=read_packets())
        return oracle.solve(oracle.thesis_task(task, True), duration, make=make)
    if task == "needle_insertion":
        return oracle.solve(oracle.needle_task(), duration)
    return oracle.solve_thesis_task(task, is_adaptive, (0.1, 0.1), duration)


def solve(name):
    """Returns the columns of a reference, and the half width of each one's tube."""
    result = run(name)
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
    write_packets()
    for reference in REFERENCES:
        write(FOLDER / f"{reference}.csv", reference, *solve(reference))
