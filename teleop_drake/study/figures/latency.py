"""Figure of the delay between two recorded signals."""

import numpy as np
from matplotlib.axes import Axes

from teleop_drake.loops.framework.validation import CheckKind
from teleop_drake.study.analysis.latency import Latency
from teleop_drake.study.figures import style
from teleop_drake.study.figures.layout import MakePanels
from teleop_drake.study.figures.style import COLORS, GREY, Figure, Key, Look

_HEIGHT = 5.6  # inches; of three rows

# The most rows of the signals that are drawn, from the middle of the record.
_MOST_ROWS = 600

# The last dead time that the search shows, as a multiple of the end of the interval.
_ZOOM = 5.0

_COMMAND_STYLE: Look = {"color": GREY, "linewidth": 0.9}
_RESPONSE_STYLE: Look = {
    "color": COLORS[0],
    "linestyle": "none",
    "marker": ".",
    "markersize": 2.5,
}
_FIT_STYLE: Look = {"color": COLORS[1], "linewidth": 1.0}
_BAND_STYLE: Look = {"color": COLORS[1], "alpha": 0.2, "linewidth": 0}


def PlotLatency(latency: Latency) -> Figure:
    """Plots the signals with the fit, the dead time over the record, and the interval.

    The last panel shows the least error that was found with each dead time.

    Args:
        latency: As EstimateLatency() returns it.
    """
    CheckKind("latency", latency, Latency, "a Latency, which EstimateLatency() returns")
    figure, panels = MakePanels(3, 1, height=_HEIGHT, share_x="none", share_y="none")
    signals, course, search = panels[:, 0]
    _DrawSignals(signals, latency)
    _DrawCourse(course, latency)
    _DrawSearch(search, latency)
    figure.align_ylabels()
    handles = [
        Key("command, scaled", **_COMMAND_STYLE),
        Key("response", **_RESPONSE_STYLE),
        Key("fit", **_FIT_STYLE),
        Key("95 % interval", color=COLORS[1], alpha=0.2, linewidth=6),
    ]
    style.AddLegend(figure, handles, fontsize=style.SMALL_FONT_SIZE)
    return figure


def _DrawSignals(ax: Axes, latency: Latency) -> None:
    pair = latency.pair
    middle = len(pair.t) // 2
    first = max(middle - _MOST_ROWS // 2, 0)
    rows = slice(first, first + _MOST_ROWS)
    t = pair.t[rows]
    fit = latency.found.fit
    modelled = pair.columns(fit) @ pair.combination(fit)
    command = np.interp(t, pair.command_time, pair.command)
    ax.plot(t, latency.offset + latency.gain * command, **_COMMAND_STYLE)
    ax.plot(t, pair.y[rows], **_RESPONSE_STYLE)
    ax.plot(t, modelled[rows], **_FIT_STYLE)
    ax.set(xlabel="time [s]", ylabel="signals", xlim=(t[0], t[-1]))


def _DrawCourse(ax: Axes, latency: Latency) -> None:
    course = latency.course
    known = np.isfinite(course.delays)
    ends = np.array([latency.pair.t[0], latency.pair.t[-1]])
    drift = latency.drift * (ends - latency.pair.middle)
    low, high = (1e3 * (x + drift) for x in latency.interval)
    ax.fill_between(ends, low, high, **_BAND_STYLE)
    if latency.delay is not None:
        ax.plot(ends, 1e3 * (latency.delay + drift), **_FIT_STYLE)
        ax.errorbar(
            course.times[known],
            1e3 * course.delays[known],
            1.96e3 * course.errors[known],
            color=COLORS[0],
            fmt="o",
            markersize=3,
            linewidth=0.8,
        )
    ax.set(xlabel="time [s]", ylabel="dead time [ms]", xlim=tuple(ends))


def _DrawSearch(ax: Axes, latency: Latency) -> None:
    delays, errors = latency.search
    ax.plot(1e3 * delays, errors, color=COLORS[0], linewidth=0.9)
    for low, high in latency.found.intervals:
        ax.axvspan(1e3 * low, 1e3 * high, **_BAND_STYLE)
    if latency.delay is not None:
        ax.axvline(1e3 * latency.delay, **_FIT_STYLE)
    last = delays[-1]
    if latency.delay is not None:
        last = min(last, _ZOOM * latency.interval[1])
    ax.set(
        xlabel="dead time [ms]",
        ylabel="error of the fit",
        xlim=(0.0, 1e3 * last),
        ylim=(0.0, 1.05 * float(errors.max()) or 1.0),
    )
