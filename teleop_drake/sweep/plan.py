"""The plan of a sweep: its grid, checked before anything runs."""

import hashlib
import itertools
import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from teleop_drake.scenario import (
    DELAYS,
    AnyScenario,
    CheckSteps,
    LoadOverridden,
    LoadScenario,
    ScenarioError,
    ScenarioNames,
)
from teleop_drake.scenario.loading import ParseScenario, ResolveFiles
from teleop_drake.scenario.scenario import ScenarioFiles
from teleop_drake.scenario.yaml_text import DumpOnOneLine, DumpYaml, ParseYaml, ReadText
from teleop_drake.simulation.simulate import ENGINES
from teleop_drake.sweep.result import SweepError
from teleop_drake.tasks import TaskOf

MAX_RUNS = 100_000
"""Most runs of a sweep, so that a typing error cannot exhaust the memory."""

ALIASES = {
    "channel": ("forward_channel", "return_channel"),
    "controller": ("controller.kind",),
    "delay": DELAYS,
    "forward_delay": ("forward_channel.delay",),
    "return_delay": ("return_channel.delay",),
    "seed": ("forward_channel.seed", "return_channel.seed"),
}
"""Keys of a grid that stand for fields of the scenario."""

# A value of the grid is good if it is valid together with one of so many choices of
# the other values.
_MAX_CHECKS = 61

# So many scenarios stay in the memory after they were checked.
_MAX_LOADED = 1000


@dataclass(kw_only=True)
class SweepPlan:
    """A sweep that was checked, see PlanSweep.

    Attributes:
        source: The scenario.
        overrides: For all runs, as "PATH=VALUE".
        axes: Keys of the grid and their values.
        points: Key to value for each run; the last key varies fastest.
        scenario: The first point that is valid.
        traces: The files that scenarios of the runs name, and a hash of each.
        engine: As simulate() takes it.
        loaded: Some of the scenarios that were checked, by their overrides.
    """

    source: "Source"
    overrides: list[str]
    axes: dict[str, list[Any]]
    points: list[dict[str, Any]]
    scenario: AnyScenario
    traces: dict[str, str]
    engine: str
    loaded: dict[tuple[str, ...], AnyScenario]

    def Load(self, overrides: Sequence[str]) -> AnyScenario:
        """Returns the scenario of a run in this process; see Source.Load()."""
        return self.loaded.get(tuple(overrides)) or self.source.Load(overrides)


def PlanSweep(
    scenario: str | os.PathLike[str],
    grid: Mapping[str, Iterable[Any]],
    *,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    engine: str = "auto",
) -> SweepPlan:
    """Checks everything about a sweep that can be wrong before it runs.

    Raises:
        ScenarioError: If a value of the grid is not valid with any of the others.
        SweepError: If the grid cannot be used, or there is no such engine.
    """
    if engine not in ENGINES:
        raise SweepError(f"engine = {engine!r}: must be one of {', '.join(ENGINES)}")
    if isinstance(overrides, Mapping):
        overrides = [f"{k}={_YamlOf(_ToPlain(x))}" for k, x in overrides.items()]
    elif isinstance(overrides, str):
        overrides = [overrides]
    overrides = list(overrides)
    axes = {key: _CheckAxis(key, values) for key, values in grid.items()}
    _CheckPaths(overrides, axes)
    num_runs = math.prod(map(len, axes.values()))
    if num_runs > MAX_RUNS:
        raise SweepError(f"grid = {num_runs} runs: must be at most {MAX_RUNS}")

    traces: dict[str, str] = {}
    good: dict[tuple[str, ...], AnyScenario] = {}

    def Load(point: list[str]) -> AnyScenario:
        # By the name that the user gave, which the messages have.
        loaded, replaced = LoadOverridden(scenario, point)
        CheckSteps(loaded)
        _CheckPaths(overrides, axes, replaced)
        for file in sorted({*ScenarioFiles(loaded).values()} - {*traces}):
            traces[file] = hashlib.sha256(Path(file).read_bytes()).hexdigest()
        if len(good) < _MAX_LOADED:
            good[tuple(point)] = loaded
        return loaded

    first = _CheckValues(Load, overrides, axes)
    if "seed" in axes and not _HasRandomNumbers(first, axes):
        raise SweepError(
            f"grid.seed = {axes['seed']}: must be left out, no channel is random"
        )
    return SweepPlan(
        source=_ReadSource(scenario),
        overrides=overrides,
        axes=axes,
        points=[
            dict(zip(axes, values, strict=True))
            for values in itertools.product(*axes.values())
        ],
        scenario=first,
        traces=traces,
        engine=engine,
        loaded=good,
    )


def ParseValues(text: str) -> list[Any]:
    """Returns the values that START:STOP:COUNT or A,B,... stand for.

    A range has both ends; its values are rounded to 12 digits. A list has YAML values.

    Args:
        text: For example "0:0.4:41", "0.1", "auto,4.3" or "[0.1, 0],[0.2, 0]".

    Raises:
        SweepError: If it is neither.
    """
    allowed = "must be START:STOP:COUNT or A,B,..."
    is_kind = re.fullmatch(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", text)  # module:Class
    if ":" in text and not is_kind and not set(text) & set(",[]{}\"'"):
        try:
            start, stop, count = text.split(":")
            ends, num_values = (float(start), float(stop)), int(count)
        except ValueError:
            raise SweepError(f"{text!r}: {allowed}") from None
        if not all(map(math.isfinite, ends)):
            raise SweepError(f"{text!r}: START and STOP must be finite")
        if not 1 <= num_values <= MAX_RUNS:
            raise SweepError(f"{text!r}: COUNT must be 1 to {MAX_RUNS}")
        return [float(f"{x:.12g}") for x in np.linspace(*ends, num_values)]
    try:
        values = ParseYaml(f"[{text}]", "values")
    except ScenarioError:
        values = None
    if not isinstance(values, list) or not values:
        raise SweepError(f"{text!r}: {allowed}")
    return values


@dataclass(kw_only=True)
class Source:
    """A scenario file that can be sent to another machine.

    What it names in turn, a measured trace or a robot's model, has to be there.

    Attributes:
        name: A built-in name, or the file's.
        text: What is in the file; None for a built-in scenario.
    """

    name: str
    text: str | None

    def Load(self, overrides: Sequence[str]) -> AnyScenario:
        """Returns the scenario of a run.

        Raises:
            ScenarioError: If it is not valid.
        """
        if self.text is None:
            return LoadScenario(self.name, overrides)
        with TemporaryDirectory(prefix="teleop-drake-") as folder:
            path = Path(folder) / self.name
            path.write_text(self.text, encoding="utf-8")
            return LoadScenario(path, overrides)


def _ReadSource(scenario: str | os.PathLike[str]) -> Source:
    """Returns the source of a scenario that LoadScenario takes."""
    path = Path(scenario)
    if os.fspath(scenario) in ScenarioNames():
        return Source(name=path.name, text=None)
    tree = ParseScenario(path, ReadText(path))
    ResolveFiles(tree, path.parent.resolve())  # The scenario file will be elsewhere.
    return Source(name=path.name, text=DumpYaml(tree))


def _HasRandomNumbers(scenario: AnyScenario, axes: Iterable[str]) -> bool:
    """Returns whether any run may depend on a seed."""
    ways = ALIASES["channel"]
    kinds = {"channel", *ways, *(f"{way}.kind" for way in ways)}
    channels = TaskOf(scenario).Channels(scenario).values()
    return not kinds.isdisjoint(axes) or any(x.draws_random_numbers for x in channels)


def _CheckAxis(key: str, values: Iterable[Any]) -> list[Any]:
    if isinstance(values, str):
        raise SweepError(f"grid.{key} = {values!r}: must be a list of values")
    try:
        plain: list[Any] = _ToPlain(list(values), allow_nan=False)
    except ValueError:
        raise SweepError(
            f"grid.{key}: must have finite numbers, text, booleans, None, lists and "
            "dicts only"
        ) from None
    if not plain:
        raise SweepError(f"grid.{key} = []: must have at least one value")
    # 1 and 1.0 are one value, 1 and true are two.
    texts = [json.dumps(x) for x in json.loads(json.dumps(plain), parse_int=float)]
    text, count = Counter(texts).most_common(1)[0]
    if count > 1:
        text = json.dumps(plain[texts.index(text)])
        raise SweepError(f"grid.{key}: must have different values, and {text} is twice")
    return plain


def _CheckPaths(
    overrides: Sequence[str],
    axes: Mapping[str, Any],
    replaced: Sequence[str] | None = None,
) -> None:
    """Refuses what would have no effect because a later value replaces it.

    Args:
        replaced: What the paths of the overrides and those of the keys are other names
            of; None: of themselves.
    """
    keys = [(text.partition("=")[0].strip(), "overrides") for text in overrides]
    setters, paths = [], []
    for key, setter in [*keys, *((key, f"grid.{key}") for key in axes)]:
        known = {"delay": DELAYS} if setter == "overrides" else ALIASES
        for path in known.get(key, (key,)):
            paths.append(path)
            setters.append(setter)
    names = list(replaced or paths)
    for i, later in enumerate(setters):
        for j, earlier in enumerate(setters[:i]):
            if later != "overrides" and f"{names[j]}.".startswith(f"{names[i]}."):
                raise SweepError(
                    f"{later}: must leave {paths[j]} alone, {earlier} sets it"
                )


def _CheckValues(
    load: Callable[[list[str]], AnyScenario],
    overrides: list[str],
    axes: Mapping[str, list[Any]],
) -> AnyScenario:
    """Refuses values that are not valid with any others, returns a valid scenario."""
    first_valid: AnyScenario | None = None
    is_good: dict[str, list[bool]] = {key: [False] * len(x) for key, x in axes.items()}
    for key, values in axes.items():
        for i in range(len(values)):
            if is_good[key][i]:
                continue
            others = {k: [i] if k == key else range(len(x)) for k, x in axes.items()}
            num_choices = math.prod(map(len, others.values()))
            stride = max(num_choices // _MAX_CHECKS, 1)
            first_error = None
            for indices in itertools.islice(
                itertools.product(*others.values()), 0, None, stride
            ):
                point = {k: axes[k][j] for k, j in zip(axes, indices, strict=True)}
                try:
                    valid = load([*overrides, *PointOverrides(point)])
                except ScenarioError as error:
                    first_error = first_error or error
                    continue
                first_valid = first_valid or valid
                for k, j in zip(axes, indices, strict=True):
                    is_good[k][j] = True
                break
            else:
                assert first_error is not None
                raise first_error
    return first_valid if first_valid is not None else load(overrides)


def _ToPlain(value: Any, **options: Any) -> Any:
    """Returns a value without numpy, as JSON gives it back.

    Raises:
        ValueError: If it cannot.
    """
    try:
        text = json.dumps(value, default=lambda x: x.tolist(), **options)
    except (AttributeError, TypeError) as error:
        raise ValueError(str(error)) from None
    return json.loads(text)


def _YamlOf(value: Any) -> str:
    if isinstance(value, float) and math.isfinite(value):
        return repr(value)
    return DumpOnOneLine(value)


def PointOverrides(point: Mapping[str, Any]) -> list[str]:
    """Returns the overrides that make a point of the grid."""
    return [
        f"{path}={text}"
        for key, text in zip(point, map(_YamlOf, point.values()), strict=True)
        for path in ALIASES.get(key, (key,))
    ]
