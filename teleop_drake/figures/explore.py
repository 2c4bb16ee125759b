"""Sliders over the numbers of a scenario: turn one, and see what the loop does."""

import functools
import importlib
import io
import time as clock
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from teleop_drake.figures.runs import PlotComparison, PlotRun
from teleop_drake.figures.saving import DescribeFigure
from teleop_drake.figures.style import AxisLabel
from teleop_drake.recording import Recording
from teleop_drake.scenario import LoadScenario, ScenarioError
from teleop_drake.scenario.tree import GetPath, ToTree
from teleop_drake.simulation import simulate
from teleop_drake.simulation.compiled_run import WhyNotCompiled
from teleop_drake.sweep import ALIASES
from teleop_drake.tasks import TaskOf
from teleop_drake.validation import Refuse

# Steps of a slider that has none of its own.
_NUM_STEPS = 50
_DPI = 90


class Explorer:
    """Sliders and the figure of the runs at their values; a notebook shows both.

    Explore() makes one. Without the package ipywidgets a notebook shows the figure at
    the scenario's own values.

    Attributes:
        engine: What simulates, see simulate().
        values: What is varied, and the value it has now.
        sliders: The slider of each; none without ipywidgets.
        picture: The picture, an ipywidgets.Image; None without ipywidgets.
        status: A line below it, an ipywidgets.Label; None without ipywidgets.
    """

    def __init__(
        self,
        scenario: str | Path,
        overrides: Mapping[str, Any],
        ranges: Mapping[str, Sequence[float]],
        controllers: Sequence[str] | None,
        engine: str,
        plot_options: Mapping[str, Any],
    ):
        base = LoadScenario(scenario, overrides)
        self._name = scenario
        self._overrides = dict(overrides)
        if controllers is None:
            controllers = TaskOf(base).controllers
        self._controllers = list(controllers)
        self.engine = engine
        self._plot_options = dict(plot_options)
        self._ranges = {key: _Options(key, x) for key, x in ranges.items()}
        if not self._ranges:
            Refuse("ranges", {}, "one number or more, each with a range")
        self._runs: dict[tuple[Any, ...], Recording] = {}
        self.values = {
            key: _Nearest(options, _OwnValue(base, key))
            for key, options in self._ranges.items()
        }
        # Whatever is wrong with a range is found here, not when a slider is there.
        for key, options in self._ranges.items():
            for value in (options[0], options[-1]):
                LoadScenario(scenario, self._Overrides({**self.values, key: value}))
        self.sliders: dict[str, Any] = {}
        self.picture: Any = None
        self.status: Any = None
        try:
            widgets = importlib.import_module("ipywidgets")
        except ImportError:
            return
        self._MakeWidgets(widgets)

    def _Overrides(self, values: Mapping[str, float], kind: str = "") -> dict[str, Any]:
        """Returns the overrides of a run."""
        varied = {
            path: value
            for key, value in values.items()
            for path in ALIASES.get(key, (key,))
        }
        chosen = {"controller.kind": kind} if kind else {}
        return {**self._overrides, **chosen, **varied}

    def Runs(self) -> dict[str, Recording]:
        """Returns the runs at the values of now, by the names of their controllers.

        Each is simulated once.

        Raises:
            ScenarioError: If the values are not allowed together.
        """
        runs = {}
        for kind in self._controllers or [""]:
            key = (kind, *self.values.values())
            if key not in self._runs:
                scenario = LoadScenario(self._name, self._Overrides(self.values, kind))
                self._runs[key] = simulate(scenario, engine=self.engine)
            runs[kind.replace("_", " ")] = self._runs[key]
        return runs

    def Plot(self) -> Figure:
        """Returns the figure of the runs at the values of now.

        Raises:
            ScenarioError: If the values are not allowed together.
        """
        runs = self.Runs()
        if not self._controllers:
            return PlotRun(next(iter(runs.values())), **self._plot_options)
        return PlotComparison(runs, **self._plot_options)

    def _MakeWidgets(self, widgets: Any) -> None:
        """Makes the sliders and the picture."""
        base = LoadScenario(self._name, self._overrides)
        is_fast = self.engine != "drake" and not WhyNotCompiled(base)
        for key, options in self._ranges.items():
            slider = widgets.SelectionSlider(
                options=[(f"{value:g}", value) for value in options],
                value=self.values[key],
                description=AxisLabel(key),
                continuous_update=is_fast,
                style={"description_width": "initial"},
                layout={"width": "40em"},
            )
            slider.observe(functools.partial(self._Turn, key), "value")
            self.sliders[key] = slider
        self.status = widgets.Label()
        self.picture = widgets.Image(format="png")
        self._widget = widgets.VBox([*self.sliders.values(), self.status, self.picture])
        self._Redraw()

    def _Turn(self, key: str, change: Mapping[str, Any]) -> None:
        """Shows another value of a number."""
        self.values[key] = change["new"]
        self._Redraw()

    def _Redraw(self) -> None:
        """Draws the runs at the values of now, or says why there are none."""
        start = clock.perf_counter()
        try:
            figure = self.Plot()
        except ScenarioError as e:
            self.status.value = str(e)
            return
        self.picture.value = _Png(figure)
        self.picture.alt = DescribeFigure(figure)
        seconds = clock.perf_counter() - start
        self.status.value = f"simulated and drawn in {seconds:.2f} s"

    def _ipython_display_(self) -> None:
        """Shows the sliders and the picture in a notebook, or the picture alone."""
        display = importlib.import_module("IPython.display")
        if self.picture is not None:
            display.display(self._widget)
        else:
            figure = self.Plot()
            description = DescribeFigure(figure)
            display.display(display.Image(_Png(figure), alt=description))


def Explore(
    scenario: str | Path,
    overrides: Mapping[str, Any] | None = None,
    *,
    controllers: Sequence[str] | None = None,
    signals: Sequence[str] | None = None,
    time: tuple[float, float] | None = None,
    engine: str = "auto",
    **ranges: Sequence[float],
) -> Explorer:
    """Returns sliders over any numbers of a scenario, with a figure of what comes out.

    For instance

        Explore("one_dof", delay=(0, 0.5))
        Explore("one_dof", **{"environment.layers.bone.stiffness": (50, 400)})

    When a slider is released every controller is simulated with the new value, and
    what PlotComparison() makes of the runs is shown. Runs that can be machine code are
    shown while it is dragged.

    Args:
        scenario: A built-in name or a YAML file.
        overrides: Other values for all runs, for instance a shorter `duration` or a
            larger `simulator.accuracy`, which make the sliders fast.
        controllers: Kinds of controllers; None: those that the task compares.
        signals: What is shown, see PlotComparison(); None: all that the task shows.
        time: From when to when is shown, s; None: all of it.
        engine: What simulates, see simulate().
        **ranges: By the dotted name of a number, or `delay`, `forward_delay`,
            `return_delay` or `seed`: its least and its largest value, and a step if it
            is not to be a 50th of the range; or a list of the values.

    Raises:
        ScenarioError: If a number is not in the scenario, or a value is not allowed.
    """
    plot_options = {"signals": signals, "time": time}
    return Explorer(
        scenario, overrides or {}, ranges, controllers, engine, plot_options
    )


def _Options(key: str, values: Sequence[float]) -> list[float]:
    """Returns the values of a slider."""
    allowed = "(least, largest) or (least, largest, step), or a list of numbers"
    try:
        numbers = [float(value) for value in values]
    except (TypeError, ValueError):
        Refuse(key, values, allowed)
    if isinstance(values, list):
        if not numbers:
            Refuse(key, values, allowed)
        return numbers
    if len(numbers) not in (2, 3) or not numbers[0] < numbers[1]:
        Refuse(key, values, allowed)
    low, high = numbers[:2]
    step = numbers[2] if len(numbers) == 3 else (high - low) / _NUM_STEPS
    if not 0 < step <= high - low:
        Refuse(key, values, f"{allowed}, the step > 0 and within the range")
    count = int((high - low) / step + 1e-9)
    return [float(f"{low + i * step:.12g}") for i in range(count + 1)]


def _OwnValue(scenario: Any, key: str) -> float:
    """Returns the value that a number has in a scenario."""
    value = GetPath(ToTree(scenario), ALIASES.get(key, (key,))[0])
    if isinstance(value, bool) or not isinstance(value, int | float):
        Refuse(key, value, "a number in the scenario to have a slider")
    return float(value)


def _Nearest(options: Sequence[float], value: float) -> float:
    """Returns the option that is nearest to a value."""
    return min(options, key=lambda option: abs(option - value))


def _Png(figure: Figure) -> bytes:
    """Returns a figure as a PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI)
    return buffer.getvalue()
