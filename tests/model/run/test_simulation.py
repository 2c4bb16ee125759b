"""Tests of simulate(): recorded signals, ends of runs, errors and interrupts."""

import gc
import math
import re
import signal
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_array_equal
from runs import TASKS, Run
from surfaces import Border

from teleop_drake.loops.run import drake_run
from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBackstepping,
)
from teleop_drake.model.blocks.architectures.direct_force import DirectForce
from teleop_drake.model.run.simulate import MakeDiagram, simulate
from teleop_drake.model.scenario import CONTROLLERS, LoadScenario, ScenarioError
from teleop_drake.model.task_recording import LoadRecording
from teleop_drake.model.teleoperator import MakeTeleoperator

# The tests share their runs.
pytestmark = pytest.mark.xdist_group("runs")

DIRECT, ADAPTIVE = CONTROLLERS


def sides(recording, name, time):
    """Returns a signal on both sides of the jump at a time."""
    jumps = np.flatnonzero(np.diff(recording.time) == 0)
    i = jumps[np.argmin(np.abs(recording.time[jumps] - time))]
    assert recording.time[i] == pytest.approx(time, abs=1e-6)
    return recording[name][i], recording[name][i + 1]


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.parametrize("name", TASKS)
def test_all_signals_of_the_loop(name, kind):
    recording = Run(name, kind)
    n = recording.scenario.num_axes
    widths = {
        **dict.fromkeys(("tool_position", "tool_velocity", "tool_acceleration"), n),
        **dict.fromkeys(("joint_position", "joint_velocity", "joint_torque"), n),
        **dict.fromkeys(("environment_force", "control_force"), n),
        **dict.fromkeys(("environment_layer", "surgeon_mode"), 1),
        **{
            f"{way}_packet_{end}": 2 * n
            for way in ("forward", "return")
            for end in ("sent", "received")
        },
    }
    if kind == ADAPTIVE:
        num_functions = 5**n
        widths |= {
            "psi": n * n,
            "weights_1": n * num_functions,
            "weights_3": n * num_functions,
            "auxiliary_error": n,
            "control_force_error": n,
        }
    assert {key: value.shape[1] for key, value in recording.signals.items()} == widths
    for values in recording.signals.values():
        assert len(values) == len(recording.time)
        assert np.all(np.isfinite(values))
    assert np.all(np.diff(recording.time) >= 0)
    assert recording.time[0] == 0
    if recording.termination == "completed":
        assert recording.time[-1] == recording.scenario.duration
    assert np.all(recording["environment_force"][:, 1:] == 0)  # Normal to the layers.
    assert_array_equal(
        recording["return_packet_sent"],
        np.hstack((recording["tool_position"], recording["tool_velocity"])),
    )
    solver = recording.solver
    assert solver.scheme == "runge_kutta5"
    assert solver.accuracy == recording.scenario.simulator.accuracy
    assert 0 < solver.steps < solver.derivative_evaluations


@pytest.mark.parametrize("name", TASKS)
def test_velocity_and_acceleration_are_derivatives(name):
    recording = Run(name, ADAPTIVE)
    t = recording.time
    for rate, value in (
        ("tool_velocity", "tool_position"),
        ("tool_acceleration", "tool_velocity"),
    ):
        change = np.diff(recording[value], axis=0)
        mean = (recording[rate][1:] + recording[rate][:-1]) / 2
        scale = np.ptp(recording[value])
        assert np.abs(change - mean * np.diff(t)[:, None]).max() < 2e-3 * scale


def test_both_sides_of_the_puncture():
    recording = Run("one_dof", DIRECT)
    (time,) = recording.EventTimes("puncture")
    before, after = sides(recording, "environment_force", time)
    velocity = recording.Interpolate("tool_velocity", np.array([time]))[0, 0]
    assert before[0] == pytest.approx(0.01 * 0.0075 + 0.5 * velocity, rel=1e-6)
    assert after[0] == 0
    # The position is at the border, to a nanometre.
    position, _ = sides(recording, "tool_position", time)
    assert 0.0075 <= position[0] < 0.0075 + 1e-9


@pytest.mark.parametrize(
    "name",
    ("one_dof", "two_dof_collision", "two_dof_combined"),
)
def test_contact_is_located_and_perceived_one_return_delay_later(name):
    recording = Run(name, ADAPTIVE)
    contact = recording.EventTimes("contact")[0]
    x = recording.Interpolate("tool_position", np.array([contact]))[0, 0]
    surface = Border(recording.scenario, "contact")
    assert x == pytest.approx(surface, abs=1e-9)
    (switch,) = recording.EventTimes("surgeon_force")
    assert switch - contact == pytest.approx(0.1, abs=2e-6)
    before, after = sides(recording, "forward_packet_sent", switch)
    n = recording.scenario.num_axes
    assert_array_equal(before[n:], recording.scenario.surgeon.velocity)
    assert_array_equal(after, [*recording.scenario.surgeon.contact_force, *[0.0] * n])
    # The echo of the jump arrives at the slave exactly one forward delay later.
    before, after = sides(recording, "forward_packet_received", switch + 0.1)
    assert_array_equal(after[:n], recording.scenario.surgeon.contact_force)
    assert before[0] != after[0]


@pytest.mark.parametrize("kind", Slow(CONTROLLERS, but=[1]))
def test_mirror_image_elbows_give_mirror_image_runs(kind, subtests):
    down = Run("two_dof_combined", kind)
    up = Run("two_dof_combined", kind, "duration=2.8", "robot.elbow=up")
    times = np.linspace(0, 2.8, 561)[:-1]
    for name in ("tool_position", "tool_velocity", "control_force"):
        with subtests.test(name=name):
            mirror = up.Interpolate(name, times) * [1, -1]
            scale = np.ptp(down[name])
            assert np.abs(mirror - down.Interpolate(name, times)).max() < 1e-5 * scale


@pytest.mark.parametrize(
    "overrides",
    [
        # Without error control no shorter step is tried.
        {"controller.adaptation_rate": 1e8, "simulator.use_error_control": False},
        {
            f"environment.layers.{name}.stiffness": 1e9
            for name in ("tissue", "free", "bone")
        },
    ],
)
def test_numbers_that_leave_the_finite_end_the_recording(overrides):
    recording = simulate(
        LoadScenario(
            "two_dof_combined",
            {"controller.kind": ADAPTIVE, "duration": 0.3} | overrides,
        )
    )
    assert recording.termination == "diverged"
    # Without error control the reason suggests a shorter step.
    reasons = "Error control|numbers became.*max_step_size|the tool's speed"
    assert re.match(reasons, recording.reason)
    assert recording.time[-1] < 0.3
    for values in recording.signals.values():
        assert np.all(np.isfinite(values))


class Raising(DirectForce):
    """A control law whose telemetry raises an error after 50 ms."""

    def __init__(self, error):
        super().__init__(num_axes=1)
        self.set_name("my_law")
        self.DeclareVectorOutputPort(
            "telemetry", 1, self._CalcTelemetry, {self.time_ticket()}
        )
        self._error = error

    def _CalcTelemetry(self, context, output):
        if context.get_time() > 0.05:
            raise self._error


@pytest.mark.parametrize(
    "error",
    [
        KeyError("my own bug"),
        RuntimeError("TransportDelay 'x': evaluated 1 s after the last step"),
        # A violated contract of Drake does not end the interpreter.
        SystemExit("Failure at file.h:1 in SetPositions(): condition 'x' failed."),
        # A block may end the interpreter on purpose.
        SystemExit("that is enough"),
    ],
)
def test_errors_of_blocks_come_out_and_name_the_block(error):
    scenario = LoadScenario("one_dof", {"duration": 0.1})
    teleoperator = MakeTeleoperator(scenario, control_law=Raising(error))
    is_exit = isinstance(error, SystemExit) and str(error).startswith("Failure")
    block = "teleoperator::controller::my_law"
    with pytest.raises(RuntimeError if is_exit else type(error)) as raised:
        simulate(scenario, teleoperator=teleoperator)
    if is_exit:
        assert re.search(f"SetPositions.*{block}", str(raised.value))
    else:
        assert raised.value is error
        assert error.__notes__ == [f"(in the block {block})"]


def test_blow_up_ends_early():
    recording = Run("two_dof_puncture", DIRECT)
    assert recording.termination == "diverged"
    assert "exceeds 5 times the commanded speed" in recording.reason
    (puncture,) = recording.EventTimes("puncture")
    assert puncture < recording.time[-1] < recording.scenario.duration
    speed = np.linalg.norm(recording["tool_velocity"], axis=1)
    assert np.argmax(speed) == len(speed) - 1


def test_stop_ends_the_push():
    recording = Run(
        "two_dof_collision",
        ADAPTIVE,
        "surgeon.stop_time=4.5",
        "duration=7",
        engine="auto",
    )
    assert recording.EventTimes("surgeon_stop") == [4.5]
    before, after = sides(recording, "forward_packet_sent", 4.5)
    assert before[0] == 0.2
    assert np.all(after == 0)
    assert abs(recording["environment_force"][-1, 0]) < 0.02


@pytest.mark.parametrize(
    ("back", "forward"),
    [(0.05, 0.05), (0.3, 1 / 3)],
)
def test_echoes_that_nearly_coincide_do_not_stop_the_clock(forward, back):
    """Times of echoes that differ by rounding errors do not cause tiny steps."""
    delays = {"forward_channel.delay": forward, "return_channel.delay": back}
    scenario = LoadScenario("one_dof", delays | {"duration": 1.0})
    steps = []

    def watch(time):
        steps.append(time)
        assert len(steps) < 1000

    recording = simulate(scenario, progress=watch)
    assert recording.termination == "completed"
    assert len(recording.time) < 500


@pytest.mark.parametrize(
    ("name", "other", "message"),
    [
        ("two_dof_puncture", "one_dof", r"robot\.num_axes = 1: must be 2"),
        ("one_dof", "network_tracking_linear", "for one_dof, with .* environment"),
        ("network_tracking_linear", "one_dof", "for network_.*, with a system named"),
    ],
)
def test_diagram_of_another_task_is_refused(name, other, message):
    teleoperator = MakeDiagram(LoadScenario(other))
    with pytest.raises(ValueError, match=message):
        simulate(LoadScenario(name), teleoperator=teleoperator)


def test_more_steps_than_anyone_waits_for_are_refused():
    scenario = LoadScenario("one_dof", {"forward_channel.delay": 1e-6})
    with pytest.raises(ScenarioError, match="must be at most 1 s with forward_channel"):
        simulate(scenario)


@pytest.mark.slow
def test_progress_is_reported_in_order_and_once_in_a_period(monkeypatch):
    scenario = LoadScenario("one_dof", {"duration": 0.1})
    reports = []
    monkeypatch.setattr(drake_run, "_REPORT_PERIOD", 0.0)
    simulate(scenario, progress=reports.append, engine="drake")
    assert reports == sorted(reports)
    assert 0 <= reports[0] <= reports[-1] <= 0.1
    reports.clear()
    monkeypatch.setattr(drake_run, "_REPORT_PERIOD", 1000.0)
    simulate(scenario, progress=reports.append, engine="drake")
    assert reports == []


@pytest.mark.slow
def test_interrupt_waits_for_the_end_of_the_step(monkeypatch):
    """A KeyboardInterrupt in a callback of Drake would become another error."""
    scenario = LoadScenario("one_dof", {"duration": 0.3})
    law = AdaptiveBackstepping.DoCalcTimeDerivatives
    calls = 0

    def interrupt_once(self, context, derivatives):
        nonlocal calls
        calls += 1
        if calls == 100:
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                raise SystemError("returned a result with an exception set") from None
        law(self, context, derivatives)

    reference = Run("one_dof", ADAPTIVE, "duration=0.3", engine="drake")
    monkeypatch.setattr(AdaptiveBackstepping, "DoCalcTimeDerivatives", interrupt_once)
    recording = simulate(scenario, engine="drake")
    assert (recording.termination, recording.reason) == (
        "interrupted",
        "interrupted by the user",
    )
    assert 100 < calls < 110
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    num_samples = len(recording.time)
    assert_array_equal(recording.time, reference.time[:num_samples])
    assert_array_equal(
        recording["control_force"], reference["control_force"][:num_samples]
    )


@pytest.mark.slow
def test_interrupt_in_the_step_that_diverges(monkeypatch):
    """The interrupt takes precedence, so that it also ends a comparison of runs."""
    scenario = LoadScenario("one_dof", {"divergence_speed_ratio": 1.1})
    assert simulate(scenario).termination == "diverged"
    law = AdaptiveBackstepping.DoCalcTimeDerivatives
    limit = 1.1 * abs(scenario.surgeon.velocity[0])
    is_interrupted = False

    def interrupt_at_limit(self, context, derivatives):
        nonlocal is_interrupted
        v = self.GetInputPort("tool_velocity").Eval(context)
        if abs(v[0]) > limit and not is_interrupted:
            is_interrupted = True
            signal.raise_signal(signal.SIGINT)
        law(self, context, derivatives)

    monkeypatch.setattr(
        AdaptiveBackstepping, "DoCalcTimeDerivatives", interrupt_at_limit
    )
    assert simulate(scenario, engine="drake").termination == "interrupted"


def test_second_interrupt_does_not_wait(monkeypatch):
    def interrupt_twice(*arguments):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("the second one did not interrupt")

    law = (*AdaptiveBackstepping.law[:2], interrupt_twice)
    monkeypatch.setattr(AdaptiveBackstepping, "law", law)
    with pytest.raises(KeyboardInterrupt):  # No step is recorded yet.
        simulate(LoadScenario("one_dof"), engine="drake")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("handler", [signal.SIG_IGN, lambda number, frame: None])
def test_interrupts_that_are_handled_elsewhere(handler):
    scenario = LoadScenario("one_dof", {"duration": 0.05})
    previous = signal.signal(signal.SIGINT, handler)
    try:
        recording = simulate(
            scenario,
            progress=lambda time: signal.raise_signal(signal.SIGINT),
            engine="drake",
        )
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, previous)
    assert recording.termination == "completed"


def test_simulation_in_a_thread():
    scenario = LoadScenario("one_dof", {"duration": 0.2})
    with ThreadPoolExecutor() as threads:
        recording = threads.submit(simulate, scenario).result()
    assert recording.termination == "completed"


def test_invalid_scenario_is_refused_before_anything_runs():
    scenario = LoadScenario("one_dof")
    scenario.simulator.max_step_size = -0.2
    with pytest.raises(ScenarioError, match=r"simulator\.max_step_size"):
        simulate(scenario, progress=lambda time: pytest.fail("simulated"))


def test_save_and_load(tmp_path):
    recording = Run("one_dof", ADAPTIVE)
    path = tmp_path / "run.npz"
    recording.Save(path)
    loaded = LoadRecording(path)
    assert loaded.scenario == recording.scenario
    assert loaded.events == recording.events
    assert loaded.solver == recording.solver
    assert (loaded.termination, loaded.reason) == ("completed", "")
    assert_array_equal(loaded.time, recording.time)
    for name, values in recording.signals.items():
        assert_array_equal(loaded[name], values)
    assert [file.name for file in tmp_path.iterdir()] == ["run.npz"]


def test_save_leaves_nothing_half_written(tmp_path, monkeypatch):
    monkeypatch.setattr(
        np, "savez_compressed", lambda *_, **__: (_ for _ in ()).throw(OSError("full"))
    )
    with pytest.raises(OSError, match="full"):
        Run("one_dof", ADAPTIVE).Save(tmp_path / "run.npz")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OSError):
        Run("one_dof", ADAPTIVE).Save(tmp_path / "nowhere" / "run.npz")


def test_load_refuses_other_files(tmp_path):
    path = tmp_path / "other.npz"
    np.savez(path, x=np.zeros(3))
    with pytest.raises(ValueError, match="must be a recording of"):
        LoadRecording(path)


def test_spring_hit_peaks_at_v_sqrt_k_m():
    """Erratum 10: an undamped hit at 1 mm/s, the force on the tool withdrawn."""
    recording = Run("one_dof", DIRECT)
    contact = recording.EventTimes("contact")[0]
    release = recording.EventTimes("release")[0]
    times = np.linspace(contact, release, 2001)
    force = recording.Interpolate("environment_force", times)[:, 0]
    speed = recording.Interpolate("tool_velocity", times[:1])[0, 0]
    # The haptic force and the friction of the rail are small.
    assert force.max() == pytest.approx(speed * math.sqrt(150 * 0.5), rel=0.01)


@pytest.mark.slow
def test_a_run_leaves_no_samples_behind(monkeypatch):
    recorders = []

    class Recorder(drake_run.Recorder):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            recorders.append(weakref.ref(self))

    monkeypatch.setattr(drake_run, "Recorder", Recorder)
    simulate(LoadScenario("one_dof", {"duration": 0.1}), engine="drake")
    gc.collect()
    assert [recorder() for recorder in recorders] == [None]


def test_a_delay_too_short_for_drakes_simulator_is_refused():
    scenario = LoadScenario("one_dof", ["delay=1e-6", "duration=0.5"])
    message = r"duration = 0.5: must be at most 0.1 s .* forward_channel allows no step"
    with pytest.raises(ScenarioError, match=message):
        simulate(scenario, engine="drake")


@pytest.mark.mostly_slow
@pytest.mark.parametrize(("period", "is_told"), [(0.005, True), (0.05, False)])
def test_samples_too_dense_for_drakes_delays_are_told(period, is_told):
    """Sensors of 5 ms before a delay of 0.1 s: settling is off by 0.2 per cent.

    With an encoder of 10 ms and 1 mm it is 2.086 s instead of 2.211 s.
    """
    sampled = [f"sensor.force.sample_period={period}", "duration=0.02", "delay=0.1"]
    scenario = LoadScenario("two_dof_collision", sampled)
    notes = simulate(scenario, engine="drake").notes
    told = [note for note in notes if "takes no step between samples" in note]
    assert bool(told) == is_told
    assert all("where samples are quantised by several per cent" in x for x in told)
    assert simulate(scenario, engine="compiled").notes == []
