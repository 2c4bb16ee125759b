"""The plan of a sweep: its grid, checked before anything runs."""

import contextlib
import hashlib
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from teleop_drake.arrays import Record
from teleop_drake.scenario import (
    AnyScenario,
    CheckSteps,
    LoadOverridden,
    ScenarioError,
    ScenarioLike,
)
from teleop_drake.scenario.loading import ReadTree
from teleop_drake.scenario.overrides import (
    CHANNELS,
    FieldsOf,
    Overrides,
    ParseOverrides,
)
from teleop_drake.scenario.scenario import ScenarioFiles
from teleop_drake.simulation.system_run import ENGINES
from teleop_drake.sweep.result import SweepError
from teleop_drake.sweep.values import (
    MAX_RUNS,
    CheckAxis,
    File,
    GivenGrid,
    Grid,
    Point,
)
from teleop_drake.tasks import TaskOf

# A value of the grid is accepted if it is valid in combination with other values. At
# most so many combinations are tried.
_MAX_CHECKS = 61


@dataclass(kw_only=True)
class SweepPlan:
    """A checked sweep of one scenario; see PlanSweep.

    Attributes:
        file: The name of the scenario or its file.
        tree: The complete tree of the scenario. The files that it names, such as a
            measured trace or a robot's model, have to exist where runs are simulated.
        overrides: Overrides of all runs: dotted paths of fields and their values.
        axes: Keys of the grid and their values.
        points: A dict from key to value for each run; the last key varies fastest.
        scenario: The scenario of the first valid point.
        traces: The hash of each file that the scenarios of the runs name.
        engine: The engine, as in simulate().
    """

    file: File
    tree: Record
    overrides: list[tuple[str, Any]]
    axes: Grid
    points: list[dict[str, Any]]
    scenario: AnyScenario
    traces: dict[str, str]
    engine: str

    def Load(self, point: Point) -> AnyScenario:
        """Returns the scenario of the run at a point, after the checks of its task.

        Raises:
            ScenarioError: If it is not valid.
            ValueError: If a value that derives from it is not allowed.
        """
        overrides = [*self.overrides, *point.items()]
        scenario, _ = LoadOverridden(self.tree, overrides)
        TaskOf(scenario).Check(scenario)
        return scenario


def PlanSweep(
    scenario: File,
    grid: GivenGrid,
    *,
    overrides: Overrides = (),
    engine: str = "auto",
) -> SweepPlan:
    """Makes the plan of a sweep, and checks it before anything runs.

    Args:
        scenario: A built-in name or a YAML file.
        grid: Values by key, as in Sweep().
        overrides: Overrides of all runs, as in LoadScenario().
        engine: The engine, as in simulate().

    Raises:
        ScenarioError: If a value of the grid is not valid with any of the others.
        SweepError: If the grid cannot be used, or there is no such engine.
    """
    if engine not in ENGINES:
        raise SweepError(f"engine = {engine!r}: must be one of {', '.join(ENGINES)}")
    fixed = ParseOverrides(overrides)
    axes = {key: CheckAxis(key, values) for key, values in grid.items()}
    num_runs = math.prod(map(len, axes.values()))
    if num_runs > MAX_RUNS:
        raise SweepError(f"grid = {num_runs} runs: must be at most {MAX_RUNS}")

    traces: dict[str, str] = {}
    # What the runs share is checked once if it is valid without values of the grid.
    shared: ScenarioLike = scenario
    shared_paths: list[str] = []
    missing = fixed
    with contextlib.suppress(ScenarioError):
        shared, shared_paths = LoadOverridden(scenario, fixed)
        missing = []

    def Load(point: Point) -> AnyScenario:
        """Returns the scenario of a point; error messages have the name given."""
        own = [*missing, *point.items()]
        checked, replaced = LoadOverridden(shared, own)
        _CheckPaths(fixed, point, [*shared_paths, *replaced])
        CheckSteps(checked)
        for file in sorted(set(ScenarioFiles(checked).values())):
            if file not in traces:
                traces[file] = hashlib.sha256(Path(file).read_bytes()).hexdigest()
        return checked

    points = [
        dict(zip(axes, values, strict=True))
        for values in itertools.product(*axes.values())
    ]
    # Each value has to be valid in at least one run, and a seed has to have an effect.
    first = _CheckValues(Load, axes, points)
    if "seed" in axes and not _HasRandomNumbers(first, axes):
        raise SweepError(
            f"grid.seed = {axes['seed']}: must be left out, no channel is random"
        )
    return SweepPlan(
        file=scenario,
        tree=ReadTree(scenario),
        overrides=fixed,
        axes=axes,
        points=points,
        scenario=first,
        traces=traces,
        engine=engine,
    )


def _HasRandomNumbers(scenario: AnyScenario, axes: Iterable[str]) -> bool:
    """Returns whether any run may depend on a seed."""
    for way in CHANNELS:
        if not {"channel", way, f"{way}.kind"}.isdisjoint(axes):
            return True
    channels = TaskOf(scenario).Channels(scenario).values()
    return any(channel.draws_random_numbers for channel in channels)


def _CheckPaths(
    overrides: Sequence[tuple[str, Any]], point: Point, names: Sequence[str]
) -> None:
    """Refuses a setting that has no effect because a later value replaces it.

    Args:
        names: The unique name of each field, in the order of the settings.
    """
    settings = [("overrides", path) for path, _ in overrides]
    for key, value in point.items():
        settings += [(f"grid.{key}", path) for path in FieldsOf(key, value)]
    named = zip(names, settings, strict=True)
    for (name, (setter, path)), (later, (own, _)) in itertools.combinations(named, 2):
        # Overrides may replace earlier overrides, as on the command line.
        if own != "overrides" and f"{name}.".startswith(f"{later}."):
            raise SweepError(f"{own}: must leave {path} alone, {setter} sets it")


def _CheckValues(
    load: Callable[[Point], AnyScenario], axes: Grid, points: Sequence[Point]
) -> AnyScenario:
    """Refuses values that are valid in no combination; returns a valid scenario.

    Args:
        load: Returns the scenario of a point.
        points: All points of the grid; the last axis varies fastest.

    Raises:
        ScenarioError: The error of the first point with a value that is never valid.
    """
    runs = np.arange(len(points)).reshape([len(values) for values in axes.values()])
    first: AnyScenario | None = None
    for axis, num_values in enumerate(runs.shape):
        for i in range(num_values):
            own = runs.take(i, axis).ravel()
            own = own[:: max(len(own) // _MAX_CHECKS, 1)]
            scenario = _FirstValid(load, [points[run] for run in own.tolist()])
            first = first or scenario
    return first or load({})


def _FirstValid(
    load: Callable[[Point], AnyScenario], points: Iterable[Point]
) -> AnyScenario:
    """Returns the scenario of the first valid point, or raises the first error."""
    errors: list[ScenarioError] = []
    for point in points:
        try:
            return load(point)
        except ScenarioError as error:
            errors.append(error)
    raise errors[0]
