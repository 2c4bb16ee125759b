"""Plots of the thesis: what its figures show, from runs."""

import itertools
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydrake.systems.framework import Diagram

from teleop_drake.blocks.environments.surface import (
    CONTACT,
    FindSurface,
    MaterialAt,
    Surface,
)
from teleop_drake.figures.layout import MakePanels
from teleop_drake.figures.runs import PlotRows
from teleop_drake.figures.selection import SelectRows
from teleop_drake.figures.style import (
    BOUNDARY_STYLE,
    COLORS,
    LINES,
    SMALL_FONT_SIZE,
    WIDTH,
    AddLegend,
    FormatAxes,
    Key,
    NameAbove,
    RunStyle,
)
from teleop_drake.laws.gaussian_network import equidistant_lattice
from teleop_drake.recording import Recording
from teleop_drake.scenario import AsTeleoperation, LoadScenario
from teleop_drake.tasks import TaskOf
from teleop_drake.tasks.panels import AxisName
from teleop_drake.teleoperator import MakeTeleoperator
from teleop_drake.thesis.runs import ADAPTIVE, ThesisRuns

ROW_HEIGHT = 1.9  # inches
LEGEND_HEIGHT = 0.7  # inches


def TimeFigure(recording: Recording, num_rows: int) -> tuple[Figure, Sequence[Axes]]:
    """Returns empty panels against time, with first puncture and contact marked."""
    height = ROW_HEIGHT * num_rows + LEGEND_HEIGHT
    figure, panels = MakePanels(num_rows, 1, height=height, share_x="all")
    axes = list(panels[:, 0])
    for ax in axes:
        FormatAxes(ax)
    axes[0].set_xlim(0.0, float(recording.time[-1]))
    axes[-1].set_xlabel("time [s]")
    for name in ("puncture", "contact"):
        for time in recording.EventTimes(name)[:1]:
            NameAbove(axes[0], time, name)
            for ax in axes:
                ax.axvline(time, **BOUNDARY_STYLE)
    return figure, axes


# Chapter 2: the loop and the stiffness of the environment.


def MakeLoop(runs: ThesisRuns) -> Diagram:
    """Returns the diagram of the loop; no run is needed."""
    return MakeTeleoperator(AsTeleoperation(LoadScenario("one_dof")))


def PlotStiffness(runs: ThesisRuns) -> Figure:
    """Plots the springs of one axis at the scale of each; no run is needed."""
    scenario = AsTeleoperation(LoadScenario("one_dof"))
    surfaces = scenario.Surfaces()
    contact = FindSurface(surfaces, CONTACT)
    assert contact is not None
    surface = float(contact.point_W[0])
    # Bone is 15000 times as stiff as tissue: each panel has the scale of one of them.
    figure, panels = MakePanels(1, 2, height=ROW_HEIGHT + LEGEND_HEIGHT)
    tissue, bone = panels[0]
    _DrawStiffness(tissue, surfaces, 0.0, surface)
    tissue.set_xlabel("position $x$ [mm]")
    _DrawStiffness(bone, surfaces, surface - 2e-5, surface + 6e-5)
    bone.set_xlabel("position $x$ [mm], at the bone")
    bone.ticklabel_format(axis="x", useOffset=False)
    tissue.set_ylim(*(1.25 * np.array(tissue.get_ylim())))
    tissue.plot([surface * 1e3] * 2, [0.0, tissue.get_ylim()[1]], color=COLORS[0])
    return figure


def _DrawStiffness(
    ax: Axes, surfaces: Sequence[Surface], low: float, high: float
) -> None:
    """Draws the force of the springs, in mN, from low to high (both in m)."""
    FormatAxes(ax)
    ax.set_ylabel("stiffness force [mN]")
    starts = [float(surface.point_W[0]) for surface in surfaces]
    edges = [low, *(start for start in starts if low < start < high), high]
    x: list[float] = []
    force: list[float] = []
    for begin, end in itertools.pairwise(edges):
        material = MaterialAt(surfaces, [begin])
        assert material is not None
        # Both sides of a jump.
        x += [begin, end]
        force += [material.Force(begin, 0.0), material.Force(end, 0.0)]
        if begin > low:
            ax.axvline(begin * 1e3, **BOUNDARY_STYLE)
        NameAbove(ax, begin * 1e3, material.name, align="left")
    ax.plot(np.array(x) * 1e3, np.array(force) * 1e3, color=COLORS[0])


# Chapter 3: tracking, and the disturbance with its estimate.


def PlotTracking(runs: ThesisRuns, task: str, *, signal: str) -> Figure:
    """Plots a signal of a tracking against time, and in grey what it is to be."""
    recording = runs(task).recording
    rows = TaskOf(recording.scenario).Panels([recording])
    shown = [row for row in rows if row.signal == signal and row.beside]
    return PlotRows(
        {"actual": recording}, shown, columns=1, width=WIDTH, row_height=ROW_HEIGHT
    )


# Chapters 4 and 5: both controllers together, and what the adaptive one learns.


def PlotBoth(runs: ThesisRuns, task: str, *, signal: str) -> Figure:
    """Plots a signal with direct force and adaptive, on each axis on which it acts."""
    both = runs.OfBoth(task)
    recordings = {
        "direct force": both.direct.recording,
        "adaptive": both.adaptive.recording,
    }
    shown = list(recordings.values())
    rows = SelectRows(TaskOf(shown[0].scenario).Panels(shown), shown, [signal])
    # The position is shown against time alone.
    columns = 1 if signal == "tool_position" else 2
    return PlotRows(
        recordings, rows, columns=columns, width=WIDTH, row_height=ROW_HEIGHT
    )


def PlotPsi(runs: ThesisRuns, task: str) -> Figure:
    """Plots the entries of Psi, and below how far each is from its initial value."""
    recording = runs(task, ADAPTIVE).recording
    psi = recording["psi"]
    n = recording.scenario.num_axes
    figure, (above, below) = TimeFigure(recording, 2)
    handles = []
    for k in range(n * n):
        label = rf"$\Psi_{{{k // n + 1}{k % n + 1}}}$" if n > 1 else r"$\Psi$"
        handles += above.plot(recording.time, psi[:, k], **RunStyle(k), label=label)
        # Psi hardly moves; this panel magnifies by how much.
        below.plot(recording.time, psi[:, k] - psi[0, k], **RunStyle(k))
    above.set_ylabel(r"$\Psi$ [1/kg]")
    below.set_ylabel(r"$\Psi - \Psi_0$ [1/kg]")
    AddLegend(figure, handles, fontsize=SMALL_FONT_SIZE)
    return figure


def PlotWeights(runs: ThesisRuns, task: str, signal: str) -> Figure:
    """Plots weights in the colour of their centre's x, the style of its distance."""
    recording = runs(task, ADAPTIVE).recording
    network = recording.scenario.controller.network
    centres, _ = equidistant_lattice(network.lower, network.upper, network.count)
    places, colors = np.unique(centres[:, 0], return_inverse=True)
    # Centres on either side of the straight path look alike.
    sides = np.round(np.linalg.norm(centres[:, 1:], axis=1), 9)
    distances, dashes = np.unique(sides, return_inverse=True)
    palette = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, len(places)))

    def Look(color: int, dash: int) -> dict[str, Any]:
        return {
            "color": palette[color],
            "linestyle": LINES[dash % len(LINES)],
            "linewidth": 1.1 if dash == 0 else 0.7,
        }

    n = recording.scenario.num_axes
    weights = recording[signal].reshape(-1, n, len(centres))
    name, unit = {"weights_1": ("W_1", "m/s²"), "weights_3": ("W_3", "N/s")}[signal]
    figure, axes = TimeFigure(recording, n)
    for k, ax in enumerate(axes):
        for i, (color, dash) in enumerate(zip(colors, dashes, strict=True)):
            ax.plot(recording.time, weights[:, k, i], **Look(color, dash))
        ax.set_ylabel(f"weights ${name}$, {AxisName(k)} [{unit}]")
    handles = [
        Key(f"$x$ = {1e3 * x:.4g} mm", **Look(i, 0)) for i, x in enumerate(places)
    ]
    if len(distances) == 1:
        distances = distances[:0]
    for i, y in enumerate(distances):
        label = rf"$y$ = {'±' if y else ''}{1e3 * y:.4g} mm"
        handles.append(Key(label, **Look(0, i) | {"color": "black"}))
    title = "centre of the Gaussian at"
    AddLegend(figure, handles, fontsize=SMALL_FONT_SIZE, title=title)
    return figure
