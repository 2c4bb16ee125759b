"""Results that analyses of a scenario add to its runs: felt stiffness and margins."""

from collections.abc import Collection
from typing import NamedTuple

from teleop_drake.analysis.stability import AnalyzeStability
from teleop_drake.analysis.transparency import FeltStiffnessLoss
from teleop_drake.scenario import AnyScenario, AsTeleoperation

STIFFNESS_LOSS = "felt_stiffness_loss"
"""The name of the metric that FeltStiffnessLoss() computes."""


class Analysis(NamedTuple):
    """Results of the analyses of a scenario.

    Attributes:
        stiffness_loss: See FeltStiffnessLoss; 0 if it is not one of the metrics.
        reason: Why a delay margin is too small; empty: no margin is too small.
    """

    stiffness_loss: float
    reason: str


def Analyze(
    scenario: AnyScenario, metrics: Collection[str], margin: float | None
) -> Analysis:
    """Performs those analyses of a scenario that metrics or a delay margin need.

    Args:
        margin: Least delay margin of the round trip, in s; None: it is not checked.
    """
    teleoperation = AsTeleoperation(scenario)
    loss = FeltStiffnessLoss(teleoperation) if STIFFNESS_LOSS in metrics else 0.0
    if margin is None:
        return Analysis(loss, "")
    forward = teleoperation.forward_channel.delay
    trip = forward + teleoperation.return_channel.delay
    found = AnalyzeStability(teleoperation, max_delay=trip + margin + 1e-3)
    for loop in found.Loops():
        longest = loop.delay + margin
        if not any(a <= loop.delay and longest <= b for a, b in loop.stable_delays):
            return Analysis(loss, f"{loop.label}: a delay margin below {margin:g} s")
    return Analysis(loss, "")
