"""Stable delays against the values of a key of the scenario."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array, Interval, Record
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.model.scenario import AsTeleoperation, LoadScenario
from teleop_drake.model.scenario.overrides import Overrides, ParseOverrides
from teleop_drake.study.analysis.operating_point import POSITION, OperatingPointAt
from teleop_drake.study.analysis.point_stability import MAX_DELAY
from teleop_drake.study.analysis.stability import (
    NO_LOOP,
    AnalyzeStability,
    StabilityAnalysis,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityChart:
    """Stable delays against the values of a key of the scenario.

    Attributes:
        key: The key that varies: a dotted path, or POSITION.
        values: The values of the key, ascending.
        analyses: The analysis for each value.
        max_delay: The largest round-trip delay of the intervals, in s.
    """

    key: str
    values: Array
    analyses: list[StabilityAnalysis]
    max_delay: float

    def PointNames(self, *, with_force_mode: bool = True) -> list[str]:
        """Returns the labels of the loops that any of the analyses has.

        Args:
            with_force_mode: Whether to include loops in which a force is held.
        """
        labels = [
            loop.label
            for analysis in self.analyses
            for loop in (analysis.Loops() if with_force_mode else analysis.points)
        ]
        return list(dict.fromkeys(labels))

    def StableDelays(self, name: str) -> list[list[Interval] | None]:
        """Returns the stable intervals in s at each value; None if no such loop exists.

        Args:
            name: The label of a loop, which is the name of its operating point if no
                force is held.
        """
        return [
            next((x.stable_delays for x in analysis.Loops() if x.label == name), None)
            for analysis in self.analyses
        ]

    def ToRecord(self) -> Record:
        """Returns the JSON object of `teleop-drake analyze --vary`."""
        return {
            "key": self.key,
            "values": self.values.tolist(),
            "analyses": [analysis.ToRecord() for analysis in self.analyses],
        }


def ChartStability(
    name_or_path: str,
    key: str,
    values: ArrayLike,
    *,
    overrides: Overrides = (),
    max_delay: float = MAX_DELAY,
    progress: Callable[[int, int], None] | None = None,
) -> StabilityChart:
    """Analyses a scenario for many values of a key.

    Args:
        name_or_path: A built-in name or a YAML file.
        key: A dotted path to a number, for example environment.layers.bone.stiffness,
            or POSITION. A value of POSITION is a position of the tool on its path in m
            (see OperatingPointAt) and replaces the operating points in the layers. On
            a surface there is no linear model; the model of the layer that begins there
            is used.
        values: Values of the key, at least one.
        overrides: Overrides as in LoadScenario(). The key is set after them.
        max_delay: The largest round-trip delay of the intervals, in s, > 0.
        progress: Called with the number of finished values and the number of all.

    Raises:
        ScenarioError: If a value is not allowed, if there are no values, or as in
            AnalyzeStability().
    """
    points = np.unique(np.asarray(values, dtype=float))
    if points.size == 0:
        Refuse(key, [], "a list of one value or more")
    changes = dict(ParseOverrides(overrides))
    changes.pop(key, None)
    analyses = []
    for i, value in enumerate(points.tolist()):
        chosen = None
        if key == POSITION:
            scenario = LoadScenario(name_or_path, changes)
            loop = AsTeleoperation(scenario, NO_LOOP)
            chosen = [OperatingPointAt(loop, value)]
        else:
            scenario = LoadScenario(name_or_path, {**changes, key: value})
        analyses.append(AnalyzeStability(scenario, points=chosen, max_delay=max_delay))
        if progress is not None:
            progress(i + 1, len(points))
    return StabilityChart(
        key=key, values=points, analyses=analyses, max_delay=max_delay
    )
