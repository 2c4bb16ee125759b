"""Figure of measured delays and of what they mean for the loop."""

import math

import numpy as np
from matplotlib.axes import Axes

from teleop_drake.loops.framework.validation import CheckKind
from teleop_drake.study.figures import style
from teleop_drake.study.figures.layout import MakePanels
from teleop_drake.study.figures.style import COLORS, GREY, MARK_STYLE, Figure, Key, Look
from teleop_drake.study.numerics.delay_statistics import least_delay_line
from teleop_drake.study.sweep.trace_report import HIGH, TraceReport

_HEIGHT = 6.4  # inches; of three rows

_TEXT = style.SMALL_FONT_SIZE - 1

_LOST_STYLE: Look = {"marker": "x", "color": COLORS[1]}
_LINE_STYLE: Look = {"color": COLORS[1], "linewidth": 0.9}
_HIGH_STYLE: Look = {"color": GREY, "linewidth": 0.9, "linestyle": "--"}
_MARKERS = {"newest": "o", "playout": "s", "extrapolate": "^"}


def PlotTraceReport(report: TraceReport) -> Figure:
    """Plots delays, their quantiles, correlation and bursts, margins and runs.

    Args:
        report: As ReportTrace() returns it.
    """
    allowed = "a TraceReport, which ReportTrace() returns"
    CheckKind("report", report, TraceReport, allowed)
    figure, panels = MakePanels(3, 2, height=_HEIGHT, share_x="none", share_y="none")
    _DrawDelays(panels[0, 0], report)
    _DrawExceeded(panels[0, 1], report)
    _DrawCorrelation(panels[1, 0], report)
    _DrawBursts(panels[1, 1], report)
    _DrawMargins(panels[2, 0], report)
    _DrawRuns(panels[2, 1], report)
    handles = [
        Key("lost packet", **_LOST_STYLE, **MARK_STYLE),
        Key("line of least delays", **_LINE_STYLE),
        Key(f"{HIGH:g} %", **_HIGH_STYLE),
        *(
            Key(policy, color=COLORS[i], marker=marker, linestyle="none", markersize=4)
            for i, (policy, marker) in enumerate(_MARKERS.items())
        ),
    ]
    style.AddLegend(figure, handles, fontsize=style.SMALL_FONT_SIZE)
    return figure


def _DrawDelays(ax: Axes, report: TraceReport) -> None:
    times = report.packets.times
    is_lost = np.isnan(report.packets.delays)
    arrived = times[~is_lost]
    delays = report.packets.delays[~is_lost]
    ax.plot(arrived, 1e3 * delays, ".", color=COLORS[0], markersize=1.5)
    value, slope = least_delay_line(arrived, delays)
    ax.plot(arrived[[0, -1]], 1e3 * (value + slope * arrived[[0, -1]]), **_LINE_STYLE)
    style.MarkAbove(ax, times[is_lost], **_LOST_STYLE)
    ax.set(
        xlabel="time [s]",
        ylabel="delay one way [ms]",
        xlim=(0.0, times[-1]),
        ylim=(0.0, None),
    )


def _DrawExceeded(ax: Axes, report: TraceReport) -> None:
    """Draws the share of packets that take longer, and the high quantiles."""
    delays = np.sort(report.packets.delays[~np.isnan(report.packets.delays)])
    shares = 1 - np.arange(len(delays)) / len(delays)
    ax.step(1e3 * delays, 100 * shares, where="pre", color=COLORS[0], linewidth=0.9)
    ax.axvline(1e3 * report.delays.quantiles[HIGH], **_HIGH_STYLE)
    ax.set(
        xlabel="delay one way [ms]",
        ylabel="packets that take longer [%]",
        yscale="log",
        ylim=(50 / len(delays), 100.0),
    )


def _DrawCorrelation(ax: Axes, report: TraceReport) -> None:
    correlation = report.delays.autocorrelation
    lags = np.arange(len(correlation)) * report.delays.step
    ax.plot(lags, correlation, color=COLORS[0], linewidth=0.9)
    ax.axhline(math.exp(-1), **_HIGH_STYLE)
    ax.set(
        xlabel="time between packets [s]",
        ylabel="autocorrelation of delay",
        xlim=(0.0, max(lags[-1], report.delays.step)),
        ylim=(-0.5, 1.05),
    )


def _DrawBursts(ax: Axes, report: TraceReport) -> None:
    bursts = report.delays.bursts
    lengths, counts = np.unique(bursts, return_counts=True)
    ax.bar(lengths, counts, color=COLORS[0], width=0.7)
    ax.set(
        xlabel="packets lost in a row",
        ylabel="bursts",
        xlim=(0.3, max(bursts.max(initial=1), 5) + 0.7),
        ylim=(0, max(counts.max(initial=1), 1) * 1.05),
    )


def _DrawMargins(ax: Axes, report: TraceReport) -> None:
    """Draws the delay margin of each architecture beside the round trip."""
    margins = [loop.margin for loop in report.loops]
    finite = [x for x in margins if x is not None and math.isfinite(x)]
    end = 1.25 * max([*finite, report.round_trip])
    words = {None: "no linear model", 0.0: "not stable without delay"}
    for row, margin in enumerate(margins):
        if not margin:
            ax.text(0.02 * end, row, words[margin], va="center", fontsize=_TEXT)
            continue
        is_enough = margin > report.round_trip
        color = COLORS[0] if is_enough else COLORS[1]
        ax.barh(row, min(margin, end), color=color, height=0.6)
        if margin > end:
            text = "at every delay examined"
            ax.text(
                0.98 * end,
                row,
                text,
                va="center",
                ha="right",
                fontsize=_TEXT,
                color="white",
            )
    ax.axvline(report.round_trip, **_HIGH_STYLE)
    _NameRows(ax, report)
    ax.set(xlabel="delay margin, round trip [s]", xlim=(0.0, end))


def _DrawRuns(ax: Axes, report: TraceReport) -> None:
    """Draws the velocity error of each architecture and policy; hollow: it ended."""
    largest = 0.0
    for row, loop in enumerate(report.loops):
        for i, (policy, outcome) in enumerate(loop.outcomes.items()):
            if outcome.velocity_error is None:
                continue
            look: Look = {"color": COLORS[i], "marker": _MARKERS[policy]}
            is_whole = outcome.termination == "completed"
            look["fillstyle"] = "full" if is_whole else "none"
            ax.plot(1e3 * outcome.velocity_error, row, markersize=4, **look)
            if is_whole:
                largest = max(largest, 1e3 * outcome.velocity_error)
        if all(x.velocity_error is None for x in loop.outcomes.values()):
            place = ax.get_yaxis_transform()
            ax.text(0.02, row, "no run", va="center", fontsize=_TEXT, transform=place)
    _NameRows(ax, report)
    ax.set(xlabel="error of the velocity, rms [mm/s]")
    ax.set_xlim(0.0, 1.1 * largest if largest > 0 else 1.0)


def _NameRows(ax: Axes, report: TraceReport) -> None:
    names = [loop.controller.replace("_", " ") for loop in report.loops]
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
