"""Figures of chapters 4 and 5 that show what the adaptive controller learns."""

from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from teleop_drake.figures.style import COLORS, FONT_SIZE, LINES
from teleop_drake.laws.gaussian_network import equidistant_lattice
from teleop_drake.tasks.panels import AxisName
from teleop_drake.thesis.figures.figure import AddLegendAbove, ThesisFigure, TimeFigure
from teleop_drake.thesis.runs import ADAPTIVE, ThesisRuns

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


def LearnedFigure(*, number: str, task: str, about: str, quantity: str) -> ThesisFigure:
    """Returns a figure that shows what the adaptive controller learns over time."""
    title, caption = _LEARNED[quantity]
    return ThesisFigure(
        number=number,
        title=title,
        caption=f"{about} {caption}",
        make=(
            (lambda runs: _PlotPsi(runs, task))
            if quantity == "psi"
            else (lambda runs: _PlotWeights(runs, task, quantity))
        ),
    )


def _PlotPsi(runs: ThesisRuns, task: str) -> Figure:
    """Plots the entries of Psi, and below how far each is from its initial value."""
    recording = runs(task, ADAPTIVE).recording
    n = recording.scenario.num_axes
    figure, (above, below) = TimeFigure(recording, 2)
    # Psi hardly moves; the second panel magnifies by how much.
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
    AddLegendAbove(figure, above.get_lines()[-n * n :])
    return figure


def _PlotWeights(runs: ThesisRuns, task: str, signal: str) -> Figure:
    """Plots weights in the colour of their centre's x, the style of its distance."""
    recording = runs(task, ADAPTIVE).recording
    scenario = recording.scenario
    n = scenario.num_axes
    network = scenario.controller.network
    centres = equidistant_lattice(network.lower, network.upper, network.count)
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

    figure, axes = TimeFigure(recording, n)
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
    AddLegendAbove(figure, handles, "centre of the Gaussian at")
    return figure
