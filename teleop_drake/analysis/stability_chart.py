"""Stable delays against the values of a key of the scenario."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.analysis.point_stability import MAX_DELAY
from teleop_drake.analysis.stability import (
    NO_LOOP,
    AnalyzeStability,
    StabilityAnalysis,
)
from teleop_drake.arrays import Array
from teleop_drake.linear_model.operating_point import POSITION, OperatingPointAt
from teleop_drake.scenario import AsTeleoperation, LoadScenario
from teleop_drake.scenario.overrides import ParseOverrides
from teleop_drake.validation import Refuse


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityChart:
    """Stable delays against the values of a key of the scenario.

    Attributes:
        key: What varies: a dotted path, or POSITION.
        values: Its values, ascending.
        analyses: One for each value.
        max_delay: Up to which round-trip delay the intervals reach, in s.
    """

    key: str
    values: Array
    analyses: list[StabilityAnalysis]
    max_delay: float

    def PointNames(self, *, with_force_mode: bool = True) -> list[str]:
        """Returns the labels of the loops that any of the analyses has.

        Args:
            with_force_mode: Whether those in which the operator holds a force count.
        """
        names: dict[str, None] = {}
        for analysis in self.analyses:
            loops = analysis.Loops() if with_force_mode else analysis.points
            names |= dict.fromkeys(loop.label for loop in loops)
        return list(names)

    def StableDelays(self, name: str) -> list[list[tuple[float, float]] | None]:
        """Returns the stable intervals in s at each value; None: no such loop.

        Args:
            name: Label of a loop, which is the name of its operating point unless a
                force is held.
        """
        result: list[list[tuple[float, float]] | None] = []
        for analysis in self.analyses:
            found = [loop for loop in analysis.Loops() if loop.label == name]
            result.append(found[0].stable_delays if found else None)
        return result

    def ToRecord(self) -> dict[str, Any]:
        """Returns what `teleop-drake analyze --vary` writes as JSON."""
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
    overrides: Mapping[str, Any] | Sequence[str] = (),
    max_delay: float = MAX_DELAY,
    progress: Callable[[int, int], None] | None = None,
) -> StabilityChart:
    """Analyses a scenario for many values of a key.

    Args:
        key: A dotted path to a number, for example environment.layers.bone.stiffness;
            or POSITION, where the tool is on its path in m (see OperatingPointAt),
            instead of one operating point in each layer. On a surface, where there is
            no linear model, it is that of what begins there.
        values: Values of the key, at least one.
        overrides: As for LoadScenario; the key comes after them.
        max_delay: Up to which round-trip delay intervals are wanted, in s, > 0.
        progress: Called with the number of finished values and their number.

    Raises:
        ScenarioError: If a value is not allowed, as AnalyzeStability, or if there is
            none.
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
