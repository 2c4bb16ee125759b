"""Draws teleop_drake/docs/two_delays.png: two delays of one pipe that slows down.

The water in a pipe of 1 m flows at 1 m/s and, from t = 3 s on, at 0.5 m/s. Marks are
put into it every half second. A VariableTransportDelay delivers each when it has
travelled; a VariableDelay by 1 m over the present speed goes back at 3 s, and delivers
some of them twice.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parents[1]))

from signal_delays import Conveyor, Source, Square, TimeDelay

from teleop_drake import simulate
from teleop_drake.figures.saving import SaveFigure

PICTURE = Path(__file__).parents[2] / "teleop_drake" / "docs" / "two_delays.png"


def marks(t):
    """Returns marks whose height tells when they were made."""
    return np.array([t * np.where((2 * t) % 1 < 0.5, 1.0, 0.0)])


def Draw() -> Figure:
    """Returns the figure."""
    runs = {
        "signal": None,
        "VariableDelay": TimeDelay(Source(marks), Square(6.0, (2.0, 1.0))),
        "VariableTransportDelay": Conveyor(Source(marks), Square(6.0, (0.5, 1.0)), 1.0),
    }
    times = np.linspace(0.0, 5.99, 4000)
    curves = {"signal": np.array([marks(t)[0] for t in times])}
    for name, diagram in runs.items():
        if diagram is not None:
            run = simulate(diagram, duration=6.0)
            curves[name] = run.Interpolate("out", times)[:, 0]
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots(len(curves), 1, sharex=True, sharey=True)
    for axis, (name, curve) in zip(axes, curves.items(), strict=True):
        axis.plot(times, curve, color="black", linewidth=1.2)
        axis.axvline(3.0, color="#D55E00", linestyle="--", linewidth=1.0)
        axis.set_title(name, loc="left", fontsize=10)
        axis.set_ylabel("made at (s)")
    axes[-1].set_xlabel("time (s); the flow slows down from 1 to 0.5 m/s at 3 s")
    return figure


if __name__ == "__main__":
    SaveFigure(Draw(), PICTURE)
