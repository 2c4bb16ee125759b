"""Relations between metrics of two runs: claims that are data.

judge.js evaluates the same data, by the same rules, in the executable thesis.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.thesis.runs import Both

SETTLING = "collision.settling_time"
"""The metric that is infinite for a run that does not have it."""

NEVER = 1e-9
"""A factor that makes any finite time less than a settling time: only if one is not."""

SCALES = {"mm": 1e3, "mm/s": 1e3, "mN": 1e3, "%": 1e2}
"""The number of each unit in one SI unit; 1 for all other units."""

_HOLDS: dict[str, Callable[[Any, Any, float], Any]] = {
    "<": lambda x, y, _: x < y,
    ">": lambda x, y, _: x > y,
    "=": lambda x, y, tolerance: abs(x / y - 1) < tolerance,
}


class Relation(NamedTuple):
    """A relation of a metric of one run to a multiple of a metric of another run.

        metric(run)   relation   factor * of_metric(of)

    It holds if it holds on every axis. It does not hold for a run that lacks a metric;
    only a settling time is infinite in that case.

    Attributes:
        metric: The metric; see RunMetrics().
        unit: Its unit in texts.
        run: The run, `direct` or `adaptive`.
        relation: `<`, `>` or `=`.
        factor: See above.
        of: The other run, or `speed` for the commanded velocity along x.
        of_metric: The metric of the other run; empty: the same.
        tolerance: The largest relative difference for `=`.
    """

    metric: str
    unit: str = ""
    run: str = "adaptive"
    relation: str = "<"
    factor: float = 1.0
    of: str = "direct"
    of_metric: str = ""
    tolerance: float = 0.0

    def Holds(self, both: Both) -> bool:
        """Returns whether it holds for the runs of a task."""
        value = ValuesOf(both, self.run, self.metric)
        other = ValuesOf(both, self.of, self.of_metric or self.metric)
        holds = _HOLDS[self.relation](value, self.factor * other, self.tolerance)
        return bool(np.all(holds))


def ValuesOf(both: Both, run: str, metric: str) -> Array:
    """Returns a metric of a run on each axis, or the commanded speed."""
    if run == "speed":
        v_d = both.direct.recording.teleoperation.surgeon.velocity
        return np.asarray(v_d, dtype=float)[:1]
    value = getattr(both, run)[metric]
    if value is None:
        value = math.inf if metric == SETTLING else math.nan
    return np.atleast_1d(np.asarray(value, dtype=float))


def Compare(relations: Sequence[Relation], both: Both) -> str:
    """Returns the numbers that decide whether relations hold, as text."""
    texts: dict[str, str] = {}
    for one in relations:
        for metric in filter(None, (one.metric, one.of_metric)):
            if one.of == "speed":
                share = ValuesOf(both, one.run, metric) / ValuesOf(both, "speed", "")
                texts[metric] = f"{share[0]:.1%}"
                continue
            direct, adaptive = (ValuesOf(both, x, metric) for x in Both._fields)
            texts[metric] = (
                f"direct {Axes(direct)}; adaptive {Axes(adaptive)} {one.unit}"
            )
            if len(direct) == 1:
                texts[metric] = Pair(direct[0], adaptive[0], one.unit)
    if len(texts) == 1:
        return texts.popitem()[1]
    return "; ".join(f"{WordsOf(metric)}: {text}" for metric, text in texts.items())


def WordsOf(metric: str) -> str:
    """Returns the last part of a metric's name in words."""
    return metric.rpartition(".")[2].replace("_", " ")


def Pair(direct: float, adaptive: float, unit: str = "") -> str:
    """Returns the values of direct force and of the adaptive controller."""
    scale = SCALES.get(unit, 1.0)
    texts = [
        "not in the run" if x == math.inf else f"{scale * x:.4g}"
        for x in (direct, adaptive)
    ]
    return f"direct {texts[0]}, adaptive {texts[1]} {unit}"


def Axes(values: Iterable[float], axes: str = "xyz", form: str = ".3g") -> str:
    """Returns one value per axis, such as "x 0.1, y 0.2"."""
    return ", ".join(f"{a} {x:{form}}" for a, x in zip(axes, values, strict=False))
