import dataclasses
import json
import math
from collections.abc import Callable

import numpy as np
import pytest
import runs
from grids import Slow
from hypothesis import given
from hypothesis import strategies as st

from teleop_drake.loops.numerics.step_polynomials import DEGREE, shares
from teleop_drake.loops.run.recording import SolverStatistics
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, Scenario
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks import Insertion
from teleop_drake.model.tasks.metrics import RunMetrics, RunSummary

Function = Callable[[np.ndarray], np.ndarray]

# The commanded velocity and the surfaces of one_dof.
V_D = 1e-3
PUNCTURE = 0.0075
SURFACE = 0.015


def layer_force(layer, x, v):
    """Returns the force of (2.14), with the spring relaxed at the layer's reference."""
    return layer.stiffness * (x - layer.reference) + layer.damping * v


@dataclasses.dataclass
class Phase:
    """A phase of a motion, from t = 0 on. All functions may jump at its end."""

    duration: float
    x: Function
    v: Function
    a: Function
    F_c: Function = np.zeros_like
    F_hd: Function = np.zeros_like
    v_dd: Function = lambda t: V_D + 0 * t


def Still(x: float, duration: float) -> Phase:
    return Phase(duration, lambda t: x + 0 * t, np.zeros_like, np.zeros_like)


def Wave(amplitude: float, omega: float, phase: float, duration: float) -> Phase:
    """Returns a phase with the velocity V_D + amplitude sin(omega t + phase)."""
    return Phase(
        duration,
        lambda t: (
            V_D * t + amplitude / omega * (np.cos(phase) - np.cos(omega * t + phase))
        ),
        lambda t: V_D + amplitude * np.sin(omega * t + phase),
        lambda t: amplitude * omega * np.cos(omega * t + phase),
    )


def RegularSteps(step: float) -> Callable[[float], np.ndarray]:
    return lambda duration: np.linspace(0, duration, math.ceil(duration / step) + 1)


def IrregularSteps(seed: int, longest: float) -> Callable[[float], np.ndarray]:
    """Returns steps of many lengths, some of them tiny, as at located events."""
    generator = np.random.default_rng(seed)

    def make(duration: float) -> np.ndarray:
        steps: list[float] = []
        while sum(steps) < duration:
            steps.append(longest * 10 ** generator.choice([0, 0, -0.1, -0.3, -1, -5]))
        return np.concatenate([[0.0], np.cumsum(steps)]) * (duration / sum(steps))

    return make


def Record(
    phases: list[Phase],
    steps: Callable[[float], np.ndarray],
    scenario: Scenario | None = None,
    **changes: str,
) -> TaskRecording:
    """Returns the recording of a motion, with both sides of each jump."""
    scenario = scenario or LoadScenario("one_dof")
    layers = scenario.environment.layers
    starts = [layer.start for layer in layers]
    times = []
    rows = []
    places = []
    begin = 0.0
    for phase in phases:
        ends = steps(phase.duration)
        inner = ends[:-1, None] + np.diff(ends)[:, None] * shares(DEGREE)[1:]
        t = np.concatenate([ends[:1], inner.ravel()])
        first = len(rows) + DEGREE * np.arange(len(ends) - 1)
        places.append(first[:, None] + np.arange(DEGREE + 1))
        # The layer is that of the middle of the phase, which ends at a surface.
        middle = float(phase.x(np.array(phase.duration / 2)))
        index = int(np.searchsorted(starts, middle, side="right")) - 1
        times.append(begin + t)
        for k in range(len(t)):
            x, v, a, F_c, F_hd, v_dd = (
                float(f(t[k]))
                for f in (
                    phase.x, phase.v, phase.a, phase.F_c, phase.F_hd, phase.v_dd
                )
            )  # fmt: skip
            F_e = layer_force(layers[index], x, v) if index >= 0 else 0.0
            rows.append([x, v, a, F_e, index, F_c, F_hd, v_dd])
        begin += phase.duration
    table = np.array(rows)
    return TaskRecording(
        scenario=scenario,
        time=np.concatenate(times),
        steps=np.concatenate(places),
        signals={
            "tool_position": table[:, 0:1],
            "tool_velocity": table[:, 1:2],
            "tool_acceleration": table[:, 2:3],
            "environment_force": table[:, 3:4],
            "environment_layer": table[:, 4:5],
            "control_force": table[:, 5:6],
            "forward_packet_received": table[:, 6:8],
        },
        surfaces=scenario.Surfaces(),
        events=[],
        solver=SolverStatistics(
            engine="drake",
            scheme="runge_kutta5",
            accuracy=1e-8,
            steps=len(table),
            derivative_evaluations=7 * len(table),
            wall_time_s=0.5,
            real_time_factor=2.0,
        ),
        **changes,
    )


# A whole insertion: through the tissue, faster through free space, a bounce off the
# bone, flight, and a second contact that creeps to rest.
B = 0.4e-3
OMEGA = 17.0
TAU = 0.3
A = 4e-3
T_PUNCTURE = PUNCTURE / V_D
T_FREE = (SURFACE - PUNCTURE) / (V_D + 2 * B / math.pi)
T_CONTACT = T_PUNCTURE + T_FREE
T_BOUNCE = math.pi / OMEGA
T_FLIGHT = 2 * V_D / A
F_JUMP = 3e-3


def TaskPhases() -> list[Phase]:
    w = math.pi / T_FREE
    return [
        Phase(
            T_PUNCTURE,
            lambda t: V_D * t,
            lambda t: V_D + 0 * t,
            np.zeros_like,
            F_c=lambda t: -1e-3 * np.sin(2 * np.pi * t / T_PUNCTURE),
        ),
        Phase(
            T_FREE,
            lambda t: PUNCTURE + V_D * t + B / w * (1 - np.cos(w * t)),
            lambda t: V_D + B * np.sin(w * t),
            lambda t: B * w * np.cos(w * t),
            F_c=lambda t: F_JUMP + 0 * t,
        ),
        Phase(
            T_BOUNCE,
            lambda t: SURFACE + V_D / OMEGA * np.sin(OMEGA * t),
            lambda t: V_D * np.cos(OMEGA * t),
            lambda t: -V_D * OMEGA * np.sin(OMEGA * t),
        ),
        Phase(
            T_FLIGHT,
            lambda t: SURFACE - V_D * t + A * t**2 / 2,
            lambda t: -V_D + A * t,
            lambda t: A + 0 * t,
        ),
        Phase(
            20 * TAU,
            lambda t: SURFACE + V_D * TAU * (1 - np.exp(-t / TAU)),
            lambda t: V_D * np.exp(-t / TAU),
            lambda t: -V_D / TAU * np.exp(-t / TAU),
        ),
    ]


STEPS = [
    RegularSteps(0.02),
    IrregularSteps(1, 0.05),
    IrregularSteps(3, 0.02),
]


@pytest.mark.parametrize("steps", STEPS)
def test_task_against_closed_forms(steps):
    metrics = RunMetrics(Record(TaskPhases(), steps))
    puncture = metrics["puncture"]
    collision = metrics["collision"]
    # At constant velocity there are only rounding errors.
    assert 0 <= metrics["start_velocity_overshoot"] < 1e-9
    assert puncture == pytest.approx(
        {
            "time": T_PUNCTURE,
            "velocity": V_D,
            "force": 0.01 * PUNCTURE + 0.5 * V_D,
            "velocity_overshoot": B,
        },
        rel=1e-6,
    )
    assert collision == pytest.approx(
        {
            "time": T_CONTACT,
            "velocity": V_D,
            "initial_impact_force": 150 * V_D / OMEGA,
            "peak_force": 150 * V_D * TAU * (1 - math.exp(-20)),
            "rebound_velocity": -V_D,
            "settling_time": T_BOUNCE + T_FLIGHT + TAU * math.log(20),
            # Force and velocity approach their final values with the same time
            # constant.
            "rest_time": T_BOUNCE + T_FLIGHT + TAU * math.log(20),
        },
        rel=2e-6,
    )
    assert metrics["control_force_peak"] == pytest.approx([F_JUMP], rel=1e-9)
    # The variation of the sine, of the jump up and of the jump down.
    variation = 4 * 1e-3 + 2 * F_JUMP
    assert metrics["control_force_variation"] == pytest.approx([variation], rel=1e-6)
    assert (metrics["diverged"], metrics["diverged_at"]) == (False, None)


@given(
    phase=st.floats(0, 2 * math.pi),
    amplitude=st.floats(1e-5, 1e-3),
    omega=st.floats(2, 40),
)
def test_peaks_between_the_samples(phase, amplitude, omega):
    period = 2 * math.pi / omega
    wave = Wave(amplitude, omega, phase, 3 * period)
    wave.F_c = lambda t: amplitude * np.cos(omega * t + phase)
    metrics = RunMetrics(Record([wave], RegularSteps(period / 20)))
    overshoot = metrics["start_velocity_overshoot"]
    assert overshoot == pytest.approx(amplitude, rel=1e-6)
    assert metrics["velocity_rms_error"] == pytest.approx(
        [amplitude / math.sqrt(2)], rel=1e-6
    )
    assert metrics["control_force_peak"] == pytest.approx([amplitude], rel=1e-5)
    assert metrics["control_force_variation"] == pytest.approx(
        [12 * amplitude], rel=1e-5
    )


@pytest.mark.parametrize(("step", "tolerance"), [(0.01, 1e-4), (0.001, 1e-9)])
def test_variation_between_packets(step, tolerance):
    """A force that jumps with each packet, rises and falls until the next one."""
    pulse = Wave(0.0, 1.0, 0.0, 0.02)
    pulse.F_c = lambda t: t * np.exp(-t / 0.012)
    metrics = RunMetrics(Record([pulse] * 20, RegularSteps(step)))
    peak = pulse.F_c(0.012)
    last = pulse.F_c(0.02)
    exact = 20 * (peak + (peak - last)) + 19 * last
    assert metrics["control_force_variation"] == pytest.approx([exact], rel=tolerance)


def test_overshoot_ends_at_the_puncture_or_the_contact():
    slow = Wave(1e-4, 2.0, 0.0, 5.0)
    fast = TaskPhases()
    # The velocity overshoots by 0.1 mm/s in the tissue and by 0.4 mm/s behind it.
    x_end = float(slow.x(np.array(5.0)))
    rest = Phase(
        (PUNCTURE - x_end) / V_D, lambda t: x_end + V_D * t, fast[0].v, fast[0].a
    )
    recording = Record([slow, rest, *fast[1:]], RegularSteps(0.05))
    metrics = RunMetrics(recording)
    assert metrics["start_velocity_overshoot"] == pytest.approx(1e-4, rel=1e-5)
    assert metrics["puncture"]["velocity_overshoot"] == pytest.approx(B, rel=1e-6)

    # Without the tissue, the start overshoot is taken until the contact.
    scenario = LoadScenario("one_dof")
    scenario.environment.layers = scenario.environment.layers[1:]
    scenario.environment.layers[0].start = -math.inf
    metrics = RunMetrics(
        dataclasses.replace(recording, scenario=scenario, surfaces=scenario.Surfaces())
    )
    assert metrics["puncture"] is None
    assert metrics["start_velocity_overshoot"] == pytest.approx(B, rel=1e-6)
    assert metrics["collision"]["time"] == pytest.approx(
        5.0 + rest.duration + T_FREE, rel=1e-9
    )


def test_puncture_without_contact():
    metrics = RunMetrics(Record(TaskPhases()[:2], RegularSteps(0.05)))
    # The very last sample touches the bone.
    assert metrics["collision"]["velocity"] == pytest.approx(V_D, rel=1e-6)
    assert metrics["collision"]["settling_time"] is None

    phases = TaskPhases()[:2]
    phases[1].duration /= 2
    metrics = RunMetrics(Record(phases, RegularSteps(0.05)))
    assert metrics["collision"] is None
    assert metrics["puncture"]["velocity_overshoot"] == pytest.approx(B, rel=1e-6)


def test_slower_than_commanded_is_no_overshoot():
    phases = [Still(0.001, 1.0)]
    metrics = RunMetrics(Record(phases, RegularSteps(0.1)))
    assert metrics["start_velocity_overshoot"] == 0.0
    assert metrics["puncture"] is None
    assert metrics["collision"] is None
    assert metrics["velocity_rms_error"] == pytest.approx([V_D])
    assert metrics["control_force_variation"] == [0.0]

    # After the puncture the overshoot may be negative.
    v = 0.9 * V_D
    crawl = Phase(10.0, lambda t: v * t, lambda t: v + 0 * t, np.zeros_like)
    metrics = RunMetrics(Record([crawl], RegularSteps(0.1)))
    assert metrics["puncture"]["velocity_overshoot"] == pytest.approx(-0.1 * V_D)


def Backwards(phase: Phase) -> Phase:
    """Returns the mirror image of a phase."""
    return Phase(
        phase.duration,
        lambda t: -phase.x(t),
        lambda t: -phase.v(t),
        lambda t: -phase.a(t),
        v_dd=lambda t: -V_D + 0 * t,
    )


@pytest.mark.parametrize("amplitude", [0.0, 2e-4])
def test_overshoot_is_in_the_direction_of_the_command(amplitude):
    scenario = LoadScenario("one_dof", {"surgeon.velocity": [-V_D]})
    # The velocity rises from 0 to the command and, with an amplitude, beyond it.
    start = Phase(
        2.0,
        lambda t: V_D * (t - 1 + np.exp(-t)),
        lambda t: V_D * (1 - np.exp(-t)),
        lambda t: V_D * np.exp(-t),
    )
    wave = Wave(amplitude, 2.0, 0.0, 5.0)
    x_0 = float(start.x(np.array(2.0)))
    beyond = dataclasses.replace(wave, x=lambda t: x_0 + wave.x(t))
    recording = Record(
        [Backwards(start), Backwards(beyond)], RegularSteps(0.05), scenario
    )
    overshoot = RunMetrics(recording)["start_velocity_overshoot"]
    assert overshoot == pytest.approx(amplitude, rel=1e-5, abs=1e-12)


@pytest.mark.parametrize("has_waited", [False, True])
def test_overshoot_over_a_command_that_reverses_or_waits(has_waited):
    """The tool follows a sine with a lag; the overshoot is largest at its reversals."""
    lag = 0.3
    swing = Phase(
        7.0,
        lambda t: V_D * (np.cos(lag) - np.cos(t - lag)),
        lambda t: V_D * np.sin(t - lag),
        lambda t: V_D * np.cos(t - lag),
        v_dd=lambda t: V_D * np.sin(t),
    )
    # A command that is 0 up to rounding has no direction.
    wait = Phase(
        1.0,
        lambda t: -V_D * t,
        lambda t: -V_D + 0 * t,
        np.zeros_like,
        v_dd=lambda t: -1e-20 * np.cos(20 * t),
    )
    recording = Record([wait, swing] if has_waited else [swing], RegularSteps(0.11))
    recording.has_constant_command = False
    overshoot = RunMetrics(recording)["start_velocity_overshoot"]
    assert overshoot == pytest.approx(V_D * math.sin(lag), rel=1e-6)


def test_starting_on_the_surface_is_no_contact():
    metrics = RunMetrics(Record([Still(SURFACE, 1.0)], RegularSteps(0.1)))
    assert metrics["collision"] is None


def test_contact_between_samples_and_at_a_sample():
    def contact_time(step: float) -> float:
        approach = Phase(
            2.0,
            lambda t: SURFACE - 0.001 + V_D * t,
            lambda t: V_D + 0 * t,
            np.zeros_like,
        )
        return RunMetrics(Record([approach], RegularSteps(step)))["collision"]["time"]

    for step in (2.0, 0.7, 0.1, 0.5, 1.0):
        assert contact_time(step) == pytest.approx(1.0, abs=1e-12)


def Ringing(decay: float, duration: float) -> list[Phase]:
    """Returns a contact with the bone, after which v = V_D exp(-decay t) cos(w t)."""
    w = 10.0
    s = complex(-decay, w)
    return [
        Phase(
            1.0,
            lambda t: SURFACE + V_D * (t - 1.0),
            lambda t: V_D + 0 * t,
            np.zeros_like,
        ),
        Phase(
            duration,
            lambda t: SURFACE + V_D * np.real((np.exp(s * t) - 1) / s),
            lambda t: V_D * np.real(np.exp(s * t)),
            lambda t: V_D * np.real(s * np.exp(s * t)),
        ),
    ]


def test_settling_time_of_an_oscillation():
    metrics = RunMetrics(Record(Ringing(1.0, 10.0), RegularSteps(0.03)))
    t = np.linspace(0, 10, 1_000_001)
    fast = np.abs(np.exp(-t) * np.cos(10 * t)) >= 0.05
    expected = t[np.flatnonzero(fast)[-1]]
    assert metrics["collision"]["settling_time"] == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize("duration", [2.98, math.pi / 20 * 19, 3.0, 3.1])
def test_steady_oscillation_never_settles_wherever_it_ends(duration):
    # With 19/20 pi the velocity is 0 at the end of the recording.
    metrics = RunMetrics(Record(Ringing(0.0, duration), RegularSteps(0.03)))
    assert metrics["collision"]["settling_time"] is None


def test_slow_contact_is_settled_at_once():
    v = 0.04 * V_D
    creep = Phase(
        10.0,
        lambda t: SURFACE - 5 * v + v * t,
        lambda t: v + 0 * t,
        np.zeros_like,
    )
    metrics = RunMetrics(Record([creep], RegularSteps(0.3)))
    assert metrics["collision"]["settling_time"] == 0.0


def test_diverged():
    recording = Record(
        Ringing(-0.5, 3.0), RegularSteps(0.03), termination="diverged", reason="speed"
    )
    metrics = RunMetrics(recording)
    assert metrics["diverged"] is True
    assert metrics["diverged_at"] == recording.time[-1]
    assert metrics["collision"]["settling_time"] is None

    # A run that diverged has no settling time, even if the tool was slow at its end.
    recording = Record(Ringing(5.0, 3.0), RegularSteps(0.03), termination="diverged")
    assert RunMetrics(recording)["collision"]["settling_time"] is None
    recording.termination = "interrupted"
    metrics = RunMetrics(recording)
    assert (metrics["diverged"], metrics["diverged_at"]) == (False, None)
    assert metrics["collision"]["settling_time"] > 0


def test_samples_that_are_not_finite_are_ignored():
    recording = Record(Ringing(0.0, 3.0), RegularSteps(0.03), termination="diverged")
    whole = RunMetrics(recording)
    longer = dataclasses.replace(
        recording,
        time=np.append(recording.time, recording.time[-1] + 0.1),
        signals={
            name: np.vstack([x, np.full((1, x.shape[1]), math.nan)])
            for name, x in recording.signals.items()
        },
    )
    assert RunMetrics(longer) == whole
    assert RunSummary(longer) == RunSummary(recording)
    for x in longer.signals.values():
        x[:] = math.inf
    with pytest.raises(ValueError, match="one finite sample"):
        RunMetrics(longer)


def test_one_sample():
    recording = Record([Still(0.001, 1.0)], RegularSteps(1.0), termination="diverged")
    recording.time, recording.steps = recording.time[:1], recording.steps[:0]
    recording.signals = {name: x[:1] for name, x in recording.signals.items()}
    summary = RunSummary(recording)
    json.dumps(summary, allow_nan=False)
    assert summary["metrics"]["diverged_at"] == 0.0
    assert summary["metrics"]["velocity_rms_error"] == pytest.approx([V_D])


def test_environment_and_robot_of_ones_own():
    recording = Record(TaskPhases(), RegularSteps(0.02))
    expected = RunMetrics(recording)
    del recording.signals["tool_acceleration"]
    metrics = RunMetrics(recording)
    assert metrics["puncture"] == pytest.approx(expected["puncture"], rel=1e-4)
    assert metrics["collision"] == pytest.approx(expected["collision"], rel=1e-4)

    # Without a material the metrics use the recorded force.
    recording.surfaces = [
        dataclasses.replace(surface, material=None) for surface in recording.surfaces
    ]
    recording.signals["environment_force"] *= 2
    metrics = RunMetrics(recording)
    for event, name in (("puncture", "force"), ("collision", "peak_force")):
        assert metrics[event][name] == pytest.approx(
            2 * expected[event][name], rel=1e-4
        )


def test_two_axes():
    """Each axis has its own metrics; events are determined by x only."""
    scenario = LoadScenario("two_dof_puncture")
    t = np.arange(0, 3 * math.pi, 0.005)
    n = len(t)
    one = np.ones(n)
    x = 0.85 + 0.1 * t / 4
    y = 0.01 * np.sin(2 * t)
    recording = Record([Still(0.9, 1.0)], RegularSteps(0.5), scenario)
    recording.time = t
    recording.steps = np.arange(n - 1).reshape(-1, DEGREE)[:, :1] + np.arange(
        DEGREE + 1
    )
    recording.signals = {
        "tool_position": np.column_stack([x, y]),
        "tool_velocity": np.column_stack([0.025 * one, 0.02 * np.cos(2 * t)]),
        "tool_acceleration": np.column_stack([0 * t, -0.04 * np.sin(2 * t)]),
        "environment_force": np.column_stack([0.01 * x + 0.5 * 0.025, 0 * t]),
        "environment_layer": 0 * t[:, None],
        "control_force": np.column_stack([0.3 * one, -2 * np.sin(t)]),
        "forward_packet_received": np.column_stack(
            [0.01 * x + 0.0125 + 0.2, 0.4 * one, 0.025 * one + 0.01, 0 * t]
        ),
    }
    metrics = RunMetrics(recording)
    assert metrics["velocity_rms_error"] == pytest.approx(
        [0.01, 0.02 * math.sqrt(0.5 + math.sin(4 * t[-1]) / (8 * t[-1]))], rel=1e-9
    )
    assert metrics["force_rms_error"] == pytest.approx([0.2, 0.4], rel=1e-9)
    assert metrics["control_force_peak"] == pytest.approx([0.3, 2.0], rel=1e-9)
    assert metrics["control_force_variation"][0] == pytest.approx(0.0, abs=1e-12)
    last = 2 * abs(math.sin(t[-1]))
    assert metrics["control_force_variation"][1] == pytest.approx(12 - last, rel=1e-6)
    assert metrics["puncture"] is None  # x gets to 1.09 m.
    assert RunSummary(recording)["final"]["position"] == [x[-1], y[-1]]


@pytest.mark.parametrize("steps", STEPS)
def test_rms_errors_do_not_depend_on_the_steps(steps):
    phases = TaskPhases()
    for phase in phases:
        phase.F_hd = lambda t: 1e-3 * np.cos(3 * t)
    metrics = RunMetrics(Record(phases, steps))
    dense = {"v": 0.0, "F": 0.0}
    layers = LoadScenario("one_dof").environment.layers
    for phase, layer in zip(phases, [0, 1, 2, 1, 2], strict=True):
        t = np.linspace(0, phase.duration, 20_001)
        F_e = layer_force(layers[layer], phase.x(t), phase.v(t))
        dense["v"] += np.trapezoid((phase.v(t) - V_D) ** 2, t)
        dense["F"] += np.trapezoid((F_e - phase.F_hd(t)) ** 2, t)
    duration = sum(phase.duration for phase in phases)
    expected = {name: math.sqrt(value / duration) for name, value in dense.items()}
    assert metrics["velocity_rms_error"] == pytest.approx([expected["v"]], rel=1e-6)
    assert metrics["force_rms_error"] == pytest.approx([expected["F"]], rel=1e-6)


def test_summary_has_the_promised_fields():
    scenario = LoadScenario(
        "one_dof", {"forward_channel.delay": 0.2, "return_channel.delay": 0.05}
    )
    summary = RunSummary(Record(TaskPhases(), RegularSteps(0.05), scenario))
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    metrics = summary.pop("metrics")
    assert summary == {
        "scenario": "one_dof",
        "controller": "adaptive_backstepping",
        "forward_delay": 0.2,
        "return_delay": 0.05,
        "duration": 25.0,
        "final": {
            "position": [pytest.approx(SURFACE + V_D * TAU)],
            "velocity": [pytest.approx(0, abs=1e-10)],
            "environment_force": [pytest.approx(150 * V_D * TAU)],
        },
        "solver": {
            "engine": "drake",
            "scheme": "runge_kutta5",
            "accuracy": 1e-8,
            "steps": summary["solver"]["steps"],
            "derivative_evaluations": 7 * summary["solver"]["steps"],
            "wall_time_s": 0.5,
            "real_time_factor": 2.0,
        },
    }
    assert list(metrics["puncture"]) == [
        "time", "velocity", "force", "velocity_overshoot",
    ]  # fmt: skip
    assert list(metrics["collision"]) == [
        "time", "velocity", "initial_impact_force", "peak_force", "rebound_velocity",
        "settling_time", "rest_time",
    ]  # fmt: skip
    # Insertion.units contains all metrics.
    scalars = {name.partition(".")[0] for name in Insertion.units}
    assert set(metrics) == scalars


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", ["direct_force", "damped_force"])
def test_a_run_by_dense_samples(kind, subtests):
    """The metrics of all axes equal those of dense samples.

    The felt position is the tool's position delayed by the return channel.
    """
    recording = runs.Run("two_dof_combined", kind, engine="auto")
    metrics = RunMetrics(recording)
    contact = metrics["collision"]["time"]
    end = recording.time[-1]
    for event, name in (("puncture", "puncture"), ("contact", "collision")):
        assert metrics[name]["time"] == pytest.approx(recording.EventTimes(event)[0])
    t = np.linspace(contact, end, 200_001)
    v = recording.Interpolate("tool_velocity", t)
    F_e = recording.Interpolate("environment_force", t)
    off = np.linalg.norm(F_e - F_e[-1], axis=1) > 0.05 * np.linalg.norm(F_e[-1])
    moving = np.flatnonzero((np.linalg.norm(v, axis=1) > 0.05 * 0.1) | off)
    rest = metrics["collision"]["rest_time"]
    if kind == "direct_force":
        assert rest is None and t[moving[-1]] > end - 0.5
    else:
        settling_time = metrics["collision"]["settling_time"]
        assert rest == pytest.approx(t[moving[-1]] - contact, abs=2e-4)
        assert rest > settling_time + 0.1
    t = np.linspace(0, end, 40_001)
    names = ("tool_position", "tool_velocity", "environment_force")
    p, v, F_e, command = (
        recording.Interpolate(name, t) for name in (*names, "forward_packet_received")
    )
    felt = recording.Interpolate("tool_position", np.maximum(t - 0.1, 0))
    for name, error in (
        ("coordination_rms_error", felt - p),
        ("velocity_rms_error", v - command[:, 2:]),
        ("force_rms_error", F_e - command[:, :2]),
    ):
        with subtests.test(name=name):
            expected = np.sqrt((error**2).mean(axis=0))
            assert metrics[name] == pytest.approx(expected, rel=1e-3), name
    F_c = recording.Interpolate("control_force", np.linspace(0, end, 400_001))
    assert metrics["control_force_peak"] == pytest.approx(np.abs(F_c).max(axis=0), 1e-3)
    variation = np.abs(np.diff(F_c, axis=0)).sum(axis=0)
    assert metrics["control_force_variation"] == pytest.approx(variation, rel=1e-3)


@pytest.mark.parametrize(("tau_v", "tau_F"), [(0.5, 0.1), (0.2, 0.4)])
def test_rest_on_a_spiral(tau_v, tau_F):
    """Velocity and force decay on spirals, so that no axis determines the rest time."""
    recording = runs.Run("two_dof_collision", "damped_force", engine="auto")
    t = recording.time - RunMetrics(recording)["collision"]["time"]
    circle = np.stack([np.cos(9 * t), np.sin(9 * t)], axis=1)
    v, F = (np.exp(-np.fmax(t, 0) / tau)[:, None] * circle for tau in (tau_v, tau_F))
    signals = {"tool_velocity": 0.1 * v, "environment_force": [0.12, 0.16] + 0.4 * F}
    signals = {**recording.signals, **signals}
    changed = dataclasses.replace(recording, signals=signals)
    expected = max(tau_v * math.log(20), tau_F * math.log(40))
    rest = RunMetrics(changed)["collision"]["rest_time"]
    assert rest == pytest.approx(expected, rel=1e-5)


def OvershootBetween(recording, begin, end):
    """Returns the max of v_x minus the received command, from dense samples."""
    t = np.linspace(begin, end, 100_001)[1:-1]
    sent = t - recording.scenario.forward_channel.delay
    command = recording.Interpolate("velocity_command", np.fmax(sent, 0))[:, 0]
    command[sent < 0] = 0.0
    return float((recording.Interpolate("tool_velocity", t)[:, 0] - command).max())


@pytest.mark.parametrize(
    ("stop", "engine"),
    Slow(
        [
            (0.7, "compiled"),
            (0.8999999999999999, "compiled"),
            (0.8999999999999999, "drake"),
            (0.7, "drake"),
        ],
        but=[0, 1],
    ),
)
def test_an_echo_at_a_tick_but_for_rounding(stop, engine):
    """The command stops, and is received at the instant of a sample of the encoder.

    Both instants are equal up to rounding.
    """
    more = {
        "controller.kind": "proportional_damping",
        "surgeon.kind": "human",
        "surgeon.stop_time": stop,
        "sensor.encoder.sample_period": 0.02,
        "delay": 0.1,
        "duration": 1.3,
    }
    recording = simulate(LoadScenario("two_dof_puncture", more), engine=engine)
    expected = OvershootBetween(recording, 0.0, 1.3)
    found = RunMetrics(recording)["start_velocity_overshoot"]
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("stop", [8.7, 9.1])
def test_an_echo_at_a_tick_but_for_rounding_after_the_puncture(stop):
    more = {
        "controller.kind": "proportional_damping",
        "surgeon.kind": "human",
        "surgeon.stop_time": stop,
        "sensor.encoder.sample_period": 0.02,
        "duration": stop + 0.4,
    }
    recording = simulate(LoadScenario("one_dof", more), engine="compiled")
    puncture = RunMetrics(recording)["puncture"]
    expected = OvershootBetween(recording, puncture["time"], recording.time[-1])
    assert puncture["velocity_overshoot"] == pytest.approx(expected, rel=1e-5)
