"""A study: sweeps of several scenarios, described by a file.

    scenarios: [two_dof_collision, mine.yaml]
    controllers: [direct_force, adaptive_backstepping, my_module:MyLaw]
    grid:
      delay: 0:0.4:9
      environment.layers.bone.stiffness: [100, 300]
    seeds: 20
    overrides: {duration: 8}
    engine: auto

Every key but `scenarios` may be left out. In the place of a mapping, `overrides` may be
the name of a YAML file with one, such as the gains.yaml of a search. Instead of a list,
`scenarios` may be a mapping, in which each sweep has a name, and more than what all of
them have:

    scenarios:
      slow: {scenario: one_dof, overrides: {duration: 30}, seeds: 5}
      fast: {scenario: one_dof, grid: {surgeon.velocity: [[0.2], [0.4]]}}

The folder of a study has a folder for each sweep (see sweep.folder). A part of a study,
one of N, is what one job of an array of jobs does; it stands in folders `part-I-of-N`
of those.
"""

import os
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from teleop_drake.scenario import ARCHITECTURES, ScenarioNames
from teleop_drake.scenario.yaml_text import ParseFile, ReadText
from teleop_drake.sweep.folder import SweepFolder
from teleop_drake.sweep.plan import MAX_RUNS, ParseValues, PlanSweep, SweepPlan
from teleop_drake.sweep.result import SweepError, SweepResult
from teleop_drake.sweep.run import RunSweep
from teleop_drake.validation import CheckChoice, Refuse, Within

_OF_A_SWEEP = ("controllers", "grid", "seeds", "overrides")


@dataclass(kw_only=True, frozen=True)
class Study:
    """A study that was checked.

    Attributes:
        plans: The sweep of each scenario, by the name of its file.
        metrics: What to draw, as SelectMetrics takes them; None: a few.
    """

    plans: dict[str, SweepPlan]
    metrics: list[str] | None


_STUDIES = Path(__file__).parents[1] / "studies"


def StudyNames() -> list[str]:
    """Returns the names of the built-in studies in alphabetical order."""
    return sorted(path.stem for path in _STUDIES.glob("*.yaml"))


def IsStudy(name: str) -> bool:
    """Returns whether a name is that of a study, or of a file with one."""
    if name in StudyNames():
        return True
    path = Path(name)
    return path.is_file() and "scenarios" in ParseFile(path, ReadText(path))


def LoadStudy(file: str | os.PathLike[str]) -> Study:
    """Reads a study and checks everything that can be wrong before it runs.

    Args:
        file: A built-in name, or a YAML file. Paths of scenarios are relative to it.

    Raises:
        ScenarioError: If a key or a value is not allowed.
        SweepError: If a grid cannot be used.
    """
    path = _STUDIES / f"{file}.yaml" if file in StudyNames() else Path(file)
    tree = ParseFile(path, ReadText(path))
    for key in tree:
        CheckChoice("key", key, ("scenarios", *_OF_A_SWEEP, "engine", "metrics"))
    sweeps = tree.get("scenarios")
    if _IsListOfText(sweeps):
        named = {Path(name).stem: {"scenario": name} for name in sweeps}
        if len(named) < len(sweeps):
            Refuse("scenarios", sweeps, "scenarios whose files have different names")
        sweeps = named
    if not isinstance(sweeps, Mapping) or not sweeps:
        Refuse("scenarios", sweeps, "a list of scenarios, or a mapping of sweeps")
    plans = {}
    for name, own in sweeps.items():
        with Within(f"scenarios.{name}"):
            plans[str(name)] = _PlanOf(tree, own, path.parent)
    metrics = tree.get("metrics")
    if metrics is not None and not _IsListOfText(metrics):
        Refuse("metrics", metrics, "a list of metrics")
    return Study(plans=plans, metrics=metrics)


def _PlanOf(common: Mapping[str, Any], own: Any, folder: Path) -> SweepPlan:
    """Returns the plan of a sweep from what all sweeps have and what it has."""
    if not isinstance(own, Mapping):
        Refuse("sweep", own, "a mapping with the key scenario")
    for key in own:
        CheckChoice("key", key, ("scenario", *_OF_A_SWEEP))
    scenario = own.get("scenario")
    if not isinstance(scenario, str):
        Refuse("scenario", scenario, "the name of a scenario or its file")
    values = {key: common.get(key) for key in _OF_A_SWEEP} | dict(own)
    for key in ("grid", "overrides"):
        both = [x.get(key) or {} for x in (common, own)]
        if key == "overrides":  # Or a file with them.
            both = [
                ParseFile(folder / x, ReadText(folder / x)) if isinstance(x, str) else x
                for x in both
            ]
        for given in both:
            if not isinstance(given, Mapping):
                Refuse(key, given, "a mapping of paths to values")
        values[key] = {str(path): x for given in both for path, x in given.items()}
    return PlanSweep(
        scenario if scenario in ScenarioNames() else folder / scenario,
        MakeGrid(values["controllers"], values["grid"].items(), values["seeds"]),
        overrides=values["overrides"],
        engine=common.get("engine") or "auto",
    )


def MakeGrid(
    controllers: Any, varied: Iterable[tuple[str, Any]], seeds: int | None
) -> dict[str, list[Any]]:
    """Returns the grid of a sweep: controllers vary first, seeds last.

    Args:
        controllers: A list of kinds, `all`, or None.
        varied: Paths, and their values as a list or as ParseValues() takes them.
        seeds: Number of seeds; None: none.

    Raises:
        ScenarioError: Naming what is none of that, or the path that is there twice.
        SweepError: If the text of a path has no values.
    """
    if controllers == "all":
        controllers = list(ARCHITECTURES)
    elif controllers is not None and not _IsListOfText(controllers):
        Refuse("controllers", controllers, "`all` or a list of controllers")
    grid: dict[str, list[Any]] = {"controller": controllers} if controllers else {}
    last: list[tuple[str, Any]] = []
    if seeds is not None:
        if not isinstance(seeds, int) or not 1 <= seeds <= MAX_RUNS:
            Refuse("seeds", seeds, f"1 to {MAX_RUNS}")
        last = [("seed", list(range(seeds)))]
    for key, values in [*varied, *last]:
        if key in grid:
            Refuse(f"grid.{key}", values, "left out, because it is varied already")
        if isinstance(values, str):
            try:
                values = ParseValues(values)
            except SweepError as e:
                raise SweepError(f"grid.{key} = {e}") from None
        if not isinstance(values, list) or not values:
            Refuse(f"grid.{key}", values, "a list of values or START:STOP:COUNT")
        grid[key] = values
    return grid


def RunStudy(
    study: Study,
    out: str | os.PathLike[str],
    *,
    part: tuple[int, int] | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> dict[str, SweepResult]:
    """Does a study, or a part of it.

    Args:
        part: (I, N) to do the I-th of N parts; None: all.
        progress: Called with the numbers of finished runs and of all.
        **options: As RunSweep() takes them.

    Returns:
        What came out for each scenario; of a part only its own records.

    Raises:
        SweepError: If jobs or the folder cannot be used.
        RuntimeError: If no process can start. What is finished stays in `out`.
        OSError: If a file cannot be written.
    """
    first, step = part or (1, 1)
    sizes = [len(p.points[first - 1 :: step]) for p in study.plans.values()]
    results: dict[str, SweepResult] = {}
    for i, (name, plan) in enumerate(study.plans.items()):

        def Report(finished: int, _: int, before: int = sum(sizes[:i])) -> None:
            if progress is not None:
                progress(before + finished, sum(sizes))

        folder = Path(out, name, f"part-{first}-of-{step}" if part else "")
        options |= {"part": part, "out": folder, "progress": Report}
        results[name] = RunSweep(plan, **options)
    return results


def MergeStudy(
    study: Study,
    out: str | os.PathLike[str],
    folders: Sequence[str | os.PathLike[str]],
    *,
    notice: Callable[[str], None] = warnings.warn,
) -> dict[str, SweepResult]:
    """Makes one study of its parts.

    Args:
        out: Folder of the study.
        folders: Where the parts are, each a folder that RunStudy() wrote to.
        notice: Called with what the user should know of the folders.

    Returns:
        What came out for each scenario.

    Raises:
        SweepError: If there are no parts, some are missing, or are of another study.
        OSError: If a file cannot be written.
    """
    results = {}
    for name, plan in study.plans.items():
        parts = _Parts([Path(folder, name) for folder in folders])
        records: dict[int, dict[str, Any]] = {}
        for i, path in enumerate(parts):
            part = (i + 1, len(parts))
            with SweepFolder(path, plan, True, notice, part) as folder:
                records |= folder.records
        missing = len(plan.points) - len(records)
        if missing:
            raise SweepError(
                f"parts = {len(parts)} folders: must have all {len(plan.points)} runs, "
                f"and {missing} are missing; --resume does them"
            )
        ordered = [records[run] for run in range(len(plan.points))]
        results[name] = SweepResult(
            scenario=plan.scenario, axes=plan.axes, records=ordered
        )
        with SweepFolder(Path(out, name), plan, True, notice) as folder:
            folder.Finish(results[name])
    return results


def ParsePart(text: str) -> tuple[int, int]:
    """Returns the part that I/N stands for.

    Args:
        text: For example "3/20".

    Raises:
        SweepError: If it is not one, or I is not 1 to N.
    """
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise SweepError(f"{text!r}: must be I/N with 1 <= I <= N")
    return int(match[1]), int(match[2])


def _Parts(folders: Sequence[Path]) -> list[Path]:
    """Returns the folders of all parts, which must be there."""
    found = {x.name: x for path in folders for x in path.glob("part-*-of-*")}
    counts = {name.rpartition("-")[2] for name in found}
    title = f"parts in {', '.join(map(str, folders))}"
    if len(counts) != 1:
        several = f"of {', '.join(sorted(counts))}" if counts else "none"
        raise SweepError(f"{title}: must be those of one N, and are {several}")
    count = int(counts.pop())
    names = [f"part-{i + 1}-of-{count}" for i in range(count)]
    for name in names:
        if name not in found or not (found[name] / "sweep.json").exists():
            raise SweepError(f"{title}: must be all, and lack {name}")
    return [found[name] for name in names]


def _IsListOfText(value: Any) -> TypeGuard[list[str]]:
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(item, str) for item in value)
    )
