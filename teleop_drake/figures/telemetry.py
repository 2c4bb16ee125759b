"""Figures of a controller's internal signals, which have many components."""

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from teleop_drake.figures.style import LINES, SMALL_FONT_SIZE, RunColor
from teleop_drake.recording import Recording
from teleop_drake.tasks.panels import AxisName, SignalRow

# Up to this many components of a signal have a name each in a legend.
_MAX_NAMED_COMPONENTS = 4


def TelemetryRows(recording: Recording) -> list[SignalRow]:
    """Returns the rows for what an adaptive controller learns, if it does.

    The weights of a network are a matrix, a row of which belongs to each task axis.
    """
    n = recording["tool_position"].shape[1]
    axes = tuple(f"axis ${AxisName(k)}$" for k in range(n))
    return [
        SignalRow(
            label=label,
            unit=unit,
            signal=signal,
            components=range(recording[signal].shape[1]),
            symbol=symbol,
            groups=groups,
        )
        for signal, label, unit, symbol, groups in (
            ("psi", r"$\Psi$", "1/kg", r"\Psi", ()),
            ("weights_1", "weights $W_1$", "m/s²", "W_1", axes),
            ("weights_3", "weights $W_3$", "N/s", "W_3", axes),
        )
        if signal in recording.signals
    ]


def ComponentStyle(row: SignalRow, k: int) -> dict[str, Any]:
    """Returns how component k of a signal is drawn."""
    count = len(row.components)
    if count <= _MAX_NAMED_COMPONENTS:
        line = LINES[k % len(LINES)]
        return {"color": RunColor(k), "linestyle": line, "linewidth": 1.1}
    group = k * len(row.groups) // count if row.groups else k
    color = RunColor(group)
    return {"color": color, "linestyle": "-", "linewidth": 0.6}


def AddComponentLegend(ax: Axes, row: SignalRow) -> None:
    """Names the components of a signal in a panel, or the groups of them."""
    count = len(row.components)
    names = []
    if count <= _MAX_NAMED_COMPONENTS:
        size = math.isqrt(count)  # Matrices are recorded row by row.
        numbers = [str(k + 1) for k in range(count)]
        if size * size == count and row.signal == "psi":
            numbers = [f"{i + 1}{j + 1}" for i in range(size) for j in range(size)]
        names = [(k, f"${row.symbol}_{{{x}}}$") for k, x in enumerate(numbers)]
    elif row.groups:
        each = count // len(row.groups)
        names = [
            (i * each, f"{each} of {name}" if len(row.groups) > 1 else f"all {each}")
            for i, name in enumerate(row.groups)
        ]
    if names:
        ax.legend(
            handles=[
                Line2D([], [], label=label, **ComponentStyle(row, k))
                for k, label in names
            ],
            ncols=2,
            fontsize=SMALL_FONT_SIZE,
            frameon=False,
        )
