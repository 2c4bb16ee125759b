"""Figures 2.1 and 2.4: the loop and the stiffness of the environment."""

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydrake.systems.framework import Diagram

from teleop_drake.environments.surface import (
    CONTACT,
    FindSurface,
    MaterialAt,
    Surface,
)
from teleop_drake.figures.style import (
    BOUNDARY_STYLE,
    COLORS,
    FONT_SIZE,
    SMALL_FONT_SIZE,
    WIDTH,
    FormatAxes,
)
from teleop_drake.scenario import AsTeleoperation, LoadScenario
from teleop_drake.teleoperator import MakeTeleoperator
from teleop_drake.thesis.figures.figure import LEGEND_HEIGHT, ROW_HEIGHT, ThesisFigure
from teleop_drake.thesis.runs import ThesisRuns


def _MakeLoop(runs: ThesisRuns) -> Diagram:
    """Returns the diagram of the loop; no run is needed."""
    return MakeTeleoperator(AsTeleoperation(LoadScenario("one_dof")))


def _PlotStiffness(runs: ThesisRuns) -> Figure:
    """Plots the springs of one axis at the scale of each; no run is needed."""
    scenario = AsTeleoperation(LoadScenario("one_dof"))
    surfaces = scenario.Surfaces()
    contact = FindSurface(surfaces, CONTACT)
    assert contact is not None
    surface = float(contact.point_W[0])
    figure = Figure(figsize=(WIDTH, ROW_HEIGHT + LEGEND_HEIGHT), layout="constrained")
    # Bone is 15000 times as stiff as tissue: each panel has the scale of one of them.
    tissue, bone = figure.subplots(1, 2)
    _DrawStiffness(tissue, surfaces, 0.0, surface)
    tissue.set_xlabel("position $x$ [mm]", fontsize=FONT_SIZE)
    _DrawStiffness(bone, surfaces, surface - 2e-5, surface + 6e-5)
    bone.set_xlabel("position $x$ [mm], at the bone", fontsize=FONT_SIZE)
    bone.ticklabel_format(axis="x", useOffset=False)
    tissue.set_ylim(*(1.25 * np.array(tissue.get_ylim())))
    tissue.plot([surface * 1e3] * 2, [0.0, tissue.get_ylim()[1]], color=COLORS[0])
    return figure


def _DrawStiffness(
    ax: Axes, surfaces: Sequence[Surface], low: float, high: float
) -> None:
    """Draws the force of the springs, in mN, from low to high (both in m)."""
    starts = [float(surface.point_W[0]) for surface in surfaces]
    FormatAxes(ax)
    # Both sides of a jump.
    edges = [low, *(start for start in starts if low < start < high), high]
    x, force = [], []
    for begin, end in itertools.pairwise(edges):
        material = MaterialAt(surfaces, [begin])
        assert material is not None
        x += [begin, end]
        force += [material.Force(begin, 0.0), material.Force(end, 0.0)]
    ax.plot(np.array(x) * 1e3, np.array(force) * 1e3, color=COLORS[0])
    ax.set_ylabel("stiffness force [mN]", fontsize=FONT_SIZE)
    ends = [*starts[1:], high]
    for surface, start, end in zip(surfaces, starts, ends, strict=True):
        if end <= low or start >= high or surface.material is None:
            continue
        if start > low:
            ax.axvline(start * 1e3, **BOUNDARY_STYLE)
        ax.annotate(
            surface.material.name,
            (max(start, low) * 1e3, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            va="bottom",
            fontsize=SMALL_FONT_SIZE,
        )


FIGURES = [
    ThesisFigure(
        number="2.1",
        title="The loop",
        caption="Surgeon and haptic device, the two channels, controller, robot "
        "and environment, drawn from the very diagram that is simulated.",
        make=_MakeLoop,
    ),
    ThesisFigure(
        number="2.4",
        title="Stiffness profile",
        caption="Force of the environment's springs against the position of the "
        "tool: on the left at the scale of the tissue, on the right at that of the "
        "bone. Damping is left out.",
        make=_PlotStiffness,
    ),
]
"""The figures of the chapter."""
