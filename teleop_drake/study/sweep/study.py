"""Studies: sweeps of several scenarios, described by a file.

    scenarios: [two_dof_collision, mine.yaml]
    controllers: [direct_force, adaptive_backstepping, my_module:MyLaw]
    grid:
      delay: 0:0.4:9
      environment.layers.bone.stiffness: [100, 300]
    seeds: 20
    overrides: {duration: 8}
    engine: auto

Every key but `scenarios` may be left out. `overrides` is a mapping, or the name of a
YAML file that contains a mapping, such as the gains.yaml of a search. `scenarios` is a
list, or a mapping from the name of each sweep to its settings. These settings extend or
replace the settings that all sweeps share:

    scenarios:
      slow: {scenario: one_dof, overrides: {duration: 30}, seeds: 5}
      fast: {scenario: one_dof, grid: {surgeon.velocity: [[0.2], [0.4]]}}

The folder of a study has a folder for each sweep (see sweep.folder).
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import (
    CheckChoice,
    CheckKind,
    Refuse,
    Within,
)
from teleop_drake.model.scenario import ScenarioNames
from teleop_drake.model.scenario.yaml_text import ParseFile
from teleop_drake.study.sweep.plan import PlanSweep, SweepPlan
from teleop_drake.study.sweep.values import File, IsListOfText, MakeGrid

_OF_A_SWEEP = ("controllers", "grid", "seeds", "overrides")

_STUDIES = Path(__file__).parents[1] / "studies"


@dataclass(kw_only=True, frozen=True)
class Study:
    """A checked study.

    Attributes:
        plans: The plan of each sweep, by the sweep's name.
        metrics: The metrics to draw, as in SelectMetrics(); None: a few.
    """

    plans: dict[str, SweepPlan]
    metrics: list[str] | None = None


def _FileOf(name: File) -> Path:
    """Returns the file of a built-in study, or the file that is given."""
    built_in = _STUDIES / f"{name}.yaml"
    return built_in if built_in.is_file() else Path(name)


def IsStudy(name: str) -> bool:
    """Returns whether a name is the name of a study, or of a file with a study."""
    path = _FileOf(name)
    return path.is_file() and "scenarios" in ParseFile(path)


def LoadStudy(file: File) -> Study:
    """Reads a study, and checks it before anything runs.

    Args:
        file: A built-in name, or a YAML file. Paths of scenarios are relative to it.

    Raises:
        ScenarioError: If a key or a value is not allowed.
        SweepError: If a grid cannot be used.
    """
    CheckKind("file", file, str | os.PathLike, "the name or the file of a study")
    path = _FileOf(file)
    tree = ParseFile(path)
    for key in tree:
        CheckChoice("key", key, ("scenarios", *_OF_A_SWEEP, "engine", "metrics"))
    plans = {}
    for name, own in _NamedSweeps(tree.get("scenarios")).items():
        with Within(f"scenarios.{name}"):
            plans[str(name)] = _PlanOf(tree, own, path.parent)
    metrics = tree.get("metrics")
    if metrics is not None and not IsListOfText(metrics):
        Refuse("metrics", metrics, "a list of metrics")
    return Study(plans=plans, metrics=metrics)


def _NamedSweeps(sweeps: Any) -> Mapping[Any, Any]:
    """Returns the sweeps by name; in a list, a sweep has the name of its file."""
    if IsListOfText(sweeps):
        named = {Path(name).stem: {"scenario": name} for name in sweeps}
        if len(named) < len(sweeps):
            Refuse("scenarios", sweeps, "scenarios whose files have different names")
        return named
    if not isinstance(sweeps, Mapping) or not sweeps:
        Refuse("scenarios", sweeps, "a list of scenarios, or a mapping of sweeps")
    return sweeps


def _PlanOf(common: Mapping[Any, Any], own: Any, folder: Path) -> SweepPlan:
    """Returns a sweep's plan: the study's settings, overridden by the sweep's own."""
    if not isinstance(own, Mapping):
        Refuse("sweep", own, "a mapping with the key scenario")
    for key in own:
        CheckChoice("key", key, ("scenario", *_OF_A_SWEEP))
    scenario = own.get("scenario")
    if not isinstance(scenario, str):
        Refuse("scenario", scenario, "the name of a scenario or its file")
    settings = {**common, **own}
    grid = _Joined("grid", common, own, folder)
    return PlanSweep(
        scenario if scenario in ScenarioNames() else folder / scenario,
        MakeGrid(settings.get("controllers"), grid.items(), settings.get("seeds")),
        overrides=_Joined("overrides", common, own, folder),
        engine=common.get("engine") or "auto",
    )


def _Joined(
    key: str, common: Mapping[Any, Any], own: Mapping[Any, Any], folder: Path
) -> Record:
    """Returns the mapping of a key in the study, updated by the sweep's own."""
    joined: Record = {}
    for settings in (common, own):
        values = settings.get(key) or {}
        if key == "overrides" and isinstance(values, str):
            file = folder / values
            values = ParseFile(file)
        if not isinstance(values, Mapping):
            Refuse(key, values, "a mapping of paths to values")
        joined |= {str(path): value for path, value in values.items()}
    return joined
