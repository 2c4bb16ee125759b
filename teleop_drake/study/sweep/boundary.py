"""The largest stable delays of a sweep's loops, from their characteristic roots."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.model.scenario import AsTeleoperation
from teleop_drake.model.scenario.overrides import ALIASES
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.sweep.plan import SweepPlan

# Each value needs an analysis, which takes about a tenth of a second.
_MAX_ANALYSES = 200


@dataclass(kw_only=True, eq=False)
class Boundary:
    """The delays at which a loop becomes unstable at an operating point.

    Attributes:
        point: Label of the loop: the name of the operating point, and whether the
            operator holds a force there. If the operator holds a force after contact,
            only that loop is listed, because runs stay in it.
        ends: The delay in s at which the loop becomes unstable as the delay grows from
            0, for each value of the other key (k). 0 if the loop is unstable without
            delay; NaN if there is no such operating point, or no model of its loop.
        note: Why there is no model of the loop, else empty; see PointStability.untold.
    """

    point: str
    ends: Array
    note: str = ""


def FindBoundaries(
    plan: SweepPlan,
    delay_key: str,
    key: str,
    values: Sequence[Any],
    *,
    others: Mapping[str, Any],
) -> list[Boundary]:
    """Returns the largest stable delays of a sweep's loops over one of its keys.

    Args:
        plan: The sweep.
        delay_key: The key of the sweep that is a delay: delay, forward_delay or
            return_delay.
        key: The other key.
        values: The values of the other key.
        others: The values of further keys that the sweep varies.

    Returns:
        A boundary for each operating point.

    Raises:
        ValueError: If there is no linear model, if there are too many values, if gains
            derive from the delay, or if delay_key is not a delay.
    """
    if delay_key not in ("delay", "forward_delay", "return_delay"):
        Refuse(delay_key, "a key of the grid", "a delay of exact channels")
    if len(values) > _MAX_ANALYSES:
        Refuse(key, f"{len(values)} values", f"at most {_MAX_ANALYSES} to be analysed")
    largest = max(float(x) for x in plan.axes[delay_key])
    first = {name: axis[0] for name, axis in plan.axes.items()} | dict(others)
    boundaries: dict[str, Boundary] = {}
    for i, value in enumerate(values):
        point = first | {key: value, delay_key: largest}
        scenario = AsTeleoperation(plan.Load(point), "there is no loop to analyse")
        if scenario.controller.Chosen().has_gains_of_delay:
            raise ValueError("gains derive from the delay: each run has its own loop")
        for constant in scenario.ConstantDelays():
            if constant.note is not None:
                raise ValueError(constant.note)
        # The round trip is the swept delay, once or twice, and a fixed delay.
        fixed = {
            "delay": 0.0,
            "forward_delay": scenario.return_channel.delay,
            "return_delay": scenario.forward_channel.delay,
        }[delay_key]
        share = len(ALIASES[delay_key])
        max_delay = 1.01 * (share * largest + fixed) + 1e-3
        for found in AnalyzeStability(scenario, max_delay=max_delay).points:
            loop = found.force_mode or found
            unknown = Boundary(point=loop.label, ends=np.full(len(values), math.nan))
            boundary = boundaries.setdefault(loop.label, unknown)
            if loop.untold:
                boundary.note = loop.untold
                continue
            # The boundary is the end of the stable interval that begins at 0, as a
            # value of the swept delay. An interval cut off at max_delay has no end.
            end = next((end for begin, end in loop.stable_delays if begin == 0), 0.0)
            boundary.ends[i] = math.inf
            if end < max_delay:
                boundary.ends[i] = max((end - fixed) / share, 0.0)
    return list(boundaries.values())
