"""The figures of the thesis, made anew from simulations that run then and there.

Each has the number that it has in the thesis and shows the same quantities. Units have
SI prefixes where that makes them readable.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from pydrake.systems.framework import Diagram

from teleop_drake.figures.block_diagram import WriteDiagram
from teleop_drake.figures.runs import PlotRows, SaveFigure, SignalRow
from teleop_drake.figures.style import (
    BORDER_STYLE,
    COLORS,
    FONT_SIZE,
    LINES,
    SMALL_FONT_SIZE,
    WIDTH,
    AxisName,
    FormatAxes,
    Widen,
)
from teleop_drake.laws.gaussian_network import EquidistantLattice
from teleop_drake.laws.layered_force import layer_force, layer_index
from teleop_drake.recording import Recording
from teleop_drake.scenario import EnvironmentConfig, LoadScenario
from teleop_drake.teleoperator import MakeTeleoperator
from teleop_drake.thesis.runs import ThesisRuns

Request = tuple[str, Mapping[str, Any]]
"""A scenario and its overrides, as ThesisRuns.Prefetch takes them."""

_DIRECT = {"controller.kind": "direct_force"}
_ADAPTIVE = {"controller.kind": "adaptive_backstepping"}

_ROW_HEIGHT = 1.9  # inches
_LEGEND_HEIGHT = 0.7  # inches


@dataclass(kw_only=True)
class ThesisFigure:
    """One figure.

    Attributes:
        number: As in the thesis, for instance "4.1".
        title: What it shows, in a few words.
        caption: How to read it.
        requests: The runs that it is made from.
        make: Makes it: a matplotlib Figure, or the Diagram to be drawn.
    """

    number: str
    title: str
    caption: str
    requests: Sequence[Request]
    make: Callable[[ThesisRuns], Figure | Diagram]

    @property
    def stem(self) -> str:
        """Name of its files without the suffix, for instance `figure_4_1`."""
        return "figure_" + self.number.replace(".", "_")


def WritePicture(picture: Figure | Diagram, stem: Path) -> list[Path]:
    """Writes a figure or a block diagram as .png and as .svg.

    The same picture gives the same bytes. Each file appears complete or not at all.

    Args:
        picture: A figure, whose layout is fixed thereby, or a diagram, drawn as the
            boxes of its own parts.
        stem: The path without the suffix, in an existing folder.

    Returns:
        The paths of the two files, .png first.

    Raises:
        OSError: If a file cannot be written.
        RuntimeError: If nothing here can lay out a block diagram.
    """
    paths = [stem.with_name(f"{stem.name}{suffix}") for suffix in (".png", ".svg")]
    if isinstance(picture, Figure):
        # The layout costs as much as the drawing and is the same for both.
        layout = picture.get_layout_engine()
        if layout is not None:
            layout.execute(picture)
            picture.set_layout_engine("none")
        for path in paths:
            SaveFigure(picture, path)
    else:
        for path in paths:
            WriteDiagram(picture, path, max_depth=1)
    return paths


# Chapter 2.


def _MakeLoop(runs: ThesisRuns) -> Diagram:
    return MakeTeleoperator(LoadScenario("one_dof"))


def _PlotStiffness(runs: ThesisRuns) -> Figure:
    scenario = LoadScenario("one_dof")
    surface = scenario.contact_surface
    assert surface is not None
    figure = Figure(figsize=(WIDTH, _ROW_HEIGHT + _LEGEND_HEIGHT), layout="constrained")
    # Bone is 15000 times as stiff as tissue: each panel has the scale of one of them.
    tissue, bone = figure.subplots(1, 2)
    _DrawStiffness(tissue, scenario.environment, 0.0, surface)
    tissue.set_xlabel("position $x$ [mm]", fontsize=FONT_SIZE)
    _DrawStiffness(bone, scenario.environment, surface - 2e-5, surface + 6e-5)
    bone.set_xlabel("position $x$ [mm], at the bone", fontsize=FONT_SIZE)
    bone.ticklabel_format(axis="x", useOffset=False)
    tissue.set_ylim(*(1.25 * np.array(tissue.get_ylim())))
    tissue.plot([surface * 1e3] * 2, [0.0, tissue.get_ylim()[1]], color=COLORS[0])
    return figure


def _DrawStiffness(
    ax: Axes, environment: EnvironmentConfig, low: float, high: float
) -> None:
    """Draws the force of the springs, in mN, from low to high (both in m)."""
    layers = environment.layers
    starts = [layer.start for layer in layers]
    FormatAxes(ax)
    # Both sides of a jump.
    edges = [low, *(start for start in starts if low < start < high), high]
    x, force = [], []
    for begin, end in itertools.pairwise(edges):
        layer = layers[layer_index(starts, begin)]
        x += [begin, end]
        force += [layer_force(layer, begin, 0.0), layer_force(layer, end, 0.0)]
    ax.plot(np.array(x) * 1e3, np.array(force) * 1e3, color=COLORS[0])
    ax.set_ylabel("stiffness force [mN]", fontsize=FONT_SIZE)
    ends = [*starts[1:], high]
    for layer, end in zip(layers, ends, strict=True):
        if end <= low or layer.start >= high:
            continue
        if layer.start > low:
            ax.axvline(layer.start * 1e3, **BORDER_STYLE)
        ax.annotate(
            layer.name,
            (max(layer.start, low) * 1e3, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            va="bottom",
            fontsize=SMALL_FONT_SIZE,
        )


# Chapter 3.


def _PlotAgainstReference(
    runs: ThesisRuns, task: str, signals: Mapping[str, str], label: str, unit: str
) -> Figure:
    """Plots signals, by their names in the legend, on each axis against time."""
    recording = runs(task)
    figure, axes = _TimeFigure(recording, 2)
    for k, (ax, axis) in enumerate(zip(axes, "xz", strict=True)):
        for i, (name, signal) in enumerate(signals.items()):
            ax.plot(
                recording.time,
                recording[signal][:, k],
                color=COLORS[i],
                linestyle=LINES[i],
                linewidth=1.1,
                label=name,
            )
        values = [recording[signal][:, k] for signal in signals.values()]
        ax.set_ylim(Widen((float(np.min(values)), float(np.max(values))), 1.0))
        ax.set_ylabel(f"{label}, ${axis}$ [{unit}]", fontsize=FONT_SIZE)
    _AddLegendAbove(figure, axes[0].get_lines()[-len(signals) :])
    return figure


# Chapters 4 and 5: both controllers together.


def _CompareSignal(
    runs: ThesisRuns,
    task: str,
    rows: Callable[[int], list[SignalRow]],
    is_time_only: bool,
) -> Figure:
    recordings = {
        "direct force": runs(task, **_DIRECT),
        "adaptive": runs(task, **_ADAPTIVE),
    }
    num_axes = recordings["adaptive"].scenario.num_axes
    figure = PlotRows(recordings, rows(num_axes))
    figure.set_size_inches(WIDTH, _ROW_HEIGHT * num_axes + _LEGEND_HEIGHT)
    if is_time_only:
        for left, right in zip(figure.axes[::2], figure.axes[1::2], strict=True):
            cell = left.get_subplotspec()
            assert cell is not None
            left.set_subplotspec(cell.get_gridspec()[cell.rowspan.start, :])
            right.remove()
    return figure


def _VelocityRows(n: int) -> list[SignalRow]:
    return [
        SignalRow(
            label=f"velocity $v_{AxisName(k)}$",
            unit="m/s",
            signal="tool_velocity",
            components=[k],
            command=n + k,
        )
        for k in range(n)
    ]


def _SensedForceRows(n: int) -> list[SignalRow]:
    return [
        SignalRow(
            label=f"sensed force $F_{{e,{AxisName(k)}}}$",
            unit="N",
            signal="environment_force",
            components=[k],
        )
        for k in range(n)
    ]


def _PositionRows(n: int) -> list[SignalRow]:
    return [
        SignalRow(
            label=f"position ${AxisName(k)}$",
            unit="m",
            signal="tool_position",
            components=[k],
            is_x=k == 0,
        )
        for k in range(n)
    ]


def _ControlForceRows(n: int) -> list[SignalRow]:
    return [
        SignalRow(
            label=f"control force $F_{{c,{AxisName(k)}}}$",
            unit="N",
            signal="control_force",
            components=[k],
        )
        for k in range(n)
    ]


# Chapters 4 and 5: what the adaptive controller learns.


def _PlotPsi(runs: ThesisRuns, task: str) -> Figure:
    recording = runs(task, **_ADAPTIVE)
    n = recording.scenario.num_axes
    figure, (above, below) = _TimeFigure(recording, 2)
    # It hardly moves from where it starts, which the second panel magnifies.
    change = recording["psi"] - recording["psi"][0]
    for k in range(n * n):
        style = {
            "color": COLORS[k],
            "linestyle": LINES[k % len(LINES)],
            "linewidth": 1.1,
            "label": rf"$\Psi_{{{k // n + 1}{k % n + 1}}}$" if n > 1 else r"$\Psi$",
        }
        above.plot(recording.time, recording["psi"][:, k], **style)
        below.plot(recording.time, change[:, k], **style)
    above.set_ylabel(r"$\Psi$ [1/kg]", fontsize=FONT_SIZE)
    below.set_ylabel(r"$\Psi - \Psi_0$ [1/kg]", fontsize=FONT_SIZE)
    _AddLegendAbove(figure, above.get_lines()[-n * n :])
    return figure


def _PlotWeights(runs: ThesisRuns, task: str, signal: str) -> Figure:
    """Plots weights in the colour of their centre's x, the style of its distance."""
    recording = runs(task, **_ADAPTIVE)
    scenario = recording.scenario
    n = scenario.num_axes
    network = scenario.controller.network
    centres = EquidistantLattice(network.lower, network.upper, network.count)
    weights = recording[signal].reshape(-1, n, len(centres))
    x_values = np.unique(centres[:, 0])
    # Centres on either side of the straight path look alike.
    distances = np.round(np.linalg.norm(centres[:, 1:], axis=1), 9)
    distance_values = np.unique(distances)
    colors = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, len(x_values)))
    name, unit = {"weights_1": ("W_1", "m/s²"), "weights_3": ("W_3", "N/s")}[signal]

    def Style(x: float, distance: float) -> dict[str, Any]:
        rank = int(np.searchsorted(distance_values, distance))
        return {
            "color": colors[np.searchsorted(x_values, x)],
            "linestyle": LINES[rank % len(LINES)],
            "linewidth": 1.1 if rank == 0 else 0.7,
        }

    figure, axes = _TimeFigure(recording, n)
    for k, ax in enumerate(axes):
        for i, (centre, distance) in enumerate(zip(centres, distances, strict=True)):
            ax.plot(recording.time, weights[:, k, i], **Style(centre[0], distance))
        ax.set_ylabel(f"weights ${name}$, {AxisName(k)} [{unit}]", fontsize=FONT_SIZE)
    handles = [
        Line2D([], [], label=f"$x$ = {1e3 * x:.4g} mm", **Style(x, 0.0))
        for x in x_values
    ]
    if len(distance_values) > 1:
        handles += [
            Line2D(
                [],
                [],
                label=rf"$y$ = {'±' if y else ''}{1e3 * y:.4g} mm",
                **{**Style(x_values[0], y), "color": "black"},
            )
            for y in distance_values
        ]
    _AddLegendAbove(figure, handles, "centre of the Gaussian at")
    return figure


def _TimeFigure(recording: Recording, num_rows: int) -> tuple[Figure, list[Axes]]:
    """Returns empty panels against time, with the instants that matter marked."""
    figure = Figure(
        figsize=(WIDTH, _ROW_HEIGHT * num_rows + _LEGEND_HEIGHT), layout="constrained"
    )
    axes = list(figure.subplots(num_rows, 1, sharex=True, squeeze=False)[:, 0])
    for ax in axes:
        FormatAxes(ax)
        ax.set_xlim(0.0, float(recording.time[-1]))
        for name in ("puncture", "contact"):
            for time in recording.EventTimes(name)[:1]:
                ax.axvline(time, **BORDER_STYLE)
                if ax is axes[0]:
                    ax.annotate(
                        name,
                        (time, 1.0),
                        xycoords=("data", "axes fraction"),
                        xytext=(0, 2),
                        textcoords="offset points",
                        ha="center",
                        fontsize=SMALL_FONT_SIZE,
                    )
    axes[-1].set_xlabel("time [s]", fontsize=FONT_SIZE)
    return figure, axes


def _AddLegendAbove(
    figure: Figure, handles: Sequence[Line2D], title: str | None = None
) -> None:
    figure.legend(
        handles=handles,
        title=title,
        title_fontsize=SMALL_FONT_SIZE,
        loc="outside upper center",
        ncols=len(handles) if len(handles) <= 5 else 4,
        fontsize=SMALL_FONT_SIZE,
        frameon=False,
    )


# The list of figures.

_TASKS = {
    "one_dof": "The slider of chapter 4 goes through tissue into free space and on to "
    "bone.",
    "two_dof_puncture": "Planar arm, case I: through tissue into free space.",
    "two_dof_collision": "Planar arm, case II: through free space on to bone.",
    "two_dof_combined": "Planar arm, case III: through tissue into free space and on "
    "to bone.",
}

_BOTH = (
    " Left against time, right against the position along x; dotted lines mark the end "
    "of the tissue and the surface of the bone. A cross is where a run that diverges "
    "is ended."
)

# By what is compared: title, caption, rows, whether against time only.
_COMPARISONS: dict[str, tuple[str, str, Callable[[int], list[SignalRow]], bool]] = {
    "velocity": (
        "Velocity of the tool",
        "Velocity of the tool with either controller, and in grey what the surgeon "
        "commands." + _BOTH,
        _VelocityRows,
        False,
    ),
    "sensed_force": (
        "Sensed force",
        "Force of the robot on its environment, as the sensor at the tool reads it."
        + _BOTH,
        _SensedForceRows,
        False,
    ),
    "position": (
        "Position of the tool",
        "Position of the tool with either controller against time; dotted lines mark "
        "the end of the tissue and the surface of the bone.",
        _PositionRows,
        True,
    ),
    "control_force": (
        "Control force",
        "Force that the controller asks of the robot: the delayed haptic force under "
        "direct force, the state of the backstepping law otherwise." + _BOTH,
        _ControlForceRows,
        False,
    ),
}

_LEARNED: dict[str, tuple[str, str]] = {
    "weights_1": (
        "Weights of the first network",
        "Weights for the unknown dynamics of the robot and its environment, a curve "
        "for each Gaussian; colour and line style tell where its centre is.",
    ),
    "psi": (
        "Estimate of the inverse inertia",
        "Entries of the matrix that stands for the inverse inertia, and below how far "
        "each is from its initial value.",
    ),
    "weights_3": (
        "Weights of the third network",
        "Weights for the rate of change of the environment's force, a curve for each "
        "Gaussian; colour and line style tell where its centre is.",
    ),
}

# By task: number of the figure for each quantity.
_NUMBERS = {
    "one_dof": {
        "velocity": "4.1",
        "sensed_force": "4.2",
        "control_force": "4.3",
        "weights_1": "4.4",
        "psi": "4.5",
        "weights_3": "4.6",
    },
    "two_dof_puncture": {
        "velocity": "5.1",
        "sensed_force": "5.2",
        "control_force": "5.3",
        "weights_1": "5.4",
        "psi": "5.5",
        "weights_3": "5.6",
    },
    "two_dof_collision": {
        "velocity": "5.7",
        "sensed_force": "5.8",
        "position": "5.9",
        "control_force": "5.10",
        "weights_1": "5.11",
        "psi": "5.12",
        "weights_3": "5.13",
    },
    "two_dof_combined": {
        "velocity": "5.14",
        "sensed_force": "5.15",
        "position": "5.16",
        "control_force": "5.17",
        "weights_1": "5.18",
        "psi": "5.19",
        "weights_3": "5.20",
    },
}


def _TrackingFigures(
    task: str, kind: str, numbers: Sequence[str]
) -> list[ThesisFigure]:
    """Returns the two figures of a case of chapter 3."""
    tracking, disturbance = numbers
    described = f"Planar arm under gravity, disturbed by a force that is {kind}."
    return [
        ThesisFigure(
            number=tracking,
            title="Tracking",
            caption=f"{described} Position of the tool and the trajectory that it is "
            "to follow.",
            requests=[(task, {})],
            make=lambda runs: _PlotAgainstReference(
                runs,
                task,
                {"actual": "tool_position", "desired": "desired_position"},
                "position",
                "m",
            ),
        ),
        ThesisFigure(
            number=disturbance,
            title="Disturbance and its estimate",
            caption=f"{described} The force and what the network makes of it.",
            requests=[(task, {})],
            make=lambda runs: _PlotAgainstReference(
                runs,
                task,
                {"actual": "environment_force", "estimated": "disturbance_estimate"},
                "disturbance",
                "N",
            ),
        ),
    ]


def _ComparisonFigure(task: str, quantity: str, number: str) -> ThesisFigure:
    title, caption, rows, is_time_only = _COMPARISONS[quantity]
    return ThesisFigure(
        number=number,
        title=title,
        caption=f"{_TASKS[task]} {caption}",
        requests=[(task, _DIRECT), (task, _ADAPTIVE)],
        make=lambda runs: _CompareSignal(runs, task, rows, is_time_only),
    )


def _LearnedFigure(task: str, quantity: str, number: str) -> ThesisFigure:
    title, caption = _LEARNED[quantity]
    return ThesisFigure(
        number=number,
        title=title,
        caption=f"{_TASKS[task]} {caption}",
        requests=[(task, _ADAPTIVE)],
        make=(
            (lambda runs: _PlotPsi(runs, task))
            if quantity == "psi"
            else (lambda runs: _PlotWeights(runs, task, quantity))
        ),
    )


FIGURES: dict[str, ThesisFigure] = {
    figure.number: figure
    for figure in [
        ThesisFigure(
            number="2.1",
            title="The loop",
            caption="Surgeon and haptic device, the two channels, controller, robot "
            "and environment, drawn from the very diagram that is simulated.",
            requests=[],
            make=_MakeLoop,
        ),
        ThesisFigure(
            number="2.4",
            title="Stiffness profile",
            caption="Force of the environment's springs against the position of the "
            "tool: on the left at the scale of the tissue, on the right at that of the "
            "bone. Damping is left out.",
            requests=[],
            make=_PlotStiffness,
        ),
        *_TrackingFigures(
            "network_tracking_linear",
            "proportional to the position on each axis (case I)",
            ("3.2", "3.3"),
        ),
        *_TrackingFigures(
            "network_tracking_coupled",
            "nonlinear and couples the axes (case II)",
            ("3.4", "3.5"),
        ),
        *(
            (_LearnedFigure if quantity in _LEARNED else _ComparisonFigure)(
                task, quantity, number
            )
            for task, numbers in _NUMBERS.items()
            for quantity, number in numbers.items()
        ),
    ]
}
"""All figures by their number, in the thesis's order."""
