"""Error against CPU time where a delay depends on the state, beside JiTCDDE."""

import contextlib
import tempfile
import warnings
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from benchmarks.delay_problems import CpuTime
from benchmarks.measuring import Options, Table
from pydrake.systems.analysis import SimulatorConfig
from signal_delays import Loop

from teleop_drake import Compile

ROOT_2 = np.sqrt(2.0)


class Problem(NamedTuple):
    """x' = rate(t, x(t - T)), T = delay(t, x) <= longest, x = start until 0.

    The functions take numbers and arrays, or JiTCDDE's symbols.
    """

    rate: Callable[..., Any]
    delay: Callable[..., Any]
    start: float
    end: float
    longest: float


PROBLEMS = {
    "Feldstein and Neves, until 3.5 s": Problem(
        lambda t, late: late / (2 * (1 + t) ** 0.5),
        lambda t, x: t - x + ROOT_2,
        start=1.0,
        end=3.5,
        longest=9.0,
    ),
    "x' = 5 - x(t - 2 - x^2), until 8 s": Problem(
        lambda t, late: 5.0 - late,
        lambda t, x: 2 + x * x,
        start=6.0,
        end=8.0,
        longest=50.0,
    ),
}


class Package:
    """A run of a compiled diagram, for each accuracy."""

    name = "teleop-drake, compiled"
    settings = tuple(10.0**-k for k in range(3, 12, 2))

    def __init__(self, problem: Problem):
        self._problem = problem
        self._programs: dict[float, Any] = {}

    def __call__(self, setting: float, times: np.ndarray) -> np.ndarray:
        if setting not in self._programs:
            rate, delay, start, end, longest = self._problem
            diagram, _ = Loop(rate, delay, (0.0, start), maximum_delay=longest)
            solver = SimulatorConfig(
                integration_scheme="runge_kutta5", accuracy=setting, max_step_size=1.0
            )
            self._programs[setting] = Compile(diagram, duration=end, simulator=solver)
        return self._programs[setting].Run().Interpolate("x", times)[:, 0]


class Jitcdde:
    """JiTCDDE, whose delay is an expression of the state."""

    name = "JiTCDDE"
    settings = tuple(10.0**-k for k in range(3, 12, 2))

    def __init__(self, problem: Problem):
        from jitcdde import jitcdde, t, y

        self._start = problem.start
        late = y(0, t - problem.delay(t, y(0)))
        self._dde = jitcdde(
            [problem.rate(t, late)], max_delay=problem.longest, verbose=False
        )
        # Away from any pyproject.toml, which its build would read.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            self._dde.compile_C(simplify=False)

    def __call__(self, setting: float, times: np.ndarray) -> np.ndarray:
        dde = self._dde
        dde.purge_past()
        dde.constant_past([self._start], time=0.0)
        dde.set_integration_parameters(
            rtol=setting, atol=setting, min_step=1e-13, first_step=1e-4
        )
        # Where its jumps arrive depends on the state: it cannot step on them.
        dde.adjust_diff()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The target time is smaller")
            return np.array([dde.integrate(t)[0] for t in times])


def Exact(name: str, times: np.ndarray) -> np.ndarray:
    """Returns the solution in closed form, or by the method of steps."""
    if name.startswith("Feldstein"):
        t = 1 + times
        later = t / 4 + 0.5 + (1 - ROOT_2 / 2) * np.sqrt(t)
        return np.where(t < 2, np.sqrt(t), later)
    from loops.delays.test_signal_delay import MethodOfSteps

    end = PROBLEMS[name].end
    x = MethodOfSteps(end, 1.25e-4)
    return x[np.round(times / 1.25e-4).astype(int)]


def Measure(options: Options) -> Iterator[Table]:
    """Yields a table for each problem."""
    kinds: list[Any] = [Package, *([Jitcdde] if options.peers else [])]
    for name, problem in PROBLEMS.items():
        times = np.arange(1, 41) * problem.end / 40
        expected = Exact(name, times)
        rows = []
        for kind in kinds:
            solve = kind(problem)
            for setting in kind.settings[: 2 if options.quick else None]:
                cpu, values = CpuTime(lambda: solve(setting, times), options.repeats)  # noqa: B023
                error = float(np.abs(values - expected).max() / np.ptp(expected))
                row = {"contender": kind.name, "setting": setting}
                rows.append(row | {"CPU s": cpu, "error": error})
        note = (
            "CPU time of the fastest of several runs, without compiling. The error is "
            "the largest, as a share of the solution's range; the setting is the "
            "tolerance. The method of steps has errors of 1e-9."
        )
        yield Table(title=name, note=note, rows=rows)
