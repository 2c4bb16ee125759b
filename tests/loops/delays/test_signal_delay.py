"""Delays that are signals, against closed forms and an independent method of steps."""

import numpy as np
import pytest
from engines import Compiled, InWebAssembly
from numpy.testing import assert_allclose
from pydrake.systems.analysis import SimulatorConfig
from signal_delays import Conveyor, Entered, Loop, Roots, Source, Square, TimeDelay

from teleop_drake.loops import ScenarioError, VariableDelay, simulate
from teleop_drake.loops.delays.conveyor import VariableTransportDelay

ROOT_2 = np.sqrt(2.0)
TIMES = np.linspace(0.013, 5.89, 590)

# Times T(t): of any slope, through 0, shorter than a step.
DELAYS = {
    "slow": lambda t: 0.5 + 0.4 * np.sin(2 * t),
    "overtaking": lambda t: 0.6 + 0.4 * np.sin(5 * t),
    "through 0": lambda t: 0.3 * (1 + np.cos(t)),
    "short": lambda t: 1e-3 + 0 * t,
}

# Velocities of a conveyor, and the distances that it has travelled.
CONVEYORS = {
    "forward": (lambda t: 1 + 0.5 * np.sin(2 * t), lambda t: t + np.sin(t) ** 2 / 2),
    "reverses": (lambda t: 0.5 + np.sin(2 * t), lambda t: t / 2 + np.sin(t) ** 2),
    "flushes": (
        lambda t: 0.3 + 2 * np.sin(2 * t),
        lambda t: 0.3 * t + 2 * np.sin(t) ** 2,
    ),
}


def wave(t):
    return np.sin(3 * t)


def flat(t):
    """A square wave of period 0.8 s."""
    return np.where(np.floor(t / 0.4) % 2 == 0, 1.0, -1.0)


def AsSource(function):
    return Source(lambda t: np.array([function(t)]))


def Error(run, name, exact, times=TIMES):
    return np.abs(run.Interpolate(name, times)[:, 0] - exact).max()


def test_state_dependent_delay_with_a_closed_form(engine="compiled", within=1e-12):
    """A. Feldstein and K. W. Neves (1984): sqrt(t) until t = 2, where it bends."""
    diagram, context = Loop(
        lambda t, late: late / (2 * np.sqrt(t)),
        lambda t, x: t - x + ROOT_2 - 1,
        (1.0, 1.0),
        maximum_delay=9.0,
    )
    run = simulate(diagram, context=context, duration=3.5, engine=engine)
    times = np.linspace(1.0, 4.5, 300)
    later = times / 4 + 0.5 + (1 - ROOT_2 / 2) * np.sqrt(times)
    exact = np.where(times < 2, np.sqrt(times), later)
    assert Error(run, "x", exact, times) < within


@pytest.mark.slow
def test_state_dependent_delay_in_drake():
    test_state_dependent_delay_with_a_closed_form("drake", 1e-10)


def MethodOfSteps(end, step):
    """Solves x' = -x(t - 2 - x^2) + 5, x = 6 before, by RK4 and cubic polynomials."""
    number = round(end / step)
    x = np.full(number + 1, 6.0)
    rates = np.zeros(number + 1)

    def rate(t, value):
        s = t - 2 - value**2
        if s <= 0:
            return 5.0 - 6.0
        k = int(s / step)
        a = s / step - k
        line = (1 - a) * x[k] + a * x[k + 1]
        bend = x[k + 1] - x[k]
        first = (1 - a) * (rates[k] * step - bend)
        last = a * (bend - rates[k + 1] * step)
        return 5.0 - (line + a * (1 - a) * (first + last))

    rates[0] = rate(0.0, x[0])
    for k in range(number):
        t = k * step
        second = rate(t + step / 2, x[k] + step / 2 * rates[k])
        third = rate(t + step / 2, x[k] + step / 2 * second)
        fourth = rate(t + step, x[k] + step * third)
        x[k + 1] = x[k] + step / 6 * (rates[k] + 2 * second + 2 * third + fourth)
        rates[k + 1] = rate(t + step, x[k + 1])
    return x


def test_state_dependent_delay_by_a_method_of_steps():
    diagram, context = Loop(
        lambda t, late: 5.0 - late,
        lambda t, x: 2 + x**2,
        (0.0, 6.0),
        maximum_delay=50.0,
    )
    run = simulate(diagram, context=context, duration=8.0)
    exact = MethodOfSteps(8.0, 2.5e-4)
    assert Error(run, "x", exact, np.linspace(0.0, 8.0, len(exact))) < 1e-8
    # The same problem in two runs.
    first = simulate(diagram, context=context, duration=5.3)
    rest = simulate(diagram, context=first.final_context, duration=2.7)
    assert rest["x"][-1] == pytest.approx(run["x"][-1], abs=1e-8)


@pytest.mark.parametrize("name", DELAYS)
def test_smooth_signal_through_a_time(name, engine="compiled", within=1e-9):
    delay = DELAYS[name]
    diagram = TimeDelay(AsSource(wave), AsSource(delay))
    run = simulate(diagram, duration=6.0, engine=engine)
    sent = TIMES - delay(TIMES)
    assert Error(run, "out", np.where(sent > 0, wave(sent), 0.0)) < within


@pytest.mark.parametrize("name", DELAYS)
def test_jumps_through_a_time(name, engine="compiled", within=1e-11):
    """Each jump is delivered sharply when t - T(t) passes it, in any direction."""
    delay = DELAYS[name]
    diagram = TimeDelay(Square(0.8), AsSource(delay))
    run = simulate(diagram, duration=6.0, engine=engine)
    sent = TIMES - delay(TIMES)
    assert Error(run, "out", np.where(sent > 0, flat(sent), 0.0)) < 1e-12
    out = run["out"][:, 0]
    jumps = run.time[1:][(abs(np.diff(out)) > 0.5) & (np.diff(run.time) == 0)]
    expected = sorted(
        root
        for k in range(16)
        for root in Roots(lambda t, k=k: t - delay(t) - 0.4 * k, 1e-5, 5.99)
    )
    jumps = jumps[jumps < 5.99]
    assert len(jumps) == len(expected)
    assert_allclose(jumps, expected, rtol=0, atol=within)


@pytest.mark.slow
@pytest.mark.parametrize("name", DELAYS)
def test_a_time_in_drake(name):
    test_smooth_signal_through_a_time(name, "drake", 1e-7)
    test_jumps_through_a_time(name, "drake", 1e-8)


def test_a_time_that_jumps_and_one_of_zero():
    """T is 1.1 s, 0.3 s and 0 s in turn; the wave and its jumps pass at once at 0 s."""
    for delays in ((0.3, 1.1), (0.0, 0.7)):
        delay = np.where(np.floor(TIMES / 0.5) % 2 == 0, delays[1], delays[0])
        sent = TIMES - delay
        for signal, block in ((wave, AsSource(wave)), (flat, Square(0.8))):
            run = simulate(TimeDelay(block, Square(1.0, delays)), duration=6.0)
            exact = np.where(sent >= 0, signal(sent), 0.0)
            assert Error(run, "out", exact) < 1e-9


@pytest.mark.parametrize("name", CONVEYORS)
@pytest.mark.parametrize("length", [0.7, 0.002])
def test_conveyor(name, length, engine="compiled", within=2e-6):
    """What leaves has entered when the distance was less by the length, the last time.

    Where the conveyor has turned, the output is a root of time; the values at the ends
    of steps are as exact as elsewhere.
    """
    velocity, distance = CONVEYORS[name]
    diagram = Conveyor(AsSource(wave), AsSource(velocity), length)
    run = simulate(diagram, duration=6.0, engine=engine)
    entered = Entered(distance, length, TIMES)
    exact = np.where(np.isnan(entered), 0.0, wave(np.nan_to_num(entered)))
    error = abs(run.Interpolate("out", TIMES)[:, 0] - exact)
    assert error.max() < within
    assert np.median(error) < 1e-11


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "diagram",
    [
        TimeDelay(Square(0.8), AsSource(DELAYS["overtaking"])),
        Conveyor(AsSource(wave), AsSource(CONVEYORS["reverses"][0]), 0.7),
    ],
    ids=["time", "conveyor"],
)
def test_a_run_goes_on(diagram):
    """The jumps and turns of the first part are passed in the second one."""
    whole = simulate(diagram, duration=6.0)
    first = simulate(diagram, duration=2.9)
    rest = simulate(diagram, context=first.final_context, duration=3.1)
    times = TIMES[TIMES > 2.9]
    expected = whole.Interpolate("out", times)[:, 0]
    assert Error(rest, "out", expected, times) < 2e-6


@pytest.mark.slow
def test_conveyor_in_drake():
    test_conveyor("reverses", 0.7, "drake", 1e-3)


def test_conveyor_that_stands():
    """It moves for 0.5 s, stands for 0.5 s, and so on, so that the output waits."""
    diagram = Conveyor(AsSource(wave), Square(1.0, (0.0, 1.0)), 0.8)
    run = simulate(diagram, duration=6.0)
    moved = np.floor(TIMES) / 2 + np.minimum(TIMES % 1.0, 0.5)
    level = moved - 0.8
    entered = np.floor(level / 0.5) + level % 0.5
    assert Error(run, "out", np.where(level > 0, wave(entered), 0.0)) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "diagram",
    [
        lambda: TimeDelay(Square(0.8), AsSource(DELAYS["through 0"])),
        lambda: Conveyor(AsSource(wave), AsSource(CONVEYORS["reverses"][0]), 0.7),
    ],
    ids=["time", "conveyor"],
)
def test_page(diagram):
    config = SimulatorConfig(accuracy=1e-8, max_step_size=0.02)
    times = np.linspace(0.05, 5.0, 100)
    page = InWebAssembly(diagram(), config, times)
    native = Compiled(diagram(), config, times, as_machine_code=True)
    for name, values in native.items():
        assert_allclose(page[name], values, rtol=0, atol=1e-12)


@pytest.mark.parametrize("engine", ["compiled", "drake"])
@pytest.mark.parametrize("delay", [lambda t: 0.3 - t, lambda t: 0.1 + t])
def test_a_time_outside_of_its_range_is_refused(engine, delay):
    diagram = TimeDelay(AsSource(wave), AsSource(delay), maximum_delay=0.5)
    with pytest.raises(ScenarioError, match=r"out\.delay = .* must be 0 to 0\.5 s"):
        simulate(diagram, duration=0.6, engine=engine)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: VariableDelay(size=1), "maximum_delay"),
        (lambda: VariableDelay(size=1, maximum_delay=0.0), "maximum_delay"),
        (lambda: VariableDelay(size=1, maximum_delay=np.inf), "maximum_delay"),
        (lambda: VariableTransportDelay(length=0.0), "length"),
        (lambda: VariableTransportDelay(1.0, 2, [1.0]), "initial_value"),
    ],
)
def test_wrong_arguments(make, field):
    with pytest.raises(ScenarioError, match=field):
        make()
