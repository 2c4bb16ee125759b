"""The loop against an independent solver of its delay differential equations."""

import numpy as np
import pytest
from grids import Slow
from independent_solver import solve_thesis_task
from references import DURATIONS, SIGNALS
from runs import TASKS, Run

from teleop_drake.model.scenario import CONTROLLERS
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.sweep import FlattenMetrics

# They look at the same runs.
pytestmark = pytest.mark.xdist_group("runs")

# Forward and return delay in s, and the part of the task that is compared.
DELAYS = {
    "unequal": (0.0371, 0.1513),
    "none": (0.0, 0.0),
    "forward only": (0.123456789, 0.0),
    "return only": (0.0, 0.0823),
}
METRICS = {
    "start_velocity_overshoot": "start_velocity_overshoot",
    **{f"puncture.{x}": f"puncture_{x}" for x in ("time", "velocity", "force")},
    "puncture.velocity_overshoot": "velocity_overshoot",
    **{f"collision.{x}": f"contact_{x}" for x in ("time", "velocity")},
    **{
        f"collision.{x}": x
        for x in ("initial_impact_force", "peak_force", "rebound_velocity")
    },
}


def Compare(
    name,
    kind,
    delays,
    duration=None,
    engine="drake",
    local_damping=0.0,
    against="ground",
):
    ways = zip(("forward", "return"), delays, strict=True)
    overrides = [f"{way}_channel.delay={delay}" for way, delay in ways]
    if duration is not None:
        overrides.append(f"duration={duration}")
    if engine != "drake":  # Its steps are longer than one can interpolate between.
        overrides.append("simulator.max_step_size=0.002")
    if local_damping:
        overrides.append(f"controller.{kind}.damping={local_damping}")
        overrides.append(f"controller.{kind}.against={against}")
    ours = Run(name, kind, *overrides, engine=engine)
    adaptive = kind == "adaptive_backstepping"
    theirs = solve_thesis_task(
        name,
        adaptive,
        delays,
        ours.scenario.duration,
        local_damping,
        follows_command=against == "command",
    )
    # Both runs of a loop that diverges stop at the same speed, at nearly one time.
    times = np.linspace(0, ours.time[-1], 1001)[:-4]
    reference = theirs.sample(times)
    for signal, key in SIGNALS.items():
        error = np.abs(ours.Interpolate(signal, times) - reference[key])
        # A jump is at one instant, which the two may place on either side of a sample.
        near_jump = np.zeros(len(times), dtype=bool)
        for jump in ours.time[1:][np.diff(ours.time) == 0]:
            near_jump |= np.abs(times - jump) < 1e-4
        scale = np.ptp(reference[key], axis=0).max()
        assert error[~near_jump].max() <= 1e-3 * scale, signal
    for ours_name, theirs_name in (
        ("puncture", "puncture"),
        ("contact", "contact"),
        ("release", "release"),
        ("surgeon_force", "switch"),
    ):
        expected = [e.time for e in theirs.events if e.kind == theirs_name]
        assert ours.EventTimes(ours_name) == pytest.approx(expected, abs=1e-4)
    metrics = FlattenMetrics(RunMetrics(ours))
    expected = theirs.metrics()
    assert "start_velocity_overshoot" in metrics
    for name, key in METRICS.items():
        if name in metrics:
            value = pytest.approx(expected[key], rel=1e-3, abs=1e-9)
            assert metrics[name] == value, name


@pytest.mark.slow
@pytest.mark.parametrize("against", ["ground", "command"])
@pytest.mark.parametrize("name", Slow(TASKS, but=[2]))
def test_damped_force(name, against):
    """Until the tool is at rest on the bone."""
    Compare(name, "damped_force", (0.02, 0.1), DURATIONS[name], "auto", 2.0, against)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("name", "arrival"),
    [("one_dof", 14.951), ("two_dof_collision", 1.502), ("two_dof_combined", 2.558)],
)
def test_arrival_with_a_damper_against_the_command(name, arrival):
    """With 2 N s/m and 0.1 s each way, in the package and in the other solver."""
    damper = "controller.damped_force"
    ours = Run(name, "damped_force", f"{damper}.damping=2", f"{damper}.against=command")
    theirs = solve_thesis_task(
        name, False, (0.1, 0.1), arrival + 0.1, 2.0, follows_command=True
    )
    assert ours.EventTimes("contact")[0] == pytest.approx(arrival, abs=5e-4)
    assert theirs.event("contact").time == pytest.approx(arrival, abs=5e-4)


# One way and both; cli/test_check.py has the delays of the thesis.
SHORT_RUN = [
    ("two_dof_combined", "adaptive_backstepping", "unequal"),
    ("two_dof_puncture", "direct_force", "forward only"),
]
# Each task with each of them, and each controller with both.
OTHER_DELAYS = [
    (name, CONTROLLERS[(i + j // 2) % 2], delays)
    for i, name in enumerate(TASKS)
    for j, delays in enumerate(DELAYS)
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "delays"),
    Slow(OTHER_DELAYS, but=[OTHER_DELAYS.index(case) for case in SHORT_RUN]),
)
def test_other_delays(name, kind, delays):
    """As machine code, which is less accurate of a tool that bounces on bone."""
    bounces = kind == "direct_force" and name != "two_dof_puncture"
    engine = "drake" if bounces else "auto"
    Compare(name, kind, DELAYS[delays], DURATIONS[name], engine)
