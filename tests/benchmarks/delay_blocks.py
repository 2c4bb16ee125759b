"""Draws teleop_drake/docs/delay_blocks.png: what four blocks make of one signal.

Marks of a quarter of a second tell when they were made. The water in a pipe of 1 m
flows at 1 m/s and, from t = 3.1 s on, at 0.5 m/s. A VariableTransportDelay delivers
each mark when it has travelled; a VariableDelay by 1 m over the present speed goes back
at 3.1 s, and delivers some of them twice. The delay and the window of the other two
blocks are 1 s.
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parents[1]))

from pydrake.systems.framework import DiagramBuilder
from signal_delays import Conveyor, Square, TimeDelay, opposite

from teleop_drake import MovingWindow, TransportDelay, simulate
from teleop_drake.loops.kernel import FixedBlock, Kernel, Transition
from teleop_drake.study.figures.saving import SaveFigure

PICTURE = Path(__file__).parents[2] / "teleop_drake" / "docs" / "delay_blocks.png"


SLOWER = 3.1


def height(t, mode):
    return t * (1 + mode) / 2


def Marks():
    """Returns a block of marks whose height tells when they were made."""
    flip = Transition(mode=(opposite, "mode"), period=0.25, offset=0.25)
    kernel = Kernel(outputs={"y": (height, "time", "mode")}, transitions={"flip": flip})
    return FixedBlock("", kernel, inputs={}, outputs={"y": 1}, mode=[1.0])


def Behind(block):
    """Returns the times and the output of a block behind the marks."""
    builder = DiagramBuilder()
    marks = builder.AddNamedSystem("marks", Marks())
    builder.AddNamedSystem("block", block)
    builder.Connect(marks.get_output_port(), block.get_input_port())
    builder.ExportOutput(block.get_output_port(), "out")
    run = simulate(builder.Build(), duration=6.0)
    return run.time, run["out"]


def Draw() -> Figure:
    """Returns the figure."""
    period = 2 * SLOWER
    late = simulate(TimeDelay(Marks(), Square(period, (2.0, 1.0))), duration=6.0)
    carried = simulate(Conveyor(Marks(), Square(period, (0.5, 1.0)), 1.0), duration=6.0)
    curves = {
        "signal": (late.time, late["sent"]),
        "TransportDelay": Behind(TransportDelay(1.0, 1)),
        "VariableDelay": (late.time, late["out"]),
        "VariableTransportDelay": (carried.time, carried["out"]),
        "MovingWindow": Behind(MovingWindow(1.0, 1)),
    }
    figure = Figure(figsize=(7.0, 5.6), layout="constrained")
    axes = figure.subplots(len(curves), 1, sharex=True, sharey=True)
    for axis, (name, curve) in zip(axes, curves.items(), strict=True):
        axis.plot(*curve, color="black", linewidth=1.2)
        axis.axvline(SLOWER, color="#D55E00", linestyle="--", linewidth=1.0)
        axis.set_title(name, loc="left", fontsize=10)
        axis.set_ylabel("made at (s)")
    axes[-1].set_xlabel(
        f"time (s); the flow slows down from 1 to 0.5 m/s at {SLOWER} s"
    )
    return figure


if __name__ == "__main__":
    SaveFigure(Draw(), PICTURE)
