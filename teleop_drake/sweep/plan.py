"""The plan of a sweep: its grid, checked before anything runs."""

import contextlib
import hashlib
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from teleop_drake.arrays import Record
from teleop_drake.scenario import (
    DELAYS,
    AnyScenario,
    CheckSteps,
    LoadOverridden,
    ScenarioError,
    ScenarioLike,
)
from teleop_drake.scenario.loading import OverriddenTree, ReadTree
from teleop_drake.scenario.scenario import ScenarioFiles
from teleop_drake.simulation.simulate import ENGINES
from teleop_drake.sweep.result import SweepError
from teleop_drake.sweep.values import (
    ALIASES,
    MAX_RUNS,
    CheckAxis,
    File,
    GivenGrid,
    GivenOverrides,
    Grid,
    OverridesOf,
    Point,
    PointOverrides,
)
from teleop_drake.tasks import TaskOf

# A value of the grid is accepted if it is valid in combination with other values. At
# most so many combinations are tried.
_MAX_CHECKS = 61


@dataclass(kw_only=True)
class SweepPlan:
    """A checked sweep of one scenario; see PlanSweep.

    Attributes:
        tree: The complete tree of the scenario. The files that it names, such as a
            measured trace or a robot's model, have to exist where runs are simulated.
        overrides: Overrides of all runs, as "PATH=VALUE".
        axes: Keys of the grid and their values.
        points: A dict from key to value for each run; the last key varies fastest.
        scenario: The scenario of the first valid point.
        traces: The hash of each file that the scenarios of the runs name.
        engine: The engine, as in simulate().
    """

    tree: Record
    overrides: list[str]
    axes: Grid
    points: list[dict[str, Any]]
    scenario: AnyScenario
    traces: dict[str, str]
    engine: str

    def Load(self, point: Point) -> AnyScenario:
        """Returns the scenario of the run at a point.

        Raises:
            ScenarioError: If it is not valid.
        """
        overrides = [*self.overrides, *PointOverrides(point)]
        return OverriddenTree(self.tree, overrides)[0]


def PlanSweep(
    scenario: File,
    grid: GivenGrid,
    *,
    overrides: GivenOverrides = (),
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
    texts = OverridesOf(overrides)
    axes = {key: CheckAxis(key, values) for key, values in grid.items()}
    num_runs = math.prod(map(len, axes.values()))
    if num_runs > MAX_RUNS:
        raise SweepError(f"grid = {num_runs} runs: must be at most {MAX_RUNS}")

    traces: dict[str, str] = {}
    # What the runs share is checked once if it is valid without values of the grid.
    shared: ScenarioLike = scenario
    shared_paths: list[str] = []
    missing = texts
    with contextlib.suppress(ScenarioError):
        shared, shared_paths = LoadOverridden(scenario, texts)
        missing = []

    def Load(point: Point) -> AnyScenario:
        """Returns the scenario of a point; error messages have the name given."""
        own = [*missing, *PointOverrides(point)]
        checked, replaced = LoadOverridden(shared, own)
        _CheckPaths(texts, axes, [*shared_paths, *replaced])
        CheckSteps(checked)
        for file in sorted(set(ScenarioFiles(checked).values())):
            if file not in traces:
                traces[file] = hashlib.sha256(Path(file).read_bytes()).hexdigest()
        return checked

    # Each value of the grid has to be valid in combination with some others.
    first = _CheckValues(Load, axes)
    if "seed" in axes and not _HasRandomNumbers(first, axes):
        raise SweepError(
            f"grid.seed = {axes['seed']}: must be left out, no channel is random"
        )
    return SweepPlan(
        tree=ReadTree(scenario),
        overrides=texts,
        axes=axes,
        points=[
            dict(zip(axes, values, strict=True))
            for values in itertools.product(*axes.values())
        ],
        scenario=first,
        traces=traces,
        engine=engine,
    )


def _HasRandomNumbers(scenario: AnyScenario, axes: Iterable[str]) -> bool:
    """Returns whether any run may depend on a seed."""
    for way in ALIASES["channel"]:
        if not {"channel", way, f"{way}.kind"}.isdisjoint(axes):
            return True
    channels = TaskOf(scenario).Channels(scenario).values()
    return any(channel.draws_random_numbers for channel in channels)


class _Setting(NamedTuple):
    """A field that is set by the overrides or by a key of the grid."""

    setter: str
    path: str


def _Settings(overrides: Sequence[str], axes: Iterable[str]) -> Iterator[_Setting]:
    """Yields the fields that are set, in the order in which they are set."""
    for text in overrides:
        path = text.partition("=")[0].strip()
        for field in DELAYS if path == "delay" else (path,):
            yield _Setting("overrides", field)
    for key in axes:
        for field in ALIASES.get(key, (key,)):
            yield _Setting(f"grid.{key}", field)


def _CheckPaths(
    overrides: Sequence[str], axes: Iterable[str], names: Sequence[str]
) -> None:
    """Refuses a setting that has no effect because a later value replaces it.

    Args:
        names: The unique name of each field, in the order of the settings.
    """
    settings = list(_Settings(overrides, axes))
    for i, later in enumerate(settings):
        if later.setter == "overrides":
            continue  # As on the command line, the later one wins.
        for j, earlier in enumerate(settings[:i]):
            if f"{names[j]}.".startswith(f"{names[i]}."):
                raise SweepError(
                    f"{later.setter}: must leave {earlier.path} alone, "
                    f"{earlier.setter} sets it"
                )


def _CheckValues(load: Callable[[Point], AnyScenario], axes: Grid) -> AnyScenario:
    """Refuses values that are valid in no combination; returns a valid scenario."""
    first: AnyScenario | None = None
    good: set[tuple[str, int]] = set()
    for key, values in axes.items():
        for i in range(len(values)):
            if (key, i) in good:
                continue
            indices, scenario = _FindValid(load, axes, key, i)
            good.update(indices.items())
            first = first or scenario
    return first or load({})


def _FindValid(
    load: Callable[[Point], AnyScenario], axes: Grid, key: str, i: int
) -> tuple[dict[str, int], AnyScenario]:
    """Returns the indices of a valid point with value i of a key, and its scenario.

    Raises:
        ScenarioError: The error of the first point, if no point is valid.
    """
    choices = {k: range(len(values)) for k, values in axes.items()}
    choices[key] = range(i, i + 1)
    combinations = list(itertools.product(*choices.values()))
    errors: list[ScenarioError] = []
    for combination in combinations[:: max(len(combinations) // _MAX_CHECKS, 1)]:
        indices = dict(zip(axes, combination, strict=True))
        try:
            return indices, load({k: axes[k][j] for k, j in indices.items()})
        except ScenarioError as error:
            errors.append(error)
    raise errors[0]
