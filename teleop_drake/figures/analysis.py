"""Figures of the analysis: Bode and Nyquist plots, stability charts, transparency.

As those of figures.runs, they belong to the caller, and runs.SaveFigure
writes them.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from teleop_drake.analysis.stability import (
    PointStability,
    StabilityAnalysis,
)
from teleop_drake.analysis.stability_chart import StabilityChart
from teleop_drake.analysis.transparency import Transparency
from teleop_drake.environments import ShownNormal
from teleop_drake.figures.style import (
    FONT_SIZE,
    GREY,
    LINES,
    SMALL_FONT_SIZE,
    WIDTH,
    AxisLabel,
    CellEdges,
    Figure,
    MapLimits,
    RunColor,
)
from teleop_drake.linear_model.operating_point import POSITION
from teleop_drake.numerics.delay_margin import eigenloci, sweep_frequencies
from teleop_drake.validation import Refuse

_ROW_HEIGHT = 1.9  # inches

# What a Bode plot shows beyond the slowest and the fastest crossover.
_DECADES = 1.5

_MAGNITUDES = (1e-3, 1e3)

# A locus below this is zero, as behind a predictor with an exact model.
_NOTHING = 1e-9

# The Nyquist plot: its half width, and how many points its curves have.
_NYQUIST_RANGE = 2.5
_NUM_NYQUIST_POINTS = 6000

# What is shown of Llewellyn's parameter; less is drawn at the lower edge.
_LLEWELLYN_RANGE = (-1.5, 3.0)
# Less than this below 1 is rounding.
_LLEWELLYN_MARGIN = 1e-6

_STABLE = "#56B4E9"
# Where Llewellyn's parameter promises nothing.
_ACTIVE = "#F7DFCF"
_UNSTABLE = "#F0F0F0"
_UNRESOLVED = "#DCDCDC"


def PlotBode(analysis: StabilityAnalysis) -> Figure:
    """Plots magnitude and phase of L(j w) at each operating point.

    A line for each eigenlocus. The phase is that of L alone (thin) and with the
    scenario's delay (thick), -w T more. Dots mark the gain crossovers: in the thick
    phase, a dot of a crossover with falling magnitude has to lie above -180 degrees.
    Where the model cannot tell a motion from a neutral one, the ground is grey.

    Raises:
        ValueError: If no operating point has a loop.
    """
    points = _WithLoop(analysis)
    figure = Figure(figsize=(WIDTH, 2 * _ROW_HEIGHT), layout="constrained")
    axes = figure.subplots(2, len(points), sharex="col", sharey="row", squeeze=False)
    limits = [-200.0, 0.0]  # Also where every locus is nothing.
    for (top, bottom), point in zip(axes.T, points, strict=True):
        w = _BodeFrequencies(point)
        low, high = _DrawLoci(top, bottom, point, w)
        limits = [min(limits[0], low), max(limits[1], high)]
        top.axhline(1, color=GREY, linewidth=0.6, zorder=0)
        bottom.axhline(-180, color=GREY, linewidth=0.6, zorder=0)
        top.set_title(_Title(point), fontsize=FONT_SIZE)
        if point.unresolved > w[0]:
            for ax in (top, bottom):
                ax.axvspan(w[0], point.unresolved, color=_UNRESOLVED, lw=0, zorder=-1)
        top.set_xlim(w[0], w[-1])
        top.set_ylim(*_MAGNITUDES)
        bottom.set_xlabel("frequency [rad/s]", fontsize=FONT_SIZE)
        for ax in (top, bottom):
            _Format(ax)
    bottom.set_ylim(
        math.floor(limits[0] / 90) * 90, math.ceil(limits[1] / 90 + 0.5) * 90
    )
    bottom.yaxis.set_major_locator(_Multiple(90))
    axes[0, 0].set_ylabel("|eigenlocus of L|", fontsize=FONT_SIZE)
    axes[1, 0].set_ylabel("phase [°]", fontsize=FONT_SIZE)
    _AddBodeLegend(figure, points)
    return figure


def _DrawLoci(
    top: Axes, bottom: Axes, point: PointStability, w: NDArray[np.float64]
) -> tuple[float, float]:
    """Draws the eigenloci of an operating point.

    Returns:
        The least and the largest phase in degrees that are to be seen.
    """
    loci = _TrackedLoci(point, w)
    shown: list[float] = []
    for i in range(loci.shape[1]):
        style = _LocusStyle(i)
        if np.abs(loci[:, i]).max() < _NOTHING:
            continue
        top.loglog(w, np.abs(loci[:, i]), **style)
        phase = _Unwrap(np.degrees(np.angle(loci[:, i])))
        k = np.flatnonzero((np.abs(loci[:-1, i]) > 1) != (np.abs(loci[1:, i]) > 1))
        # The branch on which the last crossover has -180 to 180 degrees: the way
        # from there down to -180 is its phase margin.
        phase -= 360 * np.round(phase[k[-1] if len(k) else 0] / 360)
        bottom.semilogx(w, phase, **style | {"linewidth": 0.6})
        delayed = phase - np.degrees(w * point.delay)
        bottom.semilogx(w, delayed, **style)
        dots = {"marker": "o", "ms": 3, "ls": "", "color": style["color"]}
        top.plot(w[k], np.ones(len(k)), **dots)
        bottom.plot(w[k], delayed[k], **dots)
        shown += [*delayed[k], *phase[k]]
    return min(shown, default=0.0), max(shown, default=0.0)


def _AddBodeLegend(figure: Figure, points: Sequence[PointStability]) -> None:
    black: dict[str, Any] = {"color": "black"}
    delayed = f"with {_Seconds(points[0].delay)}"
    handles: list[Artist] = [
        Line2D([], [], linewidth=0.6, label="L without delay", **black),
        Line2D([], [], linewidth=1.2, label=delayed, **black),
        Line2D([], [], marker="o", ms=3, ls="", label="gain crossover", **black),
    ]
    if any(point.unresolved > _BodeFrequencies(point)[0] for point in points):
        handles.append(Patch(color=_UNRESOLVED, label="not told from neutral"))
    figure.legend(
        handles=[*handles, *_LocusHandles(points)],
        loc="outside upper center",
        ncols=5,
        fontsize=FONT_SIZE,
        frameon=False,
    )


def PlotNyquist(analysis: StabilityAnalysis) -> Figure:
    """Plots the eigenloci of L(j w) e^(-j w T) near the critical point -1, w > 0.

    Without delay (thin), and with the scenario's (thick). The delay turns each point
    about the origin by -w T and leaves its distance alone, so it is the part outside of
    the unit circle that can be turned about -1.

    Raises:
        ValueError: If no operating point has a loop.
    """
    points = _WithLoop(analysis)
    size = WIDTH / max(len(points), 2)
    figure = Figure(figsize=(WIDTH, size + 0.5), layout="constrained")
    axes = figure.subplots(1, len(points), squeeze=False)[0]
    for ax, point in zip(axes, points, strict=True):
        w = _BodeFrequencies(point, _NUM_NYQUIST_POINTS)
        loci = _TrackedLoci(point, w)
        for i in range(loci.shape[1]):
            style = _LocusStyle(i)
            delayed = loci[:, i] * np.exp(-1j * w * point.delay)
            ax.plot(loci[:, i].real, loci[:, i].imag, **style | {"linewidth": 0.6})
            ax.plot(delayed.real, delayed.imag, **style)
        angle = np.linspace(0, 2 * np.pi, 200)
        ax.plot(np.cos(angle), np.sin(angle), color=GREY, linewidth=0.6, zorder=0)
        ax.axhline(0, color=GREY, linewidth=0.4, zorder=0)
        ax.axvline(0, color=GREY, linewidth=0.4, zorder=0)
        ax.plot([-1], [0], "+", color="black", ms=7, zorder=5)
        ax.set(
            xlim=(-_NYQUIST_RANGE, _NYQUIST_RANGE),
            ylim=(-_NYQUIST_RANGE, _NYQUIST_RANGE),
            aspect="equal",
        )
        ax.set_title(_Title(point), fontsize=FONT_SIZE)
        ax.set_xlabel("real part", fontsize=FONT_SIZE)
        _Format(ax)
    axes[0].set_ylabel("imaginary part", fontsize=FONT_SIZE)
    delay = points[0].delay
    figure.legend(
        handles=[
            Line2D([], [], color="black", linewidth=0.6, label="without delay"),
            Line2D(
                [], [], color="black", linewidth=1.2, label=f"with {_Seconds(delay)}"
            ),
            Line2D([], [], color="black", marker="+", ms=7, ls="", label="-1"),
            Line2D([], [], color=GREY, linewidth=0.6, label="unit circle"),
            *_LocusHandles(points),
        ],
        loc="outside upper center",
        ncols=6,
        fontsize=FONT_SIZE,
        frameon=False,
    )
    return figure


def PlotStableDelays(
    analyses: StabilityAnalysis | Sequence[StabilityAnalysis],
) -> Figure:
    """Plots the stable intervals of round-trip delay as bars, one per operating point.

    Raises:
        ValueError: If there is none.
    """
    if isinstance(analyses, StabilityAnalysis):
        analyses = [analyses]
    rows = [
        (analysis.scenario.controller.kind.replace("_", " "), point)
        for analysis in analyses
        for point in analysis.Loops()
    ]
    if not rows:
        Refuse("operating points", [], "one or more")
    height = 0.6 + 0.26 * len(rows) + 0.35
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    ax = figure.subplots()
    for i, (_, point) in enumerate(rows):
        ax.add_patch(
            Rectangle((0, i - 0.35), point.max_delay, 0.7, color=_UNSTABLE, zorder=1)
        )
        for begin, end in point.stable_delays:
            ax.add_patch(
                Rectangle((begin, i - 0.35), end - begin, 0.7, color=_STABLE, zorder=2)
            )
    for analysis in analyses:
        for delay in {point.delay for point in analysis.points}:
            ax.axvline(delay, color="black", linewidth=0.8, zorder=3)
    ax.set_xlim(0, max(point.max_delay for _, point in rows))
    ax.set_ylim(len(rows) - 0.5, -0.5)
    several = len({kind for kind, _ in rows}) > 1
    ax.set_yticks(
        range(len(rows)),
        [f"{kind}, {point.label}" if several else point.label for kind, point in rows],
    )
    ax.set_xlabel("round-trip delay [s]", fontsize=FONT_SIZE)
    _Format(ax)
    _AddStabilityLegend(figure, "the scenario's delay")
    return figure


def PlotStabilityChart(chart: StabilityChart) -> Figure:
    """Maps stable round-trip delays over the values of a key of the scenario.

    A panel for each loop; for POSITION one panel with those in which the operator
    commands a velocity. The line is the scenario's delay.

    Raises:
        ValueError: If it has fewer.
    """
    if len(chart.values) < 2:
        Refuse(chart.key, chart.values, "a list of two values or more")
    names = chart.PointNames()
    is_path = chart.key == POSITION
    along = "along the path"
    if is_path:
        commanding = chart.PointNames(with_force_mode=False)
        along += ", velocity commanded" * (names != commanding)
        names = commanding
    panels = [names] if is_path else [[name] for name in names]
    figure = Figure(figsize=(WIDTH, 1.4 * _ROW_HEIGHT + 0.4), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    edges = CellEdges(chart.values)
    for ax, panel in zip(axes, panels, strict=True):
        for name in panel:
            for i, intervals in enumerate(chart.StableDelays(name)):
                if intervals is None:
                    continue
                left, width = edges[i], edges[i + 1] - edges[i]
                ax.add_patch(
                    Rectangle(
                        (left, 0),
                        width,
                        chart.max_delay,
                        color=_UNSTABLE,
                        lw=0,
                        zorder=1,
                    )
                )
                for begin, end in intervals:
                    ax.add_patch(
                        Rectangle(
                            (left, begin),
                            width,
                            end - begin,
                            color=_STABLE,
                            lw=0,
                            zorder=2,
                        )
                    )
        delays = [analysis.points[0].delay for analysis in chart.analyses]
        ax.stairs(delays, edges, baseline=None, color="black", lw=0.8, zorder=3)
        ax.set_xlim(MapLimits(chart.values))
        ax.set_ylim(0, chart.max_delay)
        ax.set_title(along if is_path else panel[0], fontsize=FONT_SIZE)
        label = _PathLabel(chart) if is_path else AxisLabel(chart.key)
        ax.set_xlabel(label, fontsize=FONT_SIZE)
        _Format(ax)
    axes[0].set_ylabel("round-trip delay [s]", fontsize=FONT_SIZE)
    _AddStabilityLegend(figure, "the scenario's delay")
    return figure


def _PathLabel(chart: StabilityChart) -> str:
    scenario = chart.analyses[0].scenario
    is_x = ShownNormal(scenario.Surfaces(), scenario.num_axes)[0] == 1
    where = "x" if is_x else "along the surface's normal"
    return f"tool position {where} [m]"


def _ExplainLlewellyn(ax: Axes, w: np.ndarray, parameter: np.ndarray) -> None:
    """Marks where Llewellyn's parameter is below 1, and from which frequency on."""
    low, high = _LLEWELLYN_RANGE
    ax.set_ylim(low, high)
    ax.axhspan(low, 1.0, color=_ACTIVE, linewidth=0, zorder=-1)
    ax.axhline(1, color=GREY, linewidth=0.6, zorder=0)
    below = np.flatnonzero(parameter < 1 - _LLEWELLYN_MARGIN)
    if not below.size:
        return
    first = float(w[below[0]])
    text = "everywhere below 1" if below[0] == 0 else f"below 1 from {first:.2g} rad/s"
    if below[0]:
        ax.axvline(first, color=GREY, linewidth=0.8, linestyle=":")
    # Re p11 or Re p22 is negative there: the parameter is minus infinity.
    active = np.flatnonzero(np.isneginf(parameter))
    if active.size:
        text += f"\ndrop at {w[active[0]]:.2g} rad/s: a port alone is active"
    ax.annotate(
        text,
        (0.03, 0.96),
        xycoords="axes fraction",
        va="top",
        fontsize=SMALL_FONT_SIZE,
        color="#404040",
    )


def PlotTransparency(points: Sequence[Transparency]) -> Figure:
    """Plots what the operator feels and the environment, and Llewellyn's parameter.

    A column for each operating point. Above, the magnitude of Z_to of each axis with
    the scenario's delays (thick) and without delay (thin), and that of Z_e along x
    (dotted). Below, Llewellyn's parameter: the teleoperator is stable with every
    passive operator and environment if it is 1 or more at all frequencies.

    Raises:
        ValueError: If there is none.
    """
    if not points:
        Refuse("points", [], "one or more")
    figure = Figure(figsize=(WIDTH, 2 * _ROW_HEIGHT), layout="constrained")
    axes = figure.subplots(2, len(points), sharex="col", sharey="row", squeeze=False)
    num_axes = points[0].llewellyn.shape[1]
    for (top, bottom), point in zip(axes.T, points, strict=True):
        w = point.frequencies
        load = np.abs(point.environment[:, 0, 0])
        if load.any():
            top.loglog(w, load, ":", color=GREY, linewidth=1.5)
        for i in range(num_axes):
            style = _LocusStyle(i)
            thin = style | {"linewidth": 0.6}
            top.loglog(w, np.abs(point.undelayed[:, i, i]), **thin)
            top.loglog(w, np.abs(point.transmitted[:, i, i]), **style)
            bottom.semilogx(
                w, np.clip(point.llewellyn[:, i], *_LLEWELLYN_RANGE), **style
            )
        _ExplainLlewellyn(bottom, w, point.llewellyn.min(axis=1))
        top.set_title(point.point.name, fontsize=FONT_SIZE)
        top.set_xlim(w[0], w[-1])
        top.set_ylim(1e-2, 1e3)
        bottom.set_xlabel("frequency [rad/s]", fontsize=FONT_SIZE)
        for ax in (top, bottom):
            _Format(ax)
    axes[0, 0].set_ylabel("|impedance| [N s/m]", fontsize=FONT_SIZE)
    axes[1, 0].set_ylabel("Llewellyn's parameter", fontsize=FONT_SIZE)
    figure.legend(
        handles=[
            Line2D([], [], color="black", linewidth=1.2, label="felt, with delay"),
            Line2D([], [], color="black", linewidth=0.6, label="felt, without"),
            Line2D(
                [], [], ls=":", color=GREY, linewidth=1.5, label="environment, along x"
            ),
            *(
                Line2D([], [], label=f"axis {'xyz'[i]}", **_LocusStyle(i))
                for i in range(num_axes if num_axes > 1 else 0)
            ),
            Patch(
                color=_ACTIVE,
                label="below 1: some passive operator and environment destabilise it",
            ),
        ],
        loc="outside upper center",
        ncols=3,
        fontsize=FONT_SIZE,
        frameon=False,
    )
    return figure


def _AddStabilityLegend(figure: Figure, line: str) -> None:
    figure.legend(
        handles=[
            Patch(color=_STABLE, label="stable"),
            Patch(color=_UNSTABLE, label="unstable"),
            Line2D([], [], color="black", linewidth=0.8, label=line),
        ],
        loc="outside upper center",
        ncols=3,
        fontsize=FONT_SIZE,
        frameon=False,
    )


def _WithLoop(analysis: StabilityAnalysis) -> list[PointStability]:
    points = [point for point in analysis.Loops() if len(point.loop.D)]
    if not points:
        Refuse("analysis", "without a loop", "of a master that hears the slave")
    return points


def _Title(point: PointStability) -> str:
    name = point.label
    return f"{name} (weights frozen)" if point.model.frozen_weights else name


def _Seconds(delay: float) -> str:
    return f"{delay:.4g} s round trip"


def _LocusStyle(i: int) -> dict[str, Any]:
    return {
        "color": RunColor(i),
        "linestyle": LINES[i % len(LINES)],
        "linewidth": 1.2,
    }


def _LocusHandles(points: Sequence[PointStability]) -> list[Line2D]:
    """Returns what tells the eigenloci apart, where there are several."""
    count = max(len(point.loop.D) for point in points)
    return [
        Line2D([], [], label=f"locus {i + 1}", **_LocusStyle(i))
        for i in range(count if count > 1 else 0)
    ]


def _BodeFrequencies(point: PointStability, count: int = 1500) -> NDArray[np.float64]:
    """Returns frequencies around the crossovers, close together at resonances."""
    sweep = sweep_frequencies(point.loop)
    crossovers = [x.frequency for x in point.crossings if x.frequency > 0]
    if not crossovers:
        loci = np.abs(eigenloci(point.loop, sweep)[:, 0])
        crossovers = [float(sweep[np.argmax(loci)])]
    low = min(crossovers) / 10**_DECADES
    high = max(crossovers) * 10 ** (_DECADES / 2)
    inner = sweep[(sweep > low) & (sweep < high)]
    return np.unique(np.concatenate([np.geomspace(low, high, count), inner]))


def _TrackedLoci(
    point: PointStability, w: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Returns the eigenloci (K, m), each one continuous."""
    loci = eigenloci(point.loop, w)
    if loci.shape[1] == 1:
        return loci
    for k in range(1, len(w)):
        rest = list(loci[k])
        # Relative to the size: near a pole of L they are far apart.
        for i, before in enumerate(loci[k - 1]):
            j = int(np.argmin([abs(value - before) for value in rest]))
            loci[k, i] = rest.pop(j)
    return loci


def _Unwrap(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns a phase in degrees without its jumps by 360.

    Half a turn at a resonance without damping is one down: what any damping makes it.
    """
    steps = (np.diff(phase) + 210) % 360 - 210
    return np.concatenate([phase[:1], phase[0] + np.cumsum(steps)])


def _Multiple(step: float) -> Any:
    from matplotlib.ticker import MultipleLocator

    return MultipleLocator(step)


def _Format(ax: Axes) -> None:
    ax.tick_params(labelsize=SMALL_FONT_SIZE, width=0.6, length=2.5)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_linewidth(0.6)
