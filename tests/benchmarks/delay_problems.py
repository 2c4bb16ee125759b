"""Error against CPU time on published problems, beside JiTCDDE and PathSim.

With --peers it draws teleop_drake/docs/work_precision.png.
"""

import contextlib
import math
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.measuring import Options, Table
from test_published_delay_problems import (
    LINEAR,
    NONLINEAR,
    BySteps,
    Exact,
    MakeDiagram,
    Solver,
)

from teleop_drake import Compile

FIGURE = Path(__file__).parents[2] / "teleop_drake" / "docs" / "work_precision.png"
LIMIT = "Paul 1.1.1, at the limit of stability"
# Behind its jumps' third echo all of them are compared, at so many times.
ECHOES = 3
NUM_TIMES = 40
# For so long calls are repeated, s; times the number of repeats.
_LEAST_TIME = 0.05


def limit(x, late):
    """Paul's equation with its gain at the limit of stability."""
    return -math.pi / 2 * late


# The law, T, the history, and until when.
PROBLEMS = {LIMIT: (limit, 1.0, [1.0], LINEAR[LIMIT][-1]), **NONLINEAR}


class Package:
    """Compile() of a diagram, once for each accuracy, and Run() of that."""

    name = "teleop-drake, compiled"
    style = ("#0072B2", "o")
    settings = tuple(10.0**-k for k in range(3, 13))

    def __init__(self, law, T, history):
        self._diagram = MakeDiagram(law, [T], history, history)
        self._T = T
        self._programs: dict[float, Any] = {}

    def __call__(self, setting: float, times: np.ndarray) -> np.ndarray:
        if setting not in self._programs:
            solver = Solver(setting, self._T)
            self._programs[setting] = Compile(
                self._diagram, duration=times[-1], simulator=solver
            )
        return self._programs[setting].Run().Interpolate("x", times)


class Jitcdde:
    """JiTCDDE, stepping on what becomes of the jump at the start."""

    name = "JiTCDDE"
    style = ("#D55E00", "s")
    settings = tuple(10.0**-k for k in range(3, 11))

    def __init__(self, law, T, history):
        from jitcdde import jitcdde, t, y

        self._T = T
        self._history = history
        n = len(history)
        times = ((), (t - T,))
        now, late = (np.array([y(i, *at) for i in range(n)], object) for at in times)
        self._dde = jitcdde(list(law(now, late)), delays=[0, T], verbose=False)
        # Away from any pyproject.toml, which its build would read.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            self._dde.compile_C(simplify=False)

    def __call__(self, setting: float, times: np.ndarray) -> np.ndarray:
        dde = self._dde
        dde.purge_past()
        dde.constant_past(self._history, time=0.0)
        dde.set_integration_parameters(rtol=setting, atol=setting, min_step=1e-12)
        for _ in range(ECHOES):  # Each lands on the next echo.
            dde.step_on_discontinuities()
        with warnings.catch_warnings():  # It says that steps are longer than these.
            warnings.filterwarnings("ignore", "The target time is smaller")
            return np.array([dde.integrate(t) for t in times])


class PathSim:
    """PathSim's Delay, whose signal before 0 is 0: the state is less the history.

    The Delay interpolates straight lines, so the longest step decides.
    """

    name = "PathSim, RKDP54"
    style = ("#009E73", "^")
    settings = (1 / 10, 1 / 30, 1 / 100, 1 / 300, 1 / 1000)

    def __init__(self, law, T, history):
        self._law = law
        self._T = T
        self._history = np.array(history)

    def __call__(self, setting: float, times: np.ndarray) -> np.ndarray:
        from pathsim import Connection, Simulation
        from pathsim.blocks import ODE, Delay
        from pathsim.solvers import RKDP54

        h = self._history
        plant = ODE(lambda x, u, t: np.ravel(self._law(x + h, u + h)), 0 * h)
        delay = Delay(self._T)
        n = len(h)
        loop = [Connection(plant[:n], delay[:n]), Connection(delay[:n], plant[:n])]
        step = setting * self._T
        simulation = Simulation(
            [plant, delay],
            loop,
            dt=step / 10,
            dt_max=step,
            Solver=RKDP54,
            tolerance_lte_abs=1e-10,
            tolerance_lte_rel=1e-8,
            log=False,
        )
        rows = []
        now = 0.0
        for t in times:
            simulation.run(t - now, reset=False)
            now = simulation.time
            assert abs(now - t) < 1e-9 * t, "It ends where it was told to."
            rows.append(plant.engine.state + h)
        return np.array(rows)


def Reference(name: str, times: np.ndarray) -> np.ndarray:
    """Returns the solution, from its closed form or scipy's method of steps."""
    if name in LINEAR:
        return Exact(*LINEAR[name][:3], times)[:, np.newaxis]
    law, T, history, _ = PROBLEMS[name]
    return BySteps(law, T, history, times)


def Measure(options: Options) -> Iterator[Table]:
    """Yields a table for each problem."""
    peers: list[Any] = [Jitcdde, PathSim] if options.peers else []
    found = {}
    for name in list(PROBLEMS)[: 1 if options.quick else None]:
        law, T, history, end = PROBLEMS[name]
        times = np.linspace(ECHOES * T, end, NUM_TIMES + 2)[1:-1]
        expected = Reference(name, times)
        rows = []
        for kind in [Package, *peers]:
            solve = kind(law, T, history)
            for setting in kind.settings[: 3 if options.quick else None]:
                cpu, values = CpuTime(lambda: solve(setting, times), options.repeats)  # noqa: B023
                error = float(np.abs(values - expected).max() / np.ptp(expected))
                row = {"contender": kind.name, "setting": setting, "CPU s": cpu}
                rows.append(row | {"error": error})
        found[name] = rows
        note = (
            "CPU time of one process, of the fastest of several runs, without "
            "compiling; PathSim builds its problem each time. The error is the "
            "largest, as a share of the solution's range. The setting is the "
            "tolerance, of PathSim the longest step as a share of the delay."
        )
        yield Table(title=name, note=note, rows=rows)
    if peers and not options.quick:
        Draw(found)


def CpuTime(call: Callable[[], np.ndarray], repeats: int) -> tuple[float, np.ndarray]:
    """Returns the CPU time in s of the fastest call, and what it returns.

    Short calls are repeated for a while, as the fastest of few may still be a slow one.
    """
    values = call()  # The first one may compile.
    taken: list[float] = []
    while len(taken) < repeats or sum(taken) < repeats * _LEAST_TIME:
        start = time.process_time()
        values = call()
        taken.append(time.process_time() - start)
    return min(taken), values


def Draw(found: dict[str, list[dict[str, Any]]]) -> None:
    """Draws error against CPU time, a panel for each problem."""
    import matplotlib.pyplot as plt

    size = {"figsize": (7.2, 2.9), "layout": "constrained", "sharey": True}
    figure, panels = plt.subplots(1, len(found), **size)
    for axes, (name, rows) in zip(panels, found.items(), strict=True):
        for kind in (Package, Jitcdde, PathSim):
            color, marker = kind.style
            own = [row for row in rows if row["contender"] == kind.name]
            x, y = ([row[key] for row in own] for key in ("CPU s", "error"))
            axes.loglog(x, y, marker, ls="-", color=color, ms=4, lw=1, label=kind.name)
        axes.set_title(name.replace(", ", ",\n", 1), fontsize=8)
        axes.set_xlabel("CPU time (s)", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.3, lw=0.5)
    panels[0].set_ylabel("largest error / range (1)", fontsize=8)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, fontsize=8)
    figure.savefig(FIGURE, dpi=150)
    plt.close(figure)
