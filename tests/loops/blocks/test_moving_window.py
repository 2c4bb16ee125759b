"""The moving window against closed forms, quadrature and chains of lags."""

import math
from itertools import pairwise

import numpy as np
import pytest
from engines import Compiled, Errors, InWebAssembly
from numpy.testing import assert_allclose
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.primitives import Gain, Integrator, LinearSystem, Sine
from pydrake.trajectories import PiecewisePolynomial
from wired import Wired

from teleop_drake.loops import (
    LinearizePorts,
    MovingWindow,
    NamedParameters,
    ScenarioError,
    simulate,
)
from teleop_drake.loops.kernel import FixedBlock, Kernel, Transition

T = 0.5
HOLD = PiecewisePolynomial.ZeroOrderHold
LINES = PiecewisePolynomial.FirstOrderHold
WEIGHTS = {
    "triangle": LINES([0.0, T], [[4.0 / T, 0.0]]),
    "tent": LINES([0.0, 0.2, T], [[0.0, 4.0, 0.0]]),
    "steps": HOLD([0.0, 0.1, 0.3, T], [[2.0, -1.0, 3.0, 0.0]]),
    "late": HOLD([0.2, T], [[3.0, 0.0]]),
    "cubic": PiecewisePolynomial.CubicShapePreserving(
        [0.0, 0.1, 0.3, T], [[1.0, 2.0, 0.5, 0.0]]
    ),
}


def bent(time, mode):
    """A vector of two polynomials of the time, times 1, from JUMP on times 2."""
    return np.array([1.0 + time - time**2, time**3 - 0.5]) * mode[0]


JUMP = 0.3


def doubled(mode):
    return 2.0 * mode


def source():
    """Returns a source of bent() that jumps, by an unrestricted update."""
    kernel = Kernel(
        outputs={"u": (bent, "time", "mode")},
        transitions={"jump": Transition(mode=(doubled, "mode"), offset=JUMP)},
    )
    return FixedBlock("source", kernel, inputs={}, outputs={"u": 2}, mode=[1.0])


def u_at(time, start, before):
    """Returns the signal of source(), `before` before the start."""
    if time < start:
        return np.array(before)
    return bent(time, [1.0 if time < JUMP else 2.0])


def right(weights, time, start, before):
    """Returns the integral of w(s) u(time - s) ds by Gauss, exact for polynomials."""
    nodes, factors = np.polynomial.legendre.leggauss(6)
    breaks = [time - JUMP, time - start, *weights.get_segment_times()]
    first = weights.start_time()
    inside = sorted({x for x in breaks if first <= x <= weights.end_time()})
    total = np.zeros(2)
    for a, b in pairwise(inside):
        for node, factor in zip(nodes, factors, strict=True):
            s = (a + b) / 2 + node * (b - a) / 2
            w = weights.value(s)[0, 0] * factor * (b - a) / 2
            total += w * u_at(time - s, start, before)
    return total


def behind(block, window):
    """Returns a Diagram of a window behind a source; it exports the window's output."""
    source = f"source.{block.get_output_port(0).get_name()}"
    return Wired(
        {"source": block, "window": window}, {"window": source}, {"y": "window"}
    )


def check(recording, weights, *, start=0.0, before=(0.0, 0.0), atol=1e-9):
    times = np.linspace(recording.time[0], recording.time[-1], 37)[1:-1] + 1e-5
    expected = [right(weights, time, start, before) for time in times]
    assert_allclose(recording.Interpolate("y", times), expected, atol=atol)


@pytest.mark.parametrize("name", WEIGHTS)
def test_a_window_is_exact_behind_polynomials_and_jumps(name):
    diagram = behind(source(), MovingWindow(WEIGHTS[name], 2))
    recording = simulate(diagram, duration=1.2)
    assert recording.solver.engine == "compiled"
    check(recording, WEIGHTS[name])


@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_an_average_is_the_integral_over_the_window(engine):
    diagram = behind(source(), MovingWindow(T, 2, [0.7, -0.2]))
    recording = simulate(diagram, duration=0.9, engine=engine)
    assert recording.solver.engine == engine
    average = HOLD([0.0, T], [[1.0 / T, 0.0]])
    check(recording, average, before=(0.7, -0.2), atol=1e-7)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("latter", ["drake", "compiled"])
def test_two_halves_of_a_run_that_begins_later_are_the_whole(latter):
    diagram = behind(source(), MovingWindow(T, 2))
    context = diagram.CreateDefaultContext()
    context.SetTime(0.1)
    first = simulate(diagram, context=context, duration=0.45)
    second = simulate(diagram, context=first.final_context, duration=0.4, engine=latter)
    average = HOLD([0.0, T], [[1.0 / T, 0.0]])
    for part in (first, second):
        check(part, average, start=0.1, atol=1e-7)


def test_a_constant_signal_is_its_own_average_for_a_long_time():
    """The integral of the signal, 1e4, would have lost digits."""
    config = SimulatorConfig(
        integration_scheme="runge_kutta5", use_error_control=True, max_step_size=0.4
    )
    one = FixedBlock(
        "one", Kernel(outputs={"u": "mode"}), inputs={}, outputs={"u": 1}, mode=[1.0]
    )
    diagram = behind(one, MovingWindow(T, 1, [1.0]))
    recording = simulate(diagram, duration=1e4, simulator=config)
    assert np.abs(recording["y"] - 1.0).max() < 1e-12


def erlang(num_pieces):
    """Returns the weights of three lags of 0.1 s up to 1.6 s, as a cubic spline."""
    breaks = np.linspace(0.0, 1.6, num_pieces + 1)
    values = 1e3 / 2 * breaks**2 * np.exp(-10.0 * breaks)
    slopes = 1e3 / 2 * (2 * breaks - 10.0 * breaks**2) * np.exp(-10.0 * breaks)
    return PiecewisePolynomial.CubicHermite(breaks, values[None], slopes[None])


def test_the_weights_of_a_chain_of_lags_give_its_output():
    """The linear chain trick: y = 1/(0.1 s + 1)^3 u; the spline is of order 4."""
    lag = -10.0 * (np.eye(3) - np.eye(3, k=-1))
    enters = np.array([[10.0], [0.0], [0.0]])
    leaves = np.array([[0.0, 0.0, 1.0]])
    chain = LinearSystem(lag, enters, leaves, np.zeros((1, 1)))
    times = np.linspace(0.01, 3.0, 300)
    expected = simulate(behind(Sine(1.0, 4.0, 0.3, 1), chain), duration=3.0)
    errors = []
    for num_pieces in (8, 16):
        window = MovingWindow(erlang(num_pieces), 1)
        found = simulate(behind(Sine(1.0, 4.0, 0.3, 1), window), duration=3.0)
        difference = found.Interpolate("y", times) - expected.Interpolate("y", times)
        errors.append(np.abs(difference).max())
    assert errors[1] < 5e-3
    assert errors[0] / errors[1] > 10


def average_loop(gain):
    """Returns x' = -gain times the average of x over T, which begins at 1."""
    return Wired(
        {
            "plant": Integrator([1.0]),
            "window": MovingWindow(T, 1, [1.0]),
            "back": Gain(-gain, 1),
        },
        {"window": "plant", "back": "window", "plant": "back"},
        {"x": "plant"},
    )


@pytest.mark.parametrize(("factor", "is_growing"), [(0.97, False), (1.03, True)])
def test_a_loop_with_an_average_has_the_known_boundary(factor, is_growing):
    """s^2 T + gain (1 - e^(-s T)) = 0 has s = j pi/T where gain T = pi^2/2."""
    recording = simulate(average_loop(factor * math.pi**2 / 2 / T), duration=20.0)
    x = np.abs(recording["x"][:, 0])
    early = x[(recording.time > 4.0) & (recording.time < 8.0)].max()
    late = x[recording.time > 16.0].max()
    assert (late > early) == is_growing


def test_a_linear_model_has_the_response_of_the_window():
    diagram = average_loop(1.0)
    context = diagram.CreateDefaultContext()
    context.SetContinuousState(np.zeros(context.num_continuous_states()))
    window = diagram.GetSubsystemByName("window")
    model = LinearizePorts(
        diagram,
        context,
        window.get_input_port(),
        window.get_output_port(),
        is_opened=True,
        is_settled=True,
    )
    s = 1j * np.array([0.3, 2.0, 11.0])
    expected = (1.0 - np.exp(-s * T)) / (s * T)
    assert_allclose(model.Response(s.imag)[:, 0, 0], expected, rtol=1e-10)


def test_a_window_runs_in_a_page():
    diagram = behind(Sine(1.0, 6.0, 0.2, 1), MovingWindow(WEIGHTS["tent"], 1))
    config = SimulatorConfig(max_step_size=0.01, accuracy=1e-9)
    times = np.array([0.15, 0.4, 0.9])
    native = Compiled(diagram, config, times, as_machine_code=True)
    assert max(Errors(InWebAssembly(diagram, config, times), native).values()) < 1e-9
    assert NamedParameters(MovingWindow(T, 1)) == {}


@pytest.mark.parametrize(
    ("window", "message"),
    [
        (0.0, r"^window = 0.0: must be a finite number >= 1e-06 \(s\)"),
        (math.inf, "^window = inf: must be a finite number >= 1e-06"),
        (PiecewisePolynomial(), "^window = 'weights of 0 x 0': must be weights of 1 x"),
        (LINES([0, 1], np.eye(2)), "^window = 'weights of 2 x 1': must be weights of"),
        (LINES([-1, 1], [[1, 1]]), "^window = 'weights from -1 s on': must be from an"),
        (HOLD([0, 1e-9, 1], [[1, 1, 1]]), "^window = 'a break at 1e-09 s': must be br"),
        (
            PiecewisePolynomial.LagrangeInterpolatingPolynomial(
                [0.0, 0.2, 0.5, 0.7, 1.0], [[0.0, 1.0, 0.0, 3.0, 1.0]]
            ),
            "^window = 'weights of degree 4': must be of degree <= 3",
        ),
    ],
)
def test_a_window_that_is_none_is_refused(window, message):
    with pytest.raises(ScenarioError, match=message):
        MovingWindow(window, 1)


def test_the_value_before_the_start_has_the_size_of_the_signal():
    with pytest.raises(ScenarioError, match=r"^initial_value = \[1.0\]: must be 2 num"):
        MovingWindow(T, 2, [1.0])
