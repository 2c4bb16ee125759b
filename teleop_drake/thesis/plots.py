"""The plots of the thesis's figures, drawn from runs."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydrake.systems.framework import Diagram

from teleop_drake.loops.framework.surface import (
    CONTACT,
    FindSurface,
    MaterialAt,
    Surface,
)
from teleop_drake.model.scenario import AsTeleoperation, LoadScenario
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks.panels import AxisName, SignalRow
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.figures.layout import MakePanels
from teleop_drake.study.figures.runs import PlotRows, PlotRun
from teleop_drake.study.figures.style import (
    BOUNDARY_STYLE,
    COLORS,
    WIDTH,
    FormatAxes,
    NameAbove,
)
from teleop_drake.thesis.runs import ADAPTIVE, ThesisRuns

ROW_HEIGHT = 1.9  # inches
LEGEND_HEIGHT = 0.7  # inches


# Chapter 2: the loop and the stiffness of the environment.


def MakeLoop(runs: ThesisRuns) -> Diagram:
    """Returns the diagram of the loop; no run is needed."""
    return MakeTeleoperator(AsTeleoperation(LoadScenario("one_dof")))


def PlotStiffness(runs: ThesisRuns) -> Figure:
    """Plots the stiffness force of one_dof, at two scales; no run is needed."""
    scenario = AsTeleoperation(LoadScenario("one_dof"))
    surfaces = scenario.Surfaces()
    contact = FindSurface(surfaces, CONTACT)
    assert contact is not None
    surface = float(contact.point_W[0])
    # Bone is 15000 times as stiff as tissue: each panel has the scale of one of them.
    height = ROW_HEIGHT + LEGEND_HEIGHT
    figure, panels = MakePanels(1, 2, height=height, share_y="none")
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
        # Both ends of the layer: between layers the force jumps.
        x += [begin, end]
        force += [material.Force(begin, 0.0), material.Force(end, 0.0)]
        if begin > low:
            ax.axvline(begin * 1e3, **BOUNDARY_STYLE)
        NameAbove(ax, begin * 1e3, material.name, align="left")
    ax.plot(np.array(x) * 1e3, np.array(force) * 1e3, color=COLORS[0])


# Chapter 3: tracking, and the disturbance with its estimate.


def PlotTracking(runs: ThesisRuns, task: str, *, signal: str) -> Figure:
    """Plots a signal of a tracking task as `teleop-drake run --signals` does."""
    return PlotRun(runs(task).recording, signals=[signal])


# Chapters 4 and 5: both controllers together, and what the adaptive one learns.


def PlotBoth(
    runs: ThesisRuns, task: str, *, signal: str, label: str, unit: str
) -> Figure:
    """Plots a signal of both controllers; {axis} in the label is the axis's name."""
    both = runs.OfBoth(task)
    n = both.adaptive.recording.scenario.num_axes
    rows = [
        SignalRow(
            label=label.format(axis=AxisName(k)),
            unit=unit,
            signal=signal,
            components=[k],
            command=n + k if signal == "tool_velocity" else None,
        )
        for k in range(n)
    ]
    recordings = {
        "direct force": both.direct.recording,
        "adaptive": both.adaptive.recording,
    }
    # The position is shown against time alone.
    columns = 1 if signal == "tool_position" else 2
    return PlotRows(
        recordings, rows, columns=columns, width=WIDTH, row_height=ROW_HEIGHT
    )


def PlotPsi(runs: ThesisRuns, task: str) -> Figure:
    """Plots the entries of Psi, and below them their changes since the start."""
    recording = runs(task, ADAPTIVE).recording
    psi = recording["psi"]
    # Psi hardly moves; the panel below magnifies by how much.
    signals = recording.signals | {"change of psi": psi - psi[0]}
    axes = range(1, recording.scenario.num_axes + 1)
    entries = [f"{i}{j}" for i, j in itertools.product(axes, repeat=2)]
    rows = [
        SignalRow(
            label=f"${symbol}$",
            unit="1/kg",
            signal=signal,
            components=range(psi.shape[1]),
            groups=[f"${symbol}_{{{entry}}}$" for entry in entries],
        )
        for signal, symbol in (("psi", r"\Psi"), ("change of psi", r"\Delta\Psi"))
    ]
    return _PlotAgainstTime(dataclasses.replace(recording, signals=signals), rows)


def PlotWeights(runs: ThesisRuns, task: str, signal: str) -> Figure:
    """Plots the weights of each task axis, coloured by the x of their centres."""
    recording = runs(task, ADAPTIVE).recording
    network = recording.scenario.controller.network
    places = np.linspace(network.lower[0], network.upper[0], network.count[0])
    n = recording.scenario.num_axes
    columns = np.arange(recording[signal].shape[1]).reshape(n, -1)
    name, unit = {"weights_1": ("W_1", "m/s²"), "weights_3": ("W_3", "N/s")}[signal]
    rows = [
        SignalRow(
            label=f"weights ${name}$, ${AxisName(k)}$",
            unit=unit,
            signal=signal,
            components=own,
            groups=[f"$x$ = {1e3 * x:.4g} mm" for x in places],
        )
        for k, own in enumerate(columns.tolist())
    ]
    return _PlotAgainstTime(recording, rows)


def _PlotAgainstTime(recording: TaskRecording, rows: Sequence[SignalRow]) -> Figure:
    return PlotRows(
        {"": recording}, rows, columns=1, width=WIDTH, row_height=ROW_HEIGHT
    )
