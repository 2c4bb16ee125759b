"""The outcome of a run, with either engine."""

from dataclasses import dataclass, field

from teleop_drake.channels.packet_statistics import PacketStatistics
from teleop_drake.numerics.step_polynomials import Series


@dataclass(kw_only=True)
class Outcome:
    """What came out of a run.

    Attributes:
        engine: As in SolverStatistics.
        series: The times (N,), the signals by name (N, k), and the steps.
        steps: Number of steps taken.
        derivative_evaluations: Number of evaluations of the time derivatives.
        wall_time: Real time that it took, in s.
        termination: As in Recording, and so is the reason.
        reason: Why it did not complete.
        is_too_fast: Whether it ended because the tool was faster than allowed.
        channels: As in Recording.
    """

    engine: str
    series: Series
    steps: int
    derivative_evaluations: int
    wall_time: float
    termination: str
    reason: str
    is_too_fast: bool
    channels: dict[str, PacketStatistics] = field(default_factory=dict)
