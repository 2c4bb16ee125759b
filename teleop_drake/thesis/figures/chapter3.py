"""Figures 3.2 to 3.5: tracking, and the disturbance with its estimate."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from teleop_drake.figures.style import COLORS, FONT_SIZE, LINES, Widen
from teleop_drake.thesis.figures.figure import AddLegendAbove, ThesisFigure, TimeFigure
from teleop_drake.thesis.runs import ThesisRuns


def _PlotAgainstReference(
    runs: ThesisRuns, task: str, signals: Mapping[str, str], label: str, unit: str
) -> Figure:
    """Plots signals, by their names in the legend, on each axis against time."""
    recording = runs(task).recording
    figure, axes = TimeFigure(recording, 2)
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
    AddLegendAbove(figure, axes[0].get_lines()[-len(signals) :])
    return figure


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
            make=lambda runs: _PlotAgainstReference(
                runs,
                task,
                {"actual": "environment_force", "estimated": "disturbance_estimate"},
                "disturbance",
                "N",
            ),
        ),
    ]


FIGURES = [
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
]
"""The figures of the chapter."""
