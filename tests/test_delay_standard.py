"""The delay standard: each reference by a second method, and the names of faults."""

import functools
import math

import numpy as np
import pytest
from benchmarks.delay_standard import signal_tasks, tasks
from benchmarks.delay_standard.by_steps import by_steps
from benchmarks.delay_standard.simulator import ANSWERS
from benchmarks.delay_standard.table import ADAPTERS, answers, verdict
from benchmarks.delay_standard.write_references import (
    FOLDER,
    faults_text,
    reference_text,
)
from grids import Slow
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import cumulative_simpson, solve_ivp

from teleop_drake.cli.main import main
from teleop_drake.cli.reference_runs import Compare, Names, ReadTable
from teleop_drake.model.scenario.yaml_text import ParseYaml

# A grid on which all jumps, delays and instants of the echoes are, s.
FINE = 0.0005


@functools.cache
def Columns(name):
    return ReadTable(FOLDER / f"{name}.csv").columns


def AssertSame(values, name, signal, tolerance):
    assert_allclose(values, Columns(name)[signal], rtol=0, atol=tolerance)


def AssertSameTable(path, expected):
    """Asserts equal notes and columns, and numbers equal but for rounding.

    The mathematical functions of two processors differ in the last bit, which can turn
    the twelfth digit, and an earlier one of what is left of larger numbers.
    """
    heads = [x for x in expected.splitlines() if x[0] in "#t"]
    assert path.read_text("utf-8").splitlines()[: len(heads)] == heads
    values, right = (
        np.loadtxt(lines, delimiter=",", skiprows=len(heads), ndmin=2)
        for lines in (path, expected.splitlines())
    )
    assert right.shape[1] == len(heads[-1].split(","))
    assert_allclose(values, right, rtol=1e-11, atol=1e-14)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", tasks.TASKS)
def test_a_file_is_what_its_closed_form_gives(name):
    expected = reference_text(name, tasks.TASKS[name]())
    AssertSameTable(FOLDER / f"{name}.csv", expected)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "name",
    Slow(
        list(tasks.TASKS),
        but=[i for i, x in enumerate(tasks.TASKS) if x not in ("delay_pd",)],
    ),
)
def test_the_wrong_answers_are_those_of_the_faults(name):
    expected = faults_text(name, tasks.TASKS[name]())
    AssertSameTable(FOLDER / "faults" / f"{name}.csv", expected)


# Echoes, by a buffer of whole numbers: what is read was written so many cells before.


def Buffered(signal, T, times, initial=0.0):
    """Returns a signal a delay later; T is a number, or a function of t, in s."""
    count = round(times[-1] / FINE) + 1
    written = [signal(k * FINE) for k in range(count)]
    result = []
    for t in times:
        now = round(t / FINE)
        late = round((T(t) if callable(T) else T) / FINE)
        result.append(written[now - late] if now >= late else initial)
    return result


def Jump(instant):
    return lambda t: float(round(t / FINE) >= round(instant / FINE))


def Saw(t):
    return 0.05 + 0.5 * math.fmod(t + 0.005 + 1e-12, 0.2)


ECHOES = [
    ("delay_echo", "ramp_echo", lambda t: t, 0.1),
    ("delay_echo", "step_echo", Jump(0.105), 0.1),
    ("delay_vector", "position_echo", lambda t: math.sin(5 * t), 0.1),
    ("delay_vector", "velocity_echo", lambda t: 2 * math.sin(2.5 * t) ** 2, 0.1),
    ("delay_vector", "force_echo", lambda t: t, 0.1),
    ("delay_half_step", "ramp_echo", lambda t: t, 0.025),
    ("delay_half_step", "step_echo", Jump(0.103), 0.025),
    ("delay_short", "ramp_echo", lambda t: t, 0.004),
    ("delay_sawtooth", "ramp_echo", lambda t: t, Saw),
    ("delay_tie", "direct", Jump(0.105), 0.29),
    ("delay_tie", "chain", Jump(0.105 + 0.14), 0.15),
    ("delay_switch", "first", lambda t: 1 + t, 0.1),
    ("delay_switch", "second", lambda t: 1 + t, 0.03),
    ("delay_switch", "third", lambda t: 1 + t, 0.1),
]


@pytest.mark.parametrize(("name", "column", "signal", "T"), ECHOES)
def test_an_echo_is_what_a_buffer_of_whole_numbers_gives(name, column, signal, T):
    times = Columns(name)["time"]
    AssertSame(Buffered(signal, T, times), name, column, 1e-12)


def test_two_paths_that_tie_leave_no_area():
    columns = Columns("delay_tie")
    assert_array_equal(columns["direct"], columns["chain"])
    assert not columns["area"].any()


# Loops, by the method of steps with DOP853.


@pytest.mark.parametrize(
    ("name", "k", "T"), [("delay_decay", 1.0, 1.0), ("delay_short", 20.0, 0.004)]
)
def test_a_scalar_loop_is_what_the_method_of_steps_gives(name, k, T):
    times = Columns(name)["time"]
    x = by_steps(lambda t, now, late: -k * late[0], [T], [1.0], times[-1] + T)
    AssertSame([x(t)[0] for t in times], name, "x", 1e-11)


@pytest.mark.slow
def test_the_pd_loops_are_what_the_method_of_steps_gives():
    """Each force is that of a controller that saw x 0.1 s ago.

    An actuator receives nothing before its delay, 0.1 s or 0.04 s, has passed.
    """

    def force(x, v):
        return 4 * (1 - x) - 2 * v

    def rate(t, now, late):
        whole = late[0]
        by_sensor = force(whole[0], whole[1])
        by_actuator = force(whole[2], whole[3]) if t > 0.1 else 0.0
        by_both = force(whole[4], whole[5]) if t > 0.04 else 0.0
        return [now[1], by_sensor, now[3], by_actuator, now[5], by_both]

    # Pieces of 0.02 s end at both switches.
    x = by_steps(rate, [0.1, 0.02], [0.0] * 6, 4.1)
    times = Columns("delay_pd")["time"]
    values = np.array([x(t) for t in times])
    for column, name in enumerate(("x_sensor", "x_actuator", "x_both")):
        AssertSame(values[:, 2 * column], "delay_pd", name, 1e-11)


def test_the_loop_has_roots_on_the_axis_at_the_critical_delay():
    """By the eigenvalues of the delay's generator, collocated at Chebyshev's points."""
    critical = Columns("delay_oscillation")["critical_delay"][0]
    frequency = Columns("delay_oscillation")["frequency"][0]

    def rightmost(T):
        n = 24
        nodes = np.cos(np.pi * np.arange(n + 1) / n)
        weights = np.r_[2, np.ones(n - 1), 2] * (-1) ** np.arange(n + 1)
        gaps = nodes[:, np.newaxis] - nodes + np.eye(n + 1)
        D = np.outer(weights, 1 / weights) / gaps
        D -= np.diag(D.sum(axis=1))
        generator = np.kron(D * 2 / T, np.eye(2))
        generator[:2] = 0.0
        generator[:2, :2] = [[0, 1], [0, 0]]
        generator[:2, -2:] = [[0, 0], [-4, -2]]
        roots = np.linalg.eigvals(generator)
        return roots[roots.real.argmax()]

    root = rightmost(critical)
    assert abs(root.real) < 1e-9
    assert abs(root.imag) == pytest.approx(frequency, abs=1e-9)
    assert rightmost(critical * 0.999).real < 0 < rightmost(critical * 1.001).real


def test_the_bounce_is_what_scipy_finds_between_events():
    """Pieces end at impacts and at their echoes; each is solved by DOP853."""
    late = 0.3
    times = Columns("delay_bounce")["time"]
    pieces = [(-math.inf, lambda t: np.array([1.0, 0.0]))]

    def covering(t):
        return next(x for start, x in reversed(pieces) if start <= t)

    def hit(t, x):
        return x[0]

    hit.terminal = True
    hit.direction = -1
    start = 0.0
    state = np.array([1.0, 0.0])
    breaks = [late]
    while start < times[-1]:
        end = min([t for t in breaks if t > start + 1e-9] + [1.5])
        past = covering(start - late + 1e-9)
        solution = solve_ivp(
            lambda t, x, past=past: [x[1], -9.81 - 0.5 * past(t - late)[1]],
            (start, end),
            state,
            method="DOP853",
            events=hit,
            dense_output=True,
            rtol=1e-13,
            atol=1e-13,
        )
        pieces.append((start, solution.sol))
        start = solution.t[-1]
        state = solution.y[:, -1]
        breaks.append(start + late)
        if solution.status == 1:
            state = np.array([0.0, -0.8 * state[1]])
    values = np.array([covering(t)(t) for t in times])
    felt = [covering(t - 0.15)(t - 0.15)[1] for t in times]
    AssertSame(values[:, 0], "delay_bounce", "height", 1e-10)
    AssertSame(values[:, 1], "delay_bounce", "velocity", 1e-10)
    AssertSame(felt, "delay_bounce", "felt", 1e-10)


# Packets, by a clock of milliseconds that looks into the mail at each tick.


def test_delays_that_are_signals_are_what_other_methods_find():
    """The state by Heun's method; the conveyor by the integral of its velocity."""
    times = Columns("delay_signal")["time"]
    sent = times - 0.12 - 0.08 * np.cos(20 * times)
    AssertSame(np.sin(3 * np.maximum(sent, 0)), "delay_signal", "late", 1e-11)
    x = np.array(signal_tasks._state_loop(lambda T: T, 1.0))
    AssertSame(x[100::100][:60], "delay_state", "x", 1e-6)
    columns = Columns("delay_conveyor")
    for time, entered in zip(columns["time"], columns["entered"], strict=True):
        grid = np.linspace(entered, time, 2001)
        speed = 0.5 + np.sin(2 * grid)
        gone = cumulative_simpson(speed[::-1], x=-grid[::-1], initial=0)
        assert (gone[1:-1] < 0.3 + 1e-9).all()
        if entered > 0:
            assert gone[-1] == pytest.approx(0.3, abs=1e-9)


def test_the_sampled_loop_is_what_a_recursion_gives():
    x = [1.0, 1.0 - 4 * 0.06]
    for _ in range(19):
        x.append(x[-1] - 4 * (0.04 * x[-2] + 0.06 * x[-1]))
    columns = Columns("delay_sampled")
    at_samples = np.arange(4, 100, 5)
    assert_allclose(columns["time"][at_samples], np.arange(1, 21) / 10)
    assert_allclose(columns["x"][at_samples], x[1:], atol=1e-11)


def test_packets_are_what_a_clock_finds():
    mail = {}
    for k in range(26):
        mail.setdefault(20 * k + 15 + 20 * (7 * k % 5), []).append(k + 1)
    shown = 0
    values = {}
    for now in range(501):
        shown = max([shown, *mail.get(now, [])])
        values[now] = shown
    times = Columns("delay_packets")["time"]
    AssertSame([values[round(1000 * t)] for t in times], "delay_packets", "shown", 0)


def test_a_stale_command_is_what_a_clock_finds():
    mail = {20 * k + 55: 1 + k % 3 for k in range(40) if not 10 <= k <= 24}
    command = 0.0
    remaining = 0
    travel = 0.0
    commands = {}
    travels = {}
    for now in range(801):
        travels[now] = travel
        if now in mail:
            command = mail[now]
            remaining = 100
        if remaining == 0:
            command = 0.0
        remaining -= remaining > 0
        commands[now] = command
        travel += 0.001 * command
    name = "delay_stale_command"
    instants = [round(1000 * t) for t in Columns(name)["time"]]
    AssertSame([commands[t] for t in instants], name, "command", 0)
    AssertSame([travels[t] for t in instants], name, "travel", 1e-12)


# The command names faults.


def Wrong():
    """Returns (task, signal, fault) of all wrong answers."""
    found = []
    for name in tasks.TASKS:
        for column in ReadTable(FOLDER / "faults" / f"{name}.csv").columns:
            signal, _, fault = column.partition(":")
            if fault:
                found.append((name, signal, fault))
    return found


def Check(name, columns, tmp_path, capsys, step=None):
    lines = [f"# reference: {name}"]
    lines += [f"# step: {step}"] * (step is not None)
    lines += [",".join(columns)]
    rows = zip(*columns.values(), strict=True)
    lines += [",".join(f"{x:.12g}" for x in row) for row in rows]
    path = tmp_path / "own.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    code = main(["check", str(path)])
    return code, capsys.readouterr()


def Texts():
    return ParseYaml((FOLDER / "faults.yaml").read_text("utf-8"), "faults")


@pytest.mark.mostly_slow
@pytest.mark.parametrize(("name", "signal", "fault"), Wrong())
def test_a_fault_is_named(name, signal, fault, tmp_path, capsys):
    wrong = ReadTable(FOLDER / "faults" / f"{name}.csv").columns[f"{signal}:{fault}"]
    columns = Columns(name) | {signal: wrong}
    # In some loops only the step tells Euler's method from a longer delay.
    step = 0.001 if fault.endswith("euler") else None
    code, (printed, _) = Check(name, columns, tmp_path, capsys, step)
    assert code == 1
    assert f"{signal} is {Named(fault)}" in printed


def Named(fault, seconds="0.001", direction="longer"):
    """Returns a fault in words; its size is that of the files unless given."""
    fault, _, order = fault.partition(":")
    steps = f"{float(seconds) / 0.01:.2g}"
    return Texts()[fault].format(
        seconds=seconds, steps=steps, direction=direction, order=order
    )


def test_each_fault_that_is_written_is_described_and_used():
    assert {fault.partition(":")[0] for *_, fault in Wrong()} == set(Texts())
    half = {name for name, _, fault in Wrong() if fault == "half_delay"}
    assert half == set(tasks.TASKS)


# Small integrators that commit one fault each.


def EulerScalar(k, T, h, times):
    """x' = -k x(t - T), x = 1 before, by Euler's explicit method."""
    x = [1.0]
    for n in range(round(times[-1] / h)):
        late = n - round(T / h)
        x.append(x[n] - h * k * (x[late] if late > 0 else 1.0))
    return np.array(x)[np.round(times / h).astype(int)]


def EulerMass(h, times, *, is_semi_implicit):
    """x_sensor of delay_pd by the explicit or the semi-implicit Euler method."""
    late = round(0.1 / h)
    x, v = np.zeros((2, round(times[-1] / h) + 1))
    for n in range(len(x) - 1):
        i = n - late
        v[n + 1] = v[n] + h * (4 - (4 * x[i] + 2 * v[i] if i >= 0 else 0.0))
        x[n + 1] = x[n] + h * (v[n + 1] if is_semi_implicit else v[n])
    return x[np.round(times / h).astype(int)]


@pytest.mark.parametrize("h", [0.002, 0.0005])
@pytest.mark.parametrize(
    ("name", "signal", "fault"),
    [
        ("delay_decay", "x", "explicit_euler"),
        ("delay_pd", "x_sensor", "explicit_euler"),
        ("delay_pd", "x_sensor", "semi_implicit_euler"),
    ],
)
def test_the_method_of_euler_is_named_with_its_step(
    name, signal, fault, h, tmp_path, capsys
):
    times = Columns(name)["time"]
    if name == "delay_decay":
        wrong = EulerScalar(1.0, 1.0, h, times)
    else:
        wrong = EulerMass(h, times, is_semi_implicit=fault.startswith("semi"))
    columns = Columns(name) | {signal: wrong}
    stated = Check(name, columns, tmp_path, capsys, step=h)[1].out
    assert f"{signal} is {Named(fault, f'{h:g}')}" in stated
    untold = Check(name, columns, tmp_path, capsys)[1].out
    # x' = -x(t - 1) is by Euler's method what it is with a delay h/2 longer.
    right = (
        Named(fault, f"{h:g}")
        if name == "delay_pd"
        else Named("delay_error", f"{h / 2:g}")
    )
    assert f"{signal} is {right}" in untold


def test_a_step_that_does_not_fit_is_no_excuse(tmp_path, capsys):
    columns = Columns("delay_decay") | {
        "x": EulerScalar(1.0, 1.0, 0.002, Columns("delay_decay")["time"])
    }
    printed = Check("delay_decay", columns, tmp_path, capsys, step=0.0005)[1].out
    assert f"x is {Named('delay_error', '0.001')}" in printed
    code, (_, error) = Check("delay_decay", columns, tmp_path, capsys, step="h")
    assert (code, "# step: h: must be > 0 (s)" in error) == (2, True)


def test_a_delay_by_pade_is_named(tmp_path, capsys):
    """Of order 2: y'' + 6 y'/T + 12 y/T^2 = u'' - 6 u'/T + 12 u/T^2."""
    T = 0.1
    times = Columns("delay_echo")["time"]

    def rate(t, z):
        return [z[1], t - 12 / T**2 * z[0] - 6 / T * z[1]]

    z = solve_ivp(rate, (0, times[-1]), [0, 0], t_eval=times, rtol=1e-10, atol=1e-13).y
    ramp = times - 12 / T * z[1]
    columns = Columns("delay_echo") | {"ramp_echo": ramp}
    printed = Check("delay_echo", columns, tmp_path, capsys)[1].out
    assert f"ramp_echo is {Named('pade:2')}" in printed


@pytest.mark.parametrize("name", ["delay_packets", "delay_stale_command"])
def test_packets_that_travel_for_half_of_their_time_are_named(name, tmp_path, capsys):
    times = Columns(name)["time"]
    shown = []
    for t in times + 1e-9:
        sent = [k for k in range(int(t / 0.02) + 1) if Arrival(name, k) <= t]
        newest = max(sent, default=None)
        if name == "delay_packets":
            shown.append(0 if newest is None else min(newest, 25) + 1)
        else:
            is_fresh = newest is not None and t < Arrival(name, newest) + 0.1
            shown.append(1 + newest % 3 if is_fresh else 0)
    signal = "shown" if name == "delay_packets" else "command"
    columns = Columns(name) | {signal: np.array(shown, float)}
    printed = Check(name, columns, tmp_path, capsys)[1].out
    assert f"{signal} is {Named('half_delay')}" in printed


def Arrival(name, k):
    """Returns when packet k arrives if it travels for half of its time, s."""
    if name == "delay_packets":
        return 0.02 * k + (0.015 + 0.02 * (7 * k % 5)) / 2 if k < 26 else math.inf
    return math.inf if 10 <= k < 25 else 0.02 * k + 0.0275


# Simulators. Those that have to be installed for it are measured by the benchmark.

OFFERED = {
    "compiled": set(tasks.TASKS),
    "drake": set(tasks.TASKS),
    "discrete": {
        *("delay_echo", "delay_vector", "delay_half_step", "delay_decay"),
        "delay_bounce",
    },
    "ring_buffer": {
        *("delay_echo", "delay_vector", "delay_decay", "delay_tie", "delay_switch"),
        *("delay_packets", "delay_stale_command"),
    },
}
RUNS = [(key, name) for key, names in OFFERED.items() for name in sorted(names)]


@pytest.mark.parametrize(
    ("key", "name"),
    Slow(RUNS, but=[i for i, (key, _) in enumerate(RUNS) if key == "compiled"]),
)
def test_a_simulator_is_inside(key, name):
    run = answers(ADAPTERS[key].make(), name)
    found = Compare(name, run, name)
    assert all(difference.is_inside for difference in found.values()), found


def test_the_error_of_a_task_is_the_largest_of_all_signals(monkeypatch):
    """Not that of the signal which uses most of its tube, here the height."""
    exact = ReadTable(FOLDER / "delay_bounce.csv").columns
    errors = {"height": 1.6e-5, "velocity": 4.6e-5, "felt": 0.0}
    wrong = np.stack([exact[name] + error for name, error in errors.items()], axis=1)
    monkeypatch.setitem(ANSWERS, "delay_bounce", lambda simulator, times: wrong)
    assert verdict(None, "delay_bounce") == "inside, 5e-05"


@pytest.mark.parametrize(
    ("key", "name", "signal", "fault"),
    [
        ("discrete", "delay_tie", "chain", "one_step_late"),
        ("ring_buffer", "delay_half_step", "ramp_echo", "rounded_down"),
        ("ring_buffer", "delay_sawtooth", "ramp_echo", "rounded"),
    ],
)
def test_the_fault_of_a_simulator_is_named(key, name, signal, fault):
    """Two of Drake's DiscreteTimeDelays in series are a step longer; see its docs."""
    found = Compare(name, answers(ADAPTERS[key].make(), name), name)
    assert found[signal].fault == Texts()[fault]


# Bad input of the delay tasks.


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.2,", "0.2001,", "time = 0.2 s: must be there"),
        ("0.2,", "0.1,", "time: must ascend"),
        ("ramp_echo", "ramp", "must have 'ramp_echo'; the header that --template"),
    ],
)
def test_a_file_that_cannot_be_compared(old, new, message, tmp_path, capsys):
    text = (FOLDER / "delay_echo.csv").read_text("utf-8")
    (tmp_path / "own.csv").write_text(text.replace(old, new, 1), "utf-8")
    assert main(["check", str(tmp_path / "own.csv")]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_the_last_row_of_an_instant_counts(tmp_path, capsys):
    """A recording with both sides of a jump has two rows of one instant."""
    columns = {name: np.repeat(x, 2) for name, x in Columns("delay_echo").items()}
    columns["step_echo"][::2] = -1.0
    code, (printed, _) = Check("delay_echo", columns, tmp_path, capsys)
    assert code == 0, printed


@pytest.mark.parametrize("name", ["delay_echo", "delay_sawtooth", "delay_switch"])
def test_single_precision_is_inside(name, tmp_path, capsys):
    """Of a simulator that adds up its clock, and computes the ramp from that."""
    columns = dict(Columns(name))
    steps = np.round(columns["time"] / 0.01).astype(int)
    clock = np.cumsum(np.full(steps[-1], 0.01, np.float32), dtype=np.float32)
    drift = clock[steps - 1] - columns["time"]
    assert np.abs(drift).max() > 1e-7
    for signal, values in columns.items():
        if name != "delay_echo" or signal != "step_echo":
            columns[signal] = np.where(values == 0, values, values + drift)
    code, (printed, _) = Check(name, columns, tmp_path, capsys)
    assert code == 0, printed


def test_an_error_of_another_form_has_no_name(tmp_path, capsys):
    columns = dict(Columns("delay_vector"))
    columns["force_echo"] = columns["force_echo"] ** 2
    code, (printed, _) = Check("delay_vector", columns, tmp_path, capsys)
    assert code == 1
    assert "force_echo is" not in printed


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", Names())
def test_a_template_that_is_filled_in_is_inside(name, tmp_path, capsys):
    assert main(["check", "--template", name]) == 0
    comment, header, *rows = capsys.readouterr().out.splitlines()
    assert set("".join(row.partition(",")[2] for row in rows)) <= {","}
    folder = FOLDER if name in tasks.TASKS else FOLDER.parent
    right = ReadTable(folder / f"{name}.csv").columns
    lines = [comment, header]
    for row, values in zip(rows, zip(*right.values(), strict=True), strict=True):
        instant, empty = row.split(",", 1)
        assert empty.count(",") == len(values) - 2
        lines.append(",".join([instant, *(f"{x:.12g}" for x in values[1:])]))
    (tmp_path / "own.csv").write_text("\n".join(lines), "utf-8")
    assert main(["check", str(tmp_path / "own.csv")]) == 0


@pytest.mark.parametrize("name", Names())
def test_each_reference_is_listed_and_shown(name, capsys):
    assert main(["check", "--list"]) == 0
    (line,) = [
        x for x in capsys.readouterr().out.splitlines() if x.startswith(f"{name} ")
    ]
    title = line.removeprefix(name).strip()
    assert main(["check", "--show", name]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f"{name}: {title}\n\n")
    # The columns of a delay task are named in its words.
    if name in tasks.TASKS:
        assert all(x in shown for x in Columns(name) if x != "time")
