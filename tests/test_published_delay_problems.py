"""Published problems with delays, as diagrams, against closed forms and scipy.

* Of DDETST (Enright and Hayashi, 1997): A1, A2, B2.
* Of SciML's DDEProblemLibrary: those with one and with two constant delays.
* Of Paul (1994), equation 1.1.1: x' = b x(t - T) from a constant.
"""

import math
from functools import partial

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Integrator
from scipy.integrate import solve_ivp

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.kernel import Delay, FixedBlock, Kernel, Transition
from teleop_drake.model.run.simulate import simulate


def MakeDiagram(law, lags, start, history):
    """Returns x' = law(x, the x(t - T) of lags T one behind another)."""
    builder = DiagramBuilder()
    n = len(start)
    size = n * len(lags)
    late = [(f"late_{i}", 0, n) for i in range(len(lags))]
    inputs = {"x": n} | {name: n for name, *_ in late}
    kernel = Kernel(
        outputs={"rate": (law, "x", "late"), "late": late}, sizes={"late": size}
    )
    block = FixedBlock("law", kernel, inputs=inputs, outputs={"rate": n})
    builder.AddSystem(block)
    plant = builder.AddNamedSystem("plant", Integrator(start))
    builder.Connect(block.get_output_port(), plant.get_input_port())
    builder.Connect(plant.get_output_port(), block.GetInputPort("x"))
    for i, T in enumerate(lags):
        delay = TransportDelay(
            delay=T, size=n, initial_value=history, max_sample_interval=math.inf
        )
        builder.AddNamedSystem(f"delay_{i}", delay)
        builder.Connect(plant.get_output_port(), delay.get_input_port())
        builder.Connect(delay.get_output_port(), block.GetInputPort(f"late_{i}"))
    builder.ExportOutput(plant.get_output_port(), "x")
    return builder.Build()


def Solver(accuracy, max_step):
    return SimulatorConfig(
        integration_scheme="runge_kutta5", accuracy=accuracy, max_step_size=max_step
    )


def Run(law, lags, start, history, duration, engine, accuracy, max_step):
    """Simulates MakeDiagram()."""
    diagram = MakeDiagram(law, lags, start, history)
    config = Solver(accuracy, max_step)
    run = simulate(diagram, duration=duration, engine=engine, simulator=config)
    assert run.solver.engine == engine
    return run


# Linear ones: x' = a x + the sum of b x(t - T), x(0) = 1, x = history before.


def Linear(a, terms, history, *rest):
    lags = [T for _, T in terms]
    gains = np.array([b for b, _ in terms])
    return Run(lambda x, late: a * x + gains @ late, lags, [1.0], [history], *rest)


def Response(a, terms, t, order=0):
    """Returns the response to an impulse, or its integral, without history.

    Its Laplace transform is 1 / (s - a - the sum of b exp(-s T)), a geometric series in
    b exp(-s T) / (s - a). For a = 0 it can be integrated as easily.
    """
    assert a == 0 or order == 0
    (b, T), (c, S) = [*terms, (0.0, math.inf)][:2]
    result = np.zeros_like(t)
    for j in range(math.ceil(t.max() / T) + 1):
        for k in range(math.ceil(t.max() / S) + 1):
            gone = t - (j * T + (k * S if k else 0.0))
            n = j + k
            x = np.where(gone >= 0, gone, 0.0) ** (n + order) * np.exp(a * gone)
            scale = math.comb(n, k) * b**j * c**k / math.factorial(n + order)
            result += np.where(gone >= 0, scale * x, 0.0)
    return result


def Exact(a, terms, history, t):
    """Returns x(t). A history of 1 acts until each delay has passed; then a = 0."""
    x = Response(a, terms, t)
    for b, T in terms if history else ():
        integral = partial(Response, a, terms, order=1)
        x += b * history * (integral(t) - integral(t - T))
    return x


LINEAR = {
    "SciML, one delay": (0.0, [(-1.0, 1.0)], 0.0, 10.0),
    "SciML, one delay, long": (1.0, [(-1.0, 0.2)], 0.0, 2.0),
    "SciML, two delays": (0.0, [(-1.0, 1 / 3), (-1.0, 0.2)], 0.0, 1.0),
    "SciML, two delays, long": (0.0, [(-1.0, 1 / 3), (-1.0, 0.2)], 0.0, 3.0),
    "Paul 1.1.1": (0.0, [(-1.0, 1.0)], 1.0, 5.0),
    "Paul 1.1.1, growing": (0.0, [(1.0, 1.0)], 1.0, 3.0),
    "Paul 1.1.1, at the limit of stability": (0.0, [(-math.pi / 2, 1.0)], 1.0, 6.0),
}


ENGINES = {"compiled": 2e-8, "drake": 1e-6}


@pytest.mark.parametrize(
    ("name", "engine"),
    Slow([(x, y) for y in ENGINES for x in LINEAR], but=range(len(LINEAR))),
)
def test_a_linear_problem_has_its_closed_form(name, engine):
    a, terms, history, duration = LINEAR[name]
    run = Linear(a, terms, history, duration, engine, 1e-9, 0.05)
    exact = Exact(a, terms, history, run.time)
    assert_allclose(run["x"][:, 0], exact, rtol=0, atol=ENGINES[engine])
    # The jumps of the delayed signal and what becomes of them end steps.
    echoes = (1, 2, 3) if engine == "compiled" else (1,)
    if history == 0:
        assert all(
            np.abs(run.time - j * T).min() < 1e-9 for _, T in terms for j in echoes
        )


@pytest.mark.parametrize("history", [0.0, 1.0])
def test_the_order_of_the_method_holds_across_echoes(history):
    """A step half as long has an error 2^5 times as small, behind jumps and bends.

    In machine code. Drake's Simulator ends no step at an echo that bends a signal only.
    """
    problem = (0.0, [(-9.0, 0.21)], history)
    errors = []
    for step in (0.07, 0.035, 0.0175):
        # Error control accepts every step: all but the first are the longest.
        run = Linear(*problem, 1.9, "compiled", 0.1, step)
        errors.append(np.abs(run["x"][:, 0] - Exact(*problem, run.time)).max())
    assert (np.log2(np.divide(errors[:-1], errors[1:])) > 4.7).all(), errors


# Others: x' = f(x, x(t - T)), with a constant history.


def blood(x, late):
    return 0.2 * late / (1 + late**10) - 0.1 * x


def leukemia(x, late):
    flow = 10 * x[0] / (1 + 40 * x[1])
    gain = 1.1 / (1 + np.sqrt(10.0) * late[0] ** 1.25)
    return np.array([gain - flow, 10 * flow - 2.43 * x[1]])


# The law, T, the history, and until when.
NONLINEAR = {
    "DDETST A1": (blood, 14.0, [0.5], 100.0),
    "DDETST A2": (leukemia, 20.0, [1.05767027 / 3, 1.030713491 / 3], 100.0),
}


def BySteps(law, T, history, times):
    """Returns x at times by the method of steps: DOP853, an interval of T at a time."""
    pieces = [lambda t: np.array(history)]
    x = history
    for k in range(math.ceil(times[-1] / T)):
        solution = solve_ivp(
            lambda t, y, late=pieces[-1]: law(y, late(t - T)),
            *((k * T, (k + 1) * T), x, "DOP853"),
            dense_output=True,
            rtol=1e-13,
            atol=1e-13,
            max_step=0.1,
        )
        pieces.append(solution.sol)
        x = solution.y[:, -1]
    return np.array([pieces[int(t / T) + 1](t) for t in times])


@pytest.mark.slow  # The reference takes as long as it does.
@pytest.mark.parametrize("engine", ["compiled", "drake"])
@pytest.mark.parametrize("name", NONLINEAR)
def test_a_problem_without_closed_form_has_the_solution_of_scipy(name, engine):
    law, T, history, duration = NONLINEAR[name]
    run = Run(law, [T], history, history, duration, engine, 1e-10, 0.5)
    times = np.linspace(0.5, duration - 0.1, 60)
    expected = BySteps(law, T, history, times)
    error = np.abs(run.Interpolate("x", times) - expected).max()
    assert error < {"compiled": 1e-7, "drake": 1e-6}[engine]


# DDETST B2: x' = 1 - x where x(t/2) < 0, else -1 - x; x(0) = 1, until 2 ln 66.


@pytest.mark.parametrize("engine", Slow(list(ENGINES), but=[0]))
def test_a_delay_that_grows_as_time_does(engine):
    """DDETST B2. T(t) = t/2 is less than 0.1 s only where x(t/2) > 0 either way."""
    builder = DiagramBuilder()
    # m is less the sign of what is late.
    turns = Transition(
        guard=(lambda mode, late: mode * late, "mode", "late"),
        mode=(lambda mode: -mode, "mode"),
    )
    law = Kernel(
        rate=(lambda mode, x: mode - x, "mode", "state"),
        outputs={"x": "state"},
        transitions={"turns": turns},
    )
    plant = FixedBlock("plant", law, inputs={"late": 1}, outputs={"x": 1}, state=[1.0])
    plant.DeclareDiscreteState([-1.0])
    builder.AddSystem(plant)
    end = 2 * math.log(66)
    delay = Delay(
        signal="x",
        output="late",
        initial_value=[1.0],
        time=lambda t: max(t / 2, 0.1),
        shortest=0.1,
        nonsmooth_times=[0.2],
        end=end,
        max_sample_interval=math.inf,
    )
    kernel = Kernel(delays=[delay])
    late = FixedBlock("half", kernel, inputs={"x": 1}, outputs={"late": 1})
    builder.AddSystem(late)
    builder.Connect(plant.get_output_port(), late.get_input_port())
    builder.Connect(late.get_output_port(), plant.get_input_port())
    builder.ExportOutput(plant.get_output_port(), "x")
    run = simulate(builder.Build(), duration=end, engine=engine)
    assert run.solver.engine == engine
    t = run.time
    first = 2 * math.log(2)
    second = 2 * math.log(6)
    scale = np.where(t < first, 2.0, np.where(t < second, -6.0, 66.0))
    level = np.where((t < first) | (t >= second), -1.0, 1.0)
    exact = scale * np.exp(-t) + level
    assert_allclose(run["x"][:, 0], exact, rtol=0, atol=1e-5)
    turns = t[1:][np.diff(t) == 0]
    assert np.abs(turns[:, np.newaxis] - [first, second]).min(axis=0).max() < 1e-5
