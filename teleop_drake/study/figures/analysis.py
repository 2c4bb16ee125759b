"""Figures of the analysis: Bode and Nyquist plots, stability charts, transparency.

Like those of figures.runs, the figures belong to the caller; SaveFigure() writes them.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

from teleop_drake.loops.framework.arrays import Array, ComplexArray, Interval
from teleop_drake.loops.framework.validation import CheckKind, Refuse
from teleop_drake.loops.numerics.crossings import eigenloci, sweep_frequencies
from teleop_drake.model.blocks.environments import ShownNormal
from teleop_drake.model.scenario import Scenario
from teleop_drake.model.signals import AxesOf
from teleop_drake.study.analysis.operating_point import POSITION, OperatingPoints
from teleop_drake.study.analysis.point_stability import PointStability
from teleop_drake.study.analysis.stability import StabilityAnalysis
from teleop_drake.study.analysis.stability_chart import StabilityChart
from teleop_drake.study.analysis.transparency import FeltStiffness, Transparency
from teleop_drake.study.figures import style
from teleop_drake.study.figures.labels import AxisLabel
from teleop_drake.study.figures.layout import MakeMultiples, Panels
from teleop_drake.study.figures.port_models import (
    GUIDE,
    MAGNITUDES,
    NYQUIST_RANGE,
    ContinuousPhase,
    DrawNyquistFrame,
    LocusKeys,
    Model,
    PlotModelBode,
    PlotModelNyquist,
    TrackedLoci,
)
from teleop_drake.study.figures.style import (
    GREY,
    AddLegend,
    Figure,
    Key,
    RunKeys,
    RunStyle,
)

_ROW_HEIGHT = 1.9  # inches

# Decades that a Bode plot shows below the slowest crossover; above the fastest one it
# shows half as many.
_DECADES = 1.5

# A locus below this is taken as zero, as with a predictor that has an exact model.
_NOTHING = 1e-9

_NUM_NYQUIST_POINTS = 6000  # of a curve

# Least distance between two frequencies that are written beside a locus.
_LABEL_DISTANCE = 0.6

# The range shown of Llewellyn's parameter; lower values are drawn at its lower edge.
_LLEWELLYN_RANGE = (-1.5, 3.0)
# Values less than this below 1 are rounding errors.
_LLEWELLYN_MARGIN = 1e-6

# Frequencies in rad/s of a hand, at which the felt stiffness is shown.
_HAND_FREQUENCIES = np.geomspace(0.1, 30.0, 300)

_STABLE = "#56B4E9"
# Below 1, Llewellyn's parameter does not guarantee stability.
_ACTIVE = "#F7DFCF"
_UNSTABLE = "#F0F0F0"
_UNRESOLVED = "#DCDCDC"

# What a plot of a loop takes.
_ANALYSIS = (
    "a StabilityAnalysis of AnalyzeStability(scenario) or, for a Diagram, a model of "
    "LinearizePorts(diagram, context, port, is_opened=True)"
)

_THIN = partial(Key, color="black", linewidth=0.6)
_THICK = partial(Key, color="black", linewidth=1.1)
_STABILITY_KEYS = (
    Patch(color=_STABLE, label="stable"),
    Patch(color=_UNSTABLE, label="unstable"),
    Key("the scenario's delay", color="black", linewidth=0.8),
)


def PlotBode(analysis: StabilityAnalysis | Model) -> Figure:
    """Plots magnitude and phase of L(j w) at each operating point, or of a model.

    A model of LinearizePorts() has one column, and the margins of a loop are drawn in:
    a line leads from the curve to the magnitude 1 or to -180 degrees.

    In an analysis, each eigenlocus has a line. The phase is drawn without delay (thin)
    and with the scenario's delay (thick), which adds -w T. Dots mark the gain
    crossovers: on the thick line, the dot of a crossover with falling magnitude has to
    lie above -180 degrees. The background is grey at frequencies at which the model
    does not resolve whether a motion is neutral.

    Raises:
        ValueError: If no operating point has a loop, or the argument is neither an
            analysis nor a model.
    """
    if isinstance(analysis, Model):
        return PlotModelBode(analysis)
    CheckKind("analysis", analysis, StabilityAnalysis, _ANALYSIS)
    points, figure, axes = _LoopPanels(
        analysis, "frequency [rad/s]", ["|eigenlocus of L|", "phase [°]"]
    )
    limits = [-200.0, 0.0]  # Shown even if every locus is zero.
    for (top, bottom), point in zip(axes.T, points, strict=True):
        w = _BodeFrequencies(point)
        limits += _DrawLoci(top, bottom, point, w)
        for ax, level in ((top, 1), (bottom, -180)):
            ax.axhline(level, **GUIDE)
            if point.unresolved > w[0]:
                ax.axvspan(w[0], point.unresolved, color=_UNRESOLVED, lw=0, zorder=-1)
        top.set(xlim=(w[0], w[-1]), ylim=MAGNITUDES)
    bottom.set_ylim(
        math.floor(min(limits) / 90) * 90, math.ceil(max(limits) / 90 + 0.5) * 90
    )
    bottom.yaxis.set_major_locator(MultipleLocator(90))
    grounds = []
    if any(ax.patches for ax in axes.flat):
        grounds = [Patch(color=_UNRESOLVED, label="not told from neutral")]
    handles = [
        _THIN("L without delay"),
        _THICK(f"with {points[0].delay:.4g} s round trip"),
        Key("gain crossover", color="black", marker="o", ms=3, ls=""),
        *grounds,
        *LocusKeys(max(len(point.loop.D) for point in points)),
    ]
    AddLegend(figure, handles)
    return figure


def _DrawLoci(top: Axes, bottom: Axes, point: PointStability, w: Array) -> list[float]:
    """Draws the eigenloci of a point; returns phases in degrees to be shown."""
    shown: list[float] = []
    for i, locus in enumerate(TrackedLoci(eigenloci(point.loop, w)).T):
        look = RunStyle(i)
        magnitude = np.abs(locus)
        if magnitude.max() < _NOTHING:
            continue
        top.loglog(w, magnitude, **look)
        phase = ContinuousPhase(np.degrees(np.angle(locus)))
        k = np.flatnonzero(np.diff(magnitude > 1))
        # On this branch the last crossover is between -180 and 180 degrees, and its
        # distance from -180 degrees is the phase margin.
        phase -= 360 * np.round(phase[k[-1] if len(k) else 0] / 360)
        bottom.semilogx(w, phase, **look | {"linewidth": 0.6})
        delayed = phase - np.degrees(w * point.delay)
        bottom.semilogx(w, delayed, **look)
        dots = {"marker": "o", "ms": 3, "ls": "", "color": look["color"]}
        top.plot(w[k], np.ones(len(k)), **dots)
        bottom.plot(w[k], delayed[k], **dots)
        shown += [*delayed[k], *phase[k]]
    return shown


def PlotNyquist(analysis: StabilityAnalysis | Model) -> Figure:
    """Plots the eigenloci of L(j w) e^(-j w T) near the critical point -1, w > 0.

    The loop of LinearizePorts(..., is_opened=True) contains its delays, and its margins
    are drawn in.

    In an analysis, the loci are drawn without delay (thin) and with the scenario's
    delay (thick). The latter have frequencies in rad/s beside them and an arrow towards
    higher ones. The delay turns each point about the origin by -w T and does not change
    its distance, so that only the part outside of the unit circle can be turned about
    -1.

    Raises:
        ValueError: If no operating point has a loop, or the argument is neither an
            analysis nor the model of a loop.
    """
    if isinstance(analysis, Model):
        return PlotModelNyquist(analysis)
    CheckKind("analysis", analysis, StabilityAnalysis, _ANALYSIS)
    points, figure, axes = _LoopPanels(analysis, "real part", ["imaginary part"])
    figure.set_figheight(figure.get_figwidth() / max(len(points), 2) + 0.6)
    for ax, point in zip(axes[0], points, strict=True):
        w = _BodeFrequencies(point, _NUM_NYQUIST_POINTS)
        for i, locus in enumerate(TrackedLoci(eigenloci(point.loop, w)).T):
            look = RunStyle(i)
            delayed = locus * np.exp(-1j * w * point.delay)
            ax.plot(locus.real, locus.imag, **look | {"linewidth": 0.6})
            ax.plot(delayed.real, delayed.imag, **look)
            _MarkFrequencies(ax, w, delayed, look["color"])
        DrawNyquistFrame(ax)
    handles = [
        _THIN("without delay"),
        _THICK(f"with {points[0].delay:.4g} s round trip"),
        Key("-1", color="black", marker="+", ms=7, ls=""),
        Key("unit circle", **GUIDE),
        Key("frequency [rad/s]", color="black", marker=".", ms=3, ls=""),
        *LocusKeys(max(len(point.loop.D) for point in points)),
    ]
    AddLegend(figure, handles)
    return figure


def _MarkFrequencies(ax: Axes, w: Array, locus: ComplexArray, color: str) -> None:
    """Writes frequencies in rad/s beside a locus, and draws an arrow along it."""
    points = np.column_stack([locus.real, locus.imag])
    is_seen = (np.abs(points) < NYQUIST_RANGE - 0.3).all(axis=1)
    marked: dict[str, int] = {}
    for k in np.flatnonzero(is_seen).tolist():
        number = f"{w[k]:.2g}"
        distances = np.abs(locus[k] - locus[list(marked.values())])
        if number not in marked and (distances >= _LABEL_DISTANCE).all():
            marked[number] = k
    for number, k in marked.items():
        ax.plot(*points[k], ".", color=color, ms=3)
        ax.annotate(number, points[k], (2, 2), textcoords="offset points", fontsize=5)
    if marked:
        # Towards higher frequencies.
        onward = points[min(marked.values()) :]
        is_ahead = np.hypot(*(onward - onward[0]).T) > _LABEL_DISTANCE / 2
        arrow = {"arrowstyle": "->", "color": color}
        ax.annotate("", onward[np.argmax(is_ahead)], onward[0], arrowprops=arrow)


def PlotStableDelays(
    analyses: StabilityAnalysis | Sequence[StabilityAnalysis],
) -> Figure:
    """Plots the stable intervals of round-trip delay as bars, one per operating point.

    Raises:
        ValueError: If there is no operating point with a loop.
    """
    allowed = (
        "a StabilityAnalysis of AnalyzeStability(scenario), or several; of a Diagram's "
        "loop, DelayMargin(diagram, context, port) returns the largest stable delay"
    )
    CheckKind("analyses", analyses, StabilityAnalysis | Sequence, allowed)
    if isinstance(analyses, StabilityAnalysis):
        analyses = [analyses]
    rows = []
    for analysis in analyses:
        CheckKind("analyses", analysis, StabilityAnalysis, allowed)
        # Several analyses are told apart by their controllers.
        kind = analysis.scenario.controller.kind.replace("_", " ")
        prefix = f"{kind}, " if len(analyses) > 1 else ""
        rows += [(prefix + point.label, point) for point in analysis.Loops()]
    if not rows:
        Refuse("operating points", [], "one or more")
    height = 0.95 + 0.26 * len(rows)
    figure, [[ax]] = MakeMultiples([""], "round-trip delay [s]", [""], height=height)
    for i, (_, point) in enumerate(rows):
        _DrawDelays(ax.barh, i, 0.7, point.max_delay, point.stable_delays)
    for delay in {point.delay for _, point in rows}:
        ax.axvline(delay, color="black", linewidth=0.8, zorder=3)
    ax.set_xlim(0, max(point.max_delay for _, point in rows))
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_yticks(range(len(rows)), [label for label, _ in rows])
    AddLegend(figure, _STABILITY_KEYS)
    return figure


def _DrawDelays(
    draw: Callable[..., Any],
    place: float,
    width: float,
    max_delay: float,
    stable: Iterable[Interval],
) -> None:
    """Draws a bar by Axes.bar or Axes.barh, with the stable delays in colour."""
    draw(place, max_delay, width, color=_UNSTABLE, zorder=1)
    for begin, end in stable:
        draw(place, end - begin, width, begin, color=_STABLE, zorder=2)


def PlotStabilityChart(chart: StabilityChart) -> Figure:
    """Maps stable round-trip delays over the values of a key of the scenario.

    Each loop has a panel. If the key is POSITION, one panel shows the loops in which
    the operator commands a velocity. The line is the scenario's delay.

    Raises:
        ValueError: If the chart has fewer than two values.
    """
    CheckKind("chart", chart, StabilityChart, "a StabilityChart of ChartStability()")
    if len(chart.values) < 2:
        Refuse(chart.key, chart.values, "a list of two values or more")
    names = chart.PointNames()
    panels = {name: [name] for name in names}
    label = AxisLabel(chart.key)
    if chart.key == POSITION:
        # The operating points lie along one path, which has one panel.
        commanding = chart.PointNames(with_force_mode=False)
        along = "along the path" + ", velocity commanded" * (names != commanding)
        panels = {along: commanding}
        scenario = chart.analyses[0].scenario
        is_x = ShownNormal(scenario.Surfaces(), scenario.num_axes)[0] == 1
        direction = "x" if is_x else "along the surface's normal"
        label = f"tool position {direction} [m]"
    figure, axes = MakeMultiples(
        list(panels), label, ["round-trip delay [s]"], height=1.4 * _ROW_HEIGHT + 0.4
    )
    # A column of bars for each value.
    edges = style.CellEdges(chart.values)
    widths = np.diff(edges)
    delays = [analysis.points[0].delay for analysis in chart.analyses]
    for ax, panel in zip(axes[0], panels.values(), strict=True):
        draw = partial(ax.bar, align="edge")
        for name in panel:
            for i, stable in enumerate(chart.StableDelays(name)):
                if stable is not None:
                    _DrawDelays(draw, edges[i], widths[i], chart.max_delay, stable)
        ax.stairs(delays, edges, baseline=None, color="black", lw=0.8, zorder=3)
        ax.set_xlim(style.MapLimits(chart.values))
        ax.set_ylim(0, chart.max_delay)
    AddLegend(figure, _STABILITY_KEYS)
    return figure


def _ExplainLlewellyn(ax: Axes, w: Array, parameter: Array) -> None:
    """Marks where Llewellyn's parameter is below 1, and the first such frequency."""
    ax.set_ylim(_LLEWELLYN_RANGE)
    ax.axhspan(_LLEWELLYN_RANGE[0], 1.0, color=_ACTIVE, linewidth=0, zorder=-1)
    ax.axhline(1, **GUIDE)
    below = w[parameter < 1 - _LLEWELLYN_MARGIN]
    if not below.size:
        return
    text = "everywhere below 1"
    if below[0] > w[0]:
        text = f"below 1 from {below[0]:.2g} rad/s"
        ax.axvline(below[0], linestyle=":", **GUIDE)
    # Where Re p11 or Re p22 is negative, the parameter is minus infinity.
    active = w[np.isneginf(parameter)]
    if active.size:
        text += f"\ngives out energy at {active[0]:.2g} rad/s"
    look = {"va": "top", "fontsize": style.SMALL_FONT_SIZE, "color": "#404040"}
    ax.text(0.03, 0.96, text, look, transform=ax.transAxes)


def PlotTransparency(points: Sequence[Transparency]) -> Figure:
    """Plots the transmitted impedance, and Llewellyn's parameter, of operating points.

    Each operating point has a column. The upper panel shows the magnitude of the
    impedance Z_to felt along each axis, with the scenario's delays (thick) and without
    delay (thin), and that of the environment's Z_e along x (dotted). The lower panel
    shows Llewellyn's parameter: the teleoperator is stable with every passive operator
    and environment if it is 1 or more at all frequencies.

    Raises:
        ValueError: If there is no operating point.
    """
    if not points:
        Refuse("points", [], "one or more")
    figure, axes = MakeMultiples(
        [point.point.name for point in points],
        "frequency [rad/s]",
        ["|impedance| [N s/m]", "Llewellyn's parameter"],
        height=2 * _ROW_HEIGHT,
    )
    num_axes = points[0].llewellyn.shape[1]
    for (top, bottom), point in zip(axes.T, points, strict=True):
        w = point.frequencies
        shown = np.clip(point.llewellyn, *_LLEWELLYN_RANGE)
        load = np.abs(point.environment[:, 0, 0])
        # Without an environment, its impedance is zero.
        if load.any():
            top.loglog(w, load, ":", color=GREY, linewidth=1.5)
        for i in range(num_axes):
            look = RunStyle(i)
            undelayed = np.abs(point.undelayed[:, i, i])
            top.loglog(w, undelayed, **look | {"linewidth": 0.6})
            top.loglog(w, np.abs(point.transmitted[:, i, i]), **look)
            bottom.semilogx(w, shown[:, i], **look)
        _ExplainLlewellyn(bottom, w, point.llewellyn.min(axis=1))
        top.set(xlim=(w[0], w[-1]), ylim=(1e-2, 1e3))
    below = "below 1: unstable with some passive operator and environment"
    # A single axis needs no name.
    names = [f"axis {x}" for x in AxesOf(num_axes)] if num_axes > 1 else []
    handles = [
        _THICK("felt with the delay"),
        _THIN("felt without delay"),
        Key("the environment itself, along x", ls=":", color=GREY, linewidth=1.5),
        *RunKeys(names),
        Patch(color=_ACTIVE, label=below),
    ]
    AddLegend(figure, handles)
    return figure


def PlotFeltStiffness(panels: Mapping[str, Mapping[str, Scenario]]) -> Figure:
    """Plots the stiffness that the operator feels, 0.1 to 30 rad/s.

    It is FeltStiffness() at the last operating point, in N/m along x. The dashed line
    is the stiffness of the environment there. The dotted line marks 1 rad/s, the
    frequency of FeltStiffnessLoss(). The range of the panels suits the environment's
    stiffness and the felt one up to that frequency.

    Args:
        panels: The scenarios of each panel by their labels, keyed by the panel's title.
            A label has the same colour and line style in all panels.

    Raises:
        ValueError: If there is no panel, or FeltStiffness() raises it.
    """
    if not panels:
        Refuse("panels", {}, "one or more")
    w = _HAND_FREQUENCIES
    figure, axes = MakeMultiples(
        list(panels),
        "frequency of the hand [rad/s]",
        ["felt stiffness [N/m]"],
        height=1.5 * _ROW_HEIGHT,
    )
    # The labels of all panels, each once and in order.
    labels = dict.fromkeys(label for row in panels.values() for label in row)
    looks = {label: RunStyle(i) for i, label in enumerate(labels)}
    limit = 0.0
    for ax, scenarios in zip(axes[0], panels.values(), strict=True):
        for label, scenario in scenarios.items():
            point = OperatingPoints(scenario)[-1]
            stiffnesses, _ = scenario.environment.StiffnessAndDamping(point.position)
            stiffness = stiffnesses[0, 0]
            felt = FeltStiffness(scenario, point, w)
            ax.semilogx(w, felt, **looks[label])
            limit = max(limit, stiffness, np.abs(felt[w <= 1.0]).max())
            ax.axhline(stiffness, linestyle="--", **GUIDE)
        ax.axhline(0.0, **GUIDE)
        ax.axvline(1.0, linestyle=":", **GUIDE)
        ax.set_xlim(w[0], w[-1])
    axes[0, 0].set_ylim(-1.1 * limit, 1.1 * limit)
    AddLegend(figure, RunKeys(labels))
    return figure


def _LoopPanels(
    analysis: StabilityAnalysis, x_label: str, y_labels: Sequence[str]
) -> tuple[list[PointStability], Figure, Panels]:
    """Returns the operating points with a loop, and a figure with a column for each."""
    points = [point for point in analysis.Loops() if len(point.loop.D)]
    if not points:
        Refuse("analysis", "without a loop", "of a master that hears the slave")
    titles = [
        point.label + " (weights frozen)" * point.model.frozen_weights
        for point in points
    ]
    return points, *MakeMultiples(titles, x_label, y_labels, height=2 * _ROW_HEIGHT)


def _BodeFrequencies(point: PointStability, count: int = 1500) -> Array:
    """Returns frequencies in rad/s about the crossovers, densely at resonances."""
    sweep = sweep_frequencies(point.loop)
    crossovers = [x.frequency for x in point.crossings if x.frequency > 0]
    if not crossovers:
        loci = np.abs(eigenloci(point.loop, sweep)[:, 0])
        crossovers = [sweep[np.argmax(loci)]]
    low = min(crossovers) / 10**_DECADES
    high = max(crossovers) * 10 ** (_DECADES / 2)
    inner = sweep[(sweep > low) & (sweep < high)]
    return np.union1d(np.geomspace(low, high, count), inner)
