"""What measured delays say, and what they mean for the loop."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from teleop_drake.loops.delays.packet_options import Receiver
from teleop_drake.loops.framework.arrays import Array, Indices, Record
from teleop_drake.loops.framework.validation import CheckKind, ScenarioError
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.scenario import ARCHITECTURES, AsTeleoperation, LoadScenario
from teleop_drake.model.scenario.overrides import Override
from teleop_drake.model.tables.measured import BETWEEN_STAMPS
from teleop_drake.model.tables.packets import Packets, ReadPackets
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.numerics.delay_statistics import (
    burst_lengths,
    delay_autocorrelation,
    least_delay_line,
    least_delay_slope_error,
)
from teleop_drake.study.sweep.plan import PlanSweep
from teleop_drake.study.sweep.run import Execution, RunSweep

PERCENTS = (0.0, 50.0, 90.0, 95.0, 99.0, 99.9, 100.0)
"""The percentages of the quantiles of delays."""

HIGH = 99.9
"""The percentage of the quantile with which margins are compared."""

# The most lags of the autocorrelation, the parts of a record for the error of its
# drift, and the instants at which the age of what is used is evaluated.
_MOST_LAGS = 200
_NUM_PARTS = 10
_NUM_INSTANTS = 200_001

# What a receiver's policy is judged by.
_SCORE = "velocity_rms_error"


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayStatistics:
    """What measured delays say.

    Attributes:
        summary: A line that tells what was read.
        sent: The number of packets.
        lost: The number of lost packets.
        mean: Mean delay one way, s.
        std: Its standard deviation, s.
        quantiles: The delays in s by the percentages in PERCENTS.
        bursts: The number of packets in each run of lost ones.
        step: The time between packets, s; the median.
        autocorrelation: Of the delays, at lags from 0, in packets.
        correlation_time: The time in s after which it falls below 1/e. None: it does
            not, or the delays do not vary.
        drift: The slope of the least delays, s/s.
        drift_error: Its standard error, s/s.
        has_two_clocks: Whether the drift is that of the clocks of sender and receiver.
    """

    summary: str
    sent: int
    lost: int
    mean: float
    std: float
    quantiles: dict[float, float]
    bursts: Indices
    step: float
    autocorrelation: Array
    correlation_time: float | None
    drift: float
    drift_error: float
    has_two_clocks: bool


def DescribeDelays(packets: Packets) -> DelayStatistics:
    """Returns the statistics of measured packets.

    Raises:
        ScenarioError: If fewer than two packets arrived.
    """
    is_lost = np.isnan(packets.delays)
    times = packets.times[~is_lost]
    delays = packets.delays[~is_lost]
    if len(delays) < 2 or times[-1] == times[0]:
        raise ScenarioError("--trace: must have two delays at different times")
    step = float(np.median(np.diff(packets.times)))
    num_lags = min(_MOST_LAGS, len(packets.delays) // 2)
    correlation = delay_autocorrelation(packets.delays, num_lags)
    below = np.flatnonzero(correlation < math.exp(-1))
    _, drift = least_delay_line(times, delays)
    return DelayStatistics(
        summary=packets.Summary(),
        sent=len(packets.delays),
        lost=int(is_lost.sum()),
        mean=float(delays.mean()),
        std=float(delays.std()),
        quantiles={x: float(np.percentile(delays, x)) for x in PERCENTS},
        bursts=burst_lengths(is_lost),
        step=step,
        autocorrelation=correlation,
        correlation_time=float(below[0] * step) if len(below) else None,
        drift=drift,
        drift_error=least_delay_slope_error(times, delays, _NUM_PARTS),
        has_two_clocks=packets.kind == BETWEEN_STAMPS,
    )


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A run over the trace.

    Attributes:
        termination: How it ended, as Recording.termination, or `failed`.
        reason: Why it ended before its time, or failed; empty if it did not.
        velocity_error: The root mean square error of the tool's velocity, m/s; the
            length of the vector. None: the run did not get so far.
        force_error: The same of the force that is felt, N.
    """

    termination: str
    reason: str
    velocity_error: float | None
    force_error: float | None


@dataclass(frozen=True)
class LoopOverTrace:
    """An architecture over the trace.

    Attributes:
        controller: Its kind.
        margin: The least round-trip delay in s at which a point of the loop is no
            longer stable; infinity: none up to the largest that was examined, 0: the
            loop is not stable without delay. None: it has no linear model.
        note: Why there is no margin; empty if there is one.
        outcomes: The run with each policy of the receiver.
    """

    controller: str
    margin: float | None
    note: str
    outcomes: Mapping[str, Outcome]

    @property
    def best_policy(self) -> str | None:
        """The policy with the least velocity error of completed runs; None: none."""
        errors = {
            policy: outcome.velocity_error
            for policy, outcome in self.outcomes.items()
            if outcome.termination == "completed" and outcome.velocity_error is not None
        }
        return min(errors, key=lambda policy: errors[policy]) if errors else None


@dataclass(frozen=True, kw_only=True, eq=False)
class TraceReport:
    """What measured delays say, and what they mean for the loop.

    Attributes:
        packets: The measured packets.
        delays: Their statistics.
        scenario: The name of the scenario.
        sample_period: The time between packets of the loop, s.
        depth: The depth of the policy `playout`, s: the 99 % quantile of the delays.
        age: The 99.9 % quantile of the age of what the policy `newest` uses, s: with
            the time until the next packet, and with losses.
        loops: The architectures.
    """

    packets: Packets
    delays: DelayStatistics
    scenario: str
    sample_period: float
    depth: float
    age: float
    loops: Sequence[LoopOverTrace] = field(default_factory=list)

    @property
    def round_trip(self) -> float:
        """Twice the age, s: the round trip if both ways are as measured."""
        return 2 * self.age

    def ToRecord(self) -> Record:
        """Returns the numbers for JSON."""
        delays = asdict(self.delays)
        delays["quantiles"] = {f"{k:g}": x for k, x in delays["quantiles"].items()}
        delays["bursts"] = self.delays.bursts.tolist()
        delays["autocorrelation"] = [
            None if math.isnan(x) else x for x in self.delays.autocorrelation.tolist()
        ]
        if not math.isfinite(self.delays.drift_error):
            delays["drift_error"] = None
        loops: list[Record] = []
        for loop in self.loops:
            record = asdict(loop) | {"best_policy": loop.best_policy}
            if loop.margin == math.inf:
                record["margin"] = None
                record["note"] = "stable at every delay examined"
            loops.append(record)
        return {
            "scenario": self.scenario,
            "delays": delays,
            "sample_period": self.sample_period,
            "playout_depth": self.depth,
            "age": self.age,
            "round_trip": self.round_trip,
            "loops": loops,
        }


def ReportTrace(
    trace: str | Mapping[str, Any],
    scenario: str = "one_dof",
    controllers: Sequence[str] = ARCHITECTURES,
    *,
    overrides: Sequence[Override] = (),
    sample_period: float = 0.01,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TraceReport:
    """Reports on measured delays, and runs a scenario over them.

    Both channels send packets that are delayed and lost as measured. The trace is
    repeated if it is shorter than a run.

    Args:
        trace: The file of the delays, or a mapping; see tables.ReadPackets().
        scenario: A teleoperation, by its name or file.
        controllers: The architectures, kinds of controllers.
        overrides: Overrides of the scenario.
        sample_period: The time between packets, s.
        jobs: Number of worker processes, as in Sweep().
        progress: Called with the number of finished runs and the number of all runs.

    Raises:
        ScenarioError: If the file or an argument is not allowed.
    """
    CheckKind("trace", trace, str | Mapping, "a file of measured delays")
    packets = ReadPackets("--trace", trace)
    delays = DescribeDelays(packets)
    channel = {
        "kind": "network",
        "delay": 0.0,
        "sample_period": sample_period,
        "trace": trace,
        "trace_end": "repeat",
    }
    loaded = LoadScenario(scenario, [*overrides, ("channel", channel)])
    first = AsTeleoperation(loaded, "only its channels send packets")
    forward = first.forward_channel
    assert isinstance(forward, NetworkChannelConfig)
    age = AgeQuantile(forward, first.duration)
    depth = delays.quantiles[99.0]
    receivers = {
        "newest": {"policy": "newest"},
        "playout": {"policy": "playout", "depth": depth},
        "extrapolate": {"policy": "extrapolate"},
    }
    plan = PlanSweep(
        scenario,
        {
            "controller": list(controllers),
            "channel": [channel | {"receiver": x} for x in receivers.values()],
        },
        overrides=overrides,
    )
    execution = Execution(jobs=jobs)
    if progress is not None:
        execution = replace(execution, progress=progress)
    outcomes = list(map(_OutcomeOf, RunSweep(plan, execution).records))
    loops = []
    for controller in controllers:
        margin, note = _Margin(scenario, controller, overrides, age)
        runs = dict(zip(receivers, outcomes, strict=False))
        del outcomes[: len(receivers)]
        loops.append(LoopOverTrace(controller, margin, note, runs))
    return TraceReport(
        packets=packets,
        delays=delays,
        scenario=first.name,
        sample_period=sample_period,
        depth=depth,
        age=age,
        loops=loops,
    )


def AgeQuantile(channel: NetworkChannelConfig, duration: float) -> float:
    """Returns the 99.9 % quantile over time of the age of the newest packet, s.

    Args:
        channel: The channel of packets.
        duration: The time until which packets are sent, s.

    Raises:
        ScenarioError: If no packet arrives.
    """
    network = channel.Network(duration)
    shown, stamps = network.ShownUntil(Receiver(), duration)
    if not len(shown):
        raise ScenarioError(f"trace: must deliver a packet within {duration:g} s")
    times = np.linspace(shown[0], duration, _NUM_INSTANTS)
    latest = np.searchsorted(shown, times, side="right") - 1
    return float(np.percentile(times - stamps[latest], HIGH))


def _Margin(
    scenario: str, controller: str, overrides: Sequence[Override], age: float
) -> tuple[float | None, str]:
    """Returns the least delay margin of an architecture, and why there is none."""
    constant = ("channel", {"kind": "transport", "delay": age})
    try:
        loaded = LoadScenario(
            scenario, [*overrides, constant, ("controller", controller)]
        )
        analysis = AnalyzeStability(loaded)
    except ValueError as error:
        return None, str(error)
    margins = []
    for loop in analysis.Loops():
        if not loop.stable_delays or loop.stable_delays[0][0] > 0:
            return 0.0, ""
        margins.append(math.inf if loop.margin is None else loop.margin.delay)
    return min(margins, default=math.inf), ""


def _OutcomeOf(record: Record) -> Outcome:
    metrics = record["metrics"] or {}
    errors = [_Length(metrics.get(name)) for name in (_SCORE, "force_rms_error")]
    return Outcome(
        termination=record["status"],
        reason=record["reason"] or "",
        velocity_error=errors[0],
        force_error=errors[1],
    )


def _Length(values: Sequence[float | None] | None) -> float | None:
    if not values or any(x is None for x in values):
        return None
    return float(np.linalg.norm(np.array(values, dtype=float)))
