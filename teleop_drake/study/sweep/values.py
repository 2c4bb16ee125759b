"""The values of a grid: their notation, their checks, and their overrides."""

import itertools
import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeGuard

import numpy as np

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import Refuse, ScenarioError
from teleop_drake.study.sweep.result import SweepError

Grid = dict[str, list[Any]]
"""The values of each key; the last key varies fastest."""

Point = Mapping[str, Any]
"""A point of a grid: one value for each key."""

GivenGrid = Mapping[str, Iterable[Any]]
"""A grid as users give it: lists of values, or texts for ParseValues()."""

File = str | os.PathLike[str]
"""The name of a file or a folder."""

Progress = Callable[[int, int], None]
"""A function that is called with the numbers of finished runs and of all runs."""

Notice = Callable[[str], object]
"""A function that is called with a line of text for the user."""

SEED = "seed"
"""The key of a grid that selects the random numbers of a run."""

MAX_RUNS = 100_000
"""Largest number of runs in a sweep. A typing error thus cannot exhaust the memory."""


def MakeGrid(
    controllers: object, varied: Iterable[tuple[str, Any]], seeds: object
) -> Record:
    """Returns the grid of a sweep: controllers vary first, seeds last.

    Args:
        controllers: A list of kinds, `all`, or None.
        varied: Paths with their values, as a list or as a text for ParseValues().
        seeds: Number of seeds; None: the seed is not varied.

    Raises:
        ScenarioError: If an argument is not allowed, or a path is varied twice.
    """
    from teleop_drake.model.scenario import (
        ARCHITECTURES,  # Not for the sweep of a System.
    )

    grid: Record = {}
    if controllers == "all":
        grid["controller"] = list(ARCHITECTURES)
    elif controllers is not None:
        if not IsListOfText(controllers):
            Refuse("controllers", controllers, "`all` or a list of controllers")
        grid["controller"] = list(controllers)
    items = list(varied)
    if seeds is not None:
        if not isinstance(seeds, int) or not 1 <= seeds <= MAX_RUNS:
            Refuse("seeds", seeds, f"1 to {MAX_RUNS}")
        items.append(("seed", list(range(seeds))))
    for key, values in items:
        if key in grid:
            Refuse(f"grid.{key}", values, "left out, because it is varied already")
        grid[key] = values
    return grid


def IsListOfText(value: object) -> TypeGuard[list[str]]:
    """Returns whether a value is a list of one or more texts."""
    if not isinstance(value, list) or not value:
        return False
    return all(isinstance(item, str) for item in value)


def ParseValues(text: str) -> list[Any]:
    """Returns the values that START:STOP:COUNT or A,B,... stands for.

    A range includes both ends; its values are rounded to 12 digits. The values of a
    list are written in YAML.

    Args:
        text: For example "0:0.4:41", "0.1", "auto,4.3" or "[0.1, 0],[0.2, 0]".

    Raises:
        SweepError: If the text is neither.
    """
    from teleop_drake.model.scenario.yaml_text import ParseYaml

    is_kind = re.fullmatch(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", text)  # module:Class
    if ":" in text and not is_kind and not set(text) & set(",[]{}\"'"):
        return _ParseRange(text)
    try:
        values = ParseYaml(f"[{text}]", "values")
    except ScenarioError:
        values = None
    if not isinstance(values, list) or not values:
        raise SweepError(f"{text!r}: must be START:STOP:COUNT or A,B,...")
    return values


def _ParseRange(text: str) -> list[float]:
    """Returns the values of START:STOP:COUNT."""
    try:
        *ends, count = text.split(":")
        start, stop = map(float, ends)
        num_values = int(count)
    except ValueError:
        raise SweepError(f"{text!r}: must be START:STOP:COUNT or A,B,...") from None
    if not math.isfinite(start - stop):
        raise SweepError(f"{text!r}: START and STOP must be finite")
    if not 1 <= num_values <= MAX_RUNS:
        raise SweepError(f"{text!r}: COUNT must be 1 to {MAX_RUNS}")
    return [float(f"{x:.12g}") for x in np.linspace(start, stop, num_values)]


def _AsJson(name: str, values: Iterable[Any]) -> str:
    """Returns values as JSON, without numpy types; refuses what cannot be written."""
    try:
        return json.dumps(list(values), default=lambda x: x.tolist(), allow_nan=False)
    except (AttributeError, TypeError, ValueError):
        raise SweepError(
            f"{name}: must have finite numbers, text, booleans, None, lists and dicts "
            "only"
        ) from None


def CheckAxis(key: str, values: object) -> list[Any]:
    """Returns the values of a key as plain JSON values, without numpy types.

    Args:
        key: The key of the grid.
        values: A list of values, or a text for ParseValues().

    Raises:
        SweepError: If there are no values, if a value cannot be written as JSON, or if
            two values are equal.
    """
    if isinstance(values, str):
        try:
            values = ParseValues(values)
        except SweepError as error:
            raise SweepError(f"grid.{key} = {error}") from None
    if not isinstance(values, Iterable) or isinstance(values, Mapping):
        allowed = "a list of values or START:STOP:COUNT"
        Refuse(f"grid.{key}", values, allowed)
    written = _AsJson(f"grid.{key}", values)
    plain: list[Any] = json.loads(written)
    if not plain:
        raise SweepError(f"grid.{key} = []: must have at least one value")
    # 1 and 1.0 are one value, 1 and true are two.
    texts = [json.dumps(x) for x in json.loads(written, parse_int=float)]
    text, count = Counter(texts).most_common(1)[0]
    if count > 1:
        text = json.dumps(plain[texts.index(text)])
        raise SweepError(f"grid.{key}: must have different values, and {text} is twice")
    return plain


def PointsOf(grid: GivenGrid) -> tuple[Grid, list[Record]]:
    """Returns the values of each key, and all combinations, the last key fastest.

    Raises:
        SweepError: If the grid cannot be used.
    """
    axes = {key: CheckAxis(key, values) for key, values in grid.items()}
    num_runs = math.prod(map(len, axes.values()))
    if num_runs > MAX_RUNS:
        raise SweepError(f"grid = {num_runs} runs: must be at most {MAX_RUNS}")
    points = [
        dict(zip(axes, values, strict=True))
        for values in itertools.product(*axes.values())
    ]
    return axes, points


def SampledPoints(given: Sequence[Point]) -> tuple[Grid, list[Record]]:
    """Returns the numbers of each run as points of a grid with the key `run`.

    Raises:
        SweepError: If there are none or too many, or not all have the same names.
    """
    points: list[Record] = json.loads(_AsJson("grid", map(dict, given)))
    if not 1 <= len(points) <= MAX_RUNS:
        raise SweepError(f"grid = {len(points)} runs: must be 1 to {MAX_RUNS}")
    names = list(points[0])
    for i, point in enumerate(points):
        if list(point) != names:
            Refuse(f"grid.{i}", list(point), f"numbers of {names}, as for all runs")
    return {"run": list(range(len(points)))}, points
