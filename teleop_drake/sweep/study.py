"""A study: sweeps of several scenarios, described by a file.

    scenarios: [two_dof_collision, mine.yaml]
    controllers: [direct_force, adaptive_backstepping, my_module:MyLaw]
    grid:
      delay: 0:0.4:9
      environment.layers.bone.stiffness: [100, 300]
    seeds: 20
    overrides: {duration: 8}
    engine: auto

Every key but `scenarios` may be left out. The folder of a study has a folder for each
scenario, which is that of a sweep (see sweep.folder). A part of a study, one of N, is
what one job of an array of jobs does; it stands in folders `part-I-of-N` of those.
"""

import os
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from teleop_drake.scenario import ARCHITECTURES, ScenarioNames
from teleop_drake.scenario.tree import ParseFile, ReadText
from teleop_drake.sweep.folder import SweepFolder
from teleop_drake.sweep.plan import MAX_RUNS, ParseValues, PlanSweep, SweepPlan
from teleop_drake.sweep.result import SweepError, SweepResult
from teleop_drake.sweep.run import RunSweep
from teleop_drake.validation import CheckChoice, Refuse, Within

_KEYS = (
    "scenarios",
    "controllers",
    "grid",
    "seeds",
    "overrides",
    "engine",
    "metrics",
)


@dataclass(kw_only=True, frozen=True)
class Study:
    """A study that was checked.

    Attributes:
        plans: The sweep of each scenario, by the name of its file.
        metrics: What to draw, as SelectMetrics takes them; None: a few.
    """

    plans: dict[str, SweepPlan]
    metrics: list[str] | None

    @property
    def num_runs(self) -> int:
        """Number of runs of all sweeps."""
        return sum(len(plan.points) for plan in self.plans.values())


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
        CheckChoice("key", key, _KEYS)
    grid = _Grid(tree)
    overrides = tree.get("overrides") or {}
    if not isinstance(overrides, Mapping):
        Refuse("overrides", overrides, "a mapping of paths to values")
    plans: dict[str, SweepPlan] = {}
    for name in _Scenarios(tree, path.parent):
        stem = Path(name).stem
        if stem in plans:
            Refuse("scenarios", stem, "scenarios whose files have different names")
        with Within(f"scenarios.{stem}"):
            plans[stem] = PlanSweep(
                name, grid, overrides=overrides, engine=tree.get("engine") or "auto"
            )
    metrics = tree.get("metrics")
    if metrics is not None and not _IsListOfText(metrics):
        Refuse("metrics", metrics, "a list of metrics")
    return Study(plans=plans, metrics=metrics)


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
        RuntimeError: If the executor gives up. What is finished stays in `out`.
        OSError: If a file cannot be written.
    """
    first, step = part or (1, 1)
    sizes = [len(p.points[first - 1 :: step]) for p in study.plans.values()]
    results: dict[str, SweepResult] = {}
    for i, (name, plan) in enumerate(study.plans.items()):

        def Report(finished: int, _: int, before: int = sum(sizes[:i])) -> None:
            if progress is not None:
                progress(before + finished, sum(sizes))

        folder = Path(out, name)
        if part is not None:
            folder /= f"part-{first}-of-{step}"
        results[name] = RunSweep(
            plan, part=part, out=folder, progress=Report, **options
        )
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


def _Scenarios(tree: Mapping[str, Any], folder: Path) -> list[str]:
    """Returns built-in names, and paths as seen from here."""
    names = tree.get("scenarios")
    if not _IsListOfText(names):
        Refuse("scenarios", names, "a list of scenarios")
    return [
        name if name in ScenarioNames() else str(folder / Path(name)) for name in names
    ]


def _Grid(tree: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Returns the grid of every scenario: controllers first, seeds last."""
    grid: dict[str, list[Any]] = {}
    controllers = tree.get("controllers")
    if controllers == "all":
        grid["controller"] = list(ARCHITECTURES)
    elif controllers is not None:
        if not _IsListOfText(controllers):
            Refuse("controllers", controllers, "`all` or a list of controllers")
        grid["controller"] = controllers
    varied = tree.get("grid") or {}
    if not isinstance(varied, Mapping):
        Refuse("grid", varied, "a mapping of paths to values")
    for key, values in varied.items():
        if isinstance(values, str):
            try:
                grid[str(key)] = ParseValues(values)
            except SweepError as e:
                raise SweepError(f"grid.{key} = {e}") from None
        elif isinstance(values, list) and values:
            grid[str(key)] = values
        else:
            Refuse(f"grid.{key}", values, "a list of values or START:STOP:COUNT")
    seeds = tree.get("seeds")
    if seeds is not None:
        if not isinstance(seeds, int) or not 1 <= seeds <= MAX_RUNS:
            Refuse("seeds", seeds, f"1 to {MAX_RUNS}")
        grid["seed"] = list(range(seeds))
    return grid


def _IsListOfText(value: Any) -> TypeGuard[list[str]]:
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(item, str) for item in value)
    )
