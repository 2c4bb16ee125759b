"""The plan of a sweep: its grid, checked before anything runs."""

import contextlib
import hashlib
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.run.compiled_run import CannotCompile
from teleop_drake.loops.run.system_run import ENGINES
from teleop_drake.model.run.compiled_scenario import CompiledScenario
from teleop_drake.model.run.scenario_run import WhyNotCompiled
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import (
    AnyScenario,
    CheckSteps,
    LoadOverridden,
    ScenarioError,
    ScenarioLike,
    ScenarioToYaml,
)
from teleop_drake.model.scenario.loading import ReadTree
from teleop_drake.model.scenario.overrides import (
    CHANNELS,
    FieldsOf,
    Overrides,
    ParseOverrides,
)
from teleop_drake.model.scenario.scenario import ScenarioFiles
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks import TaskOf
from teleop_drake.model.tasks.metrics import RunSummary
from teleop_drake.study.sweep.any_plan import AnyPlan, CheckValues, Programs
from teleop_drake.study.sweep.result import SweepError
from teleop_drake.study.sweep.task_result import TaskSweepResult
from teleop_drake.study.sweep.values import (
    File,
    GivenGrid,
    Point,
    PointsOf,
)


@dataclass(kw_only=True)
class SweepPlan(AnyPlan[TaskSweepResult]):
    """A checked sweep of one scenario; see PlanSweep.

    Attributes:
        file: The name of the scenario or its file.
        tree: The complete tree of the scenario. The files that it names, such as a
            measured trace or a robot's model, have to exist where runs are simulated.
        overrides: Overrides of all runs: dotted paths of fields and their values.
        scenario: The scenario of the first valid point.
        traces: The hash of each file that the scenarios of the runs name.
    """

    file: File
    tree: Record
    overrides: list[tuple[str, Any]]
    scenario: AnyScenario
    traces: dict[str, str]

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

    def Parameters(self) -> Record:
        """Returns the scenario, the overrides and the hashes of the files."""
        parameters: Record = {
            "scenario": self.scenario.name,
            "overrides": self.overrides,
            "first_scenario": ScenarioToYaml(self.scenario),
        }
        return parameters | ({"traces": self.traces} if self.traces else {})

    def WhyNotCompiled(self) -> str:
        """Returns why the scenario cannot be compiled; empty if it can."""
        return WhyNotCompiled(self.scenario)

    def Simulate(self, point: Point, programs: Programs) -> TaskRecording:
        """Simulates a run, with a program of an earlier run if one fits."""
        if self.engine == "drake":
            return simulate(self.Load(point), engine="drake")
        # The names of kinds decide the structure; most other values are numbers.
        names = tuple(
            (key, value) for key, value in point.items() if isinstance(value, str)
        )
        numbers = {key: x for key, x in point.items() if not isinstance(x, str)}
        if names in programs:
            try:
                known: CompiledScenario = programs[names]
                return known.Run(**numbers)
            except ScenarioError:
                # The run needs another program, or Load() raises the error below.
                pass
        scenario = self.Load(point)
        try:
            program = CompiledScenario(scenario)
        except CannotCompile:
            return simulate(scenario)
        programs[names] = program
        return program.Run()

    def Summary(self, recording: TaskRecording) -> Record:
        """Returns the entries of RunSummary."""
        return RunSummary(recording)

    def Result(self, records: list[Record]) -> TaskSweepResult:
        """Returns the result of the sweep from the records of all its runs."""
        return TaskSweepResult(scenario=self.scenario, axes=self.axes, records=records)


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
    axes, points = PointsOf(grid)

    traces: dict[str, str] = {}
    # What the runs share is checked once if it is valid without other values of the
    # grid: the overrides, and the first axes as far as they have one value only.
    shared: ScenarioLike = scenario
    shared_paths: list[str] = []
    single = itertools.takewhile(lambda axis: len(axis[1]) == 1, axes.items())
    known = {key: values[0] for key, values in single}
    missing = [*fixed, *known.items()]
    with contextlib.suppress(ScenarioError):
        shared, shared_paths = LoadOverridden(scenario, missing)
        missing = []

    def Load(point: Point) -> AnyScenario:
        """Returns the scenario of a point; error messages have the name given."""
        own = [item for item in point.items() if item[0] not in known]
        checked, replaced = LoadOverridden(shared, [*missing, *own])
        _CheckPaths(fixed, point, [*shared_paths, *replaced])
        CheckSteps(checked)
        for file in sorted(set(ScenarioFiles(checked).values())):
            if file not in traces:
                traces[file] = hashlib.sha256(Path(file).read_bytes()).hexdigest()
        return checked

    # Each value has to be valid in at least one run, and a seed has to have an effect.
    first = CheckValues(Load, axes, points)
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
