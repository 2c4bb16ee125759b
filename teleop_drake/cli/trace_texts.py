"""`teleop-drake latency --trace`: a report on measured delays, in words."""

import argparse
import math
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

from teleop_drake.cli import output
from teleop_drake.cli.exit_codes import DONE
from teleop_drake.cli.progress import SweepProgress
from teleop_drake.cli.tables import Align

if TYPE_CHECKING:
    from teleop_drake.study.sweep.trace_report import LoopOverTrace, TraceReport

# A drift is more than chance from this number of standard errors on.
_CLEAR = 3.0


def ReportOnTrace(args: argparse.Namespace) -> int:
    """Reports on the delays in args.trace, and writes and prints the report."""
    from teleop_drake.model.scenario import ARCHITECTURES
    from teleop_drake.study.sweep.trace_report import ReportTrace

    with SweepProgress(args.quiet) as show:
        report = ReportTrace(
            args.trace,
            args.scenario or "one_dof",
            args.controllers or ARCHITECTURES,
            sample_period=0.01 if args.sample_period is None else args.sample_period,
            progress=show,
        )
    written = []
    if args.figure is not None:
        from teleop_drake.study.figures.saving import SaveFigure
        from teleop_drake.study.figures.trace_report import PlotTraceReport

        SaveFigure(PlotTraceReport(report), args.figure)
        written.append(args.figure)
    texts = [*_DelayLines(report), "", *_LoopLines(report)]
    output.Tell(args, report.ToRecord(), *texts, written=written)
    return DONE


def _DelayLines(report: "TraceReport") -> Iterator[str]:
    delays = report.delays
    yield delays.summary
    quantiles = ", ".join(
        f"{percent:g} % {1e3 * value:.4g}"
        for percent, value in delays.quantiles.items()
        if 0 < percent < 100
    )
    yield f"Quantiles in ms: {quantiles}; mean {1e3 * delays.mean:.4g}"
    if len(delays.bursts):
        yield (
            f"Lost: {100 * delays.lost / delays.sent:.3g} % of packets in "
            f"{len(delays.bursts)} bursts, of {delays.bursts.mean():.3g} packets on "
            f"average and {delays.bursts.max()} at most"
        )
    if delays.correlation_time is not None:
        yield (
            f"Delays stay correlated for {delays.correlation_time:.3g} s (to 1/e); "
            f"packets are {delays.step:.3g} s apart"
        )
    what = "Clocks drift apart by" if delays.has_two_clocks else "Least delays grow by"
    is_chance = abs(delays.drift) < _CLEAR * delays.drift_error
    yield (
        f"{what} {1e6 * delays.drift:.3g} us/s, standard error "
        f"{1e6 * delays.drift_error:.2g}{', no more than chance' * is_chance}"
    )


def _LoopLines(report: "TraceReport") -> Iterator[str]:
    yield (
        f"{report.scenario}, packets every {report.sample_period:g} s: what is used is "
        f"{1e3 * report.age:.4g} ms old at most for 99.9 % of the time, there and back "
        f"{report.round_trip:.4g} s"
    )
    policies = list(report.loops[0].outcomes) if report.loops else []
    head = ["", "margin [s]", "of round trip"]
    lines = [[*head, *(f"{policy} [mm/s]" for policy in policies), "least error"]]
    for loop in report.loops:
        errors = [_Error(loop, policy) for policy in policies]
        margin = [_Margin(loop), _Ratio(loop, report)]
        best = loop.best_policy or "-"
        lines.append([loop.controller, *margin, *errors, best])
    yield Align(lines)
    yield from _Sentences(report)


def _Margin(loop: "LoopOverTrace") -> str:
    if loop.margin is None:
        return "-"
    return "any" if loop.margin == math.inf else f"{loop.margin:.4g}"


def _Error(loop: "LoopOverTrace", policy: str) -> str:
    outcome = loop.outcomes[policy]
    if outcome.termination != "completed" or outcome.velocity_error is None:
        return outcome.termination
    return f"{1e3 * outcome.velocity_error:.4g}"


def _Ratio(loop: "LoopOverTrace", report: "TraceReport") -> str:
    if not loop.margin or loop.margin == math.inf:
        return "-"
    return f"{loop.margin / report.round_trip:.2g}"


def _Sentences(report: "TraceReport") -> Iterator[str]:
    """Yields what the table says: who has margin, and which policy serves."""
    known = [loop for loop in report.loops if loop.margin is not None]
    short = [x.controller for x in known if (x.margin or 0.0) <= report.round_trip]
    if short:
        yield f"The margin is shorter than the round trip: {', '.join(short)}."
    elif known:
        yield "Every margin is longer than the round trip."
    counts = Counter(loop.best_policy for loop in report.loops if loop.best_policy)
    for policy, count in counts.most_common(1):
        depth = f" with a depth of {1e3 * report.depth:.4g} ms" * (policy == "playout")
        yield (
            f"The receiver's policy {policy}{depth} has the least velocity error with "
            f"{count} of {counts.total()} architectures."
        )
    for loop in report.loops:
        reasons = {x.reason for x in loop.outcomes.values() if x.reason}
        for reason in sorted(reasons):
            yield f"{loop.controller}: {reason}"
        if loop.note:
            yield f"{loop.controller}, no margin: {loop.note}"
