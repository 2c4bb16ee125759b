"""Figures of chapters 4 and 5 that show both controllers together."""

from typing import NamedTuple

from matplotlib.figure import Figure

from teleop_drake.figures.runs import PlotRows
from teleop_drake.figures.style import WIDTH
from teleop_drake.tasks.panels import AxisName, SignalRow
from teleop_drake.thesis.figures.figure import LEGEND_HEIGHT, ROW_HEIGHT, ThesisFigure
from teleop_drake.thesis.runs import ThesisRuns


class _Quantity(NamedTuple):
    """What is compared; the label of a panel has a place for the axis."""

    title: str
    caption: str
    signal: str
    label: str
    unit: str


_BOTH = (
    " Left against time, right against the position along x; dotted lines mark the end "
    "of the tissue and the surface of the bone. A cross is where a run that diverges "
    "is ended."
)

QUANTITIES = {
    "velocity": _Quantity(
        "Velocity of the tool",
        "Velocity of the tool with either controller, and in grey what the surgeon "
        "commands." + _BOTH,
        "tool_velocity",
        "velocity $v_{axis}$",
        "m/s",
    ),
    "sensed_force": _Quantity(
        "Sensed force",
        "Force of the robot on its environment, as the sensor at the tool reads it."
        + _BOTH,
        "environment_force",
        "sensed force $F_{{e,{axis}}}$",
        "N",
    ),
    "position": _Quantity(
        "Position of the tool",
        "Position of the tool with either controller against time; dotted lines mark "
        "the end of the tissue and the surface of the bone.",
        "tool_position",
        "position ${axis}$",
        "m",
    ),
    "control_force": _Quantity(
        "Control force",
        "Force that the controller asks of the robot: the delayed haptic force under "
        "direct force, the state of the backstepping law otherwise." + _BOTH,
        "control_force",
        "control force $F_{{c,{axis}}}$",
        "N",
    ),
}
"""In the order of the thesis's figures."""


def ComparisonFigure(
    *, number: str, task: str, about: str, quantity: str
) -> ThesisFigure:
    """Returns a figure that shows a quantity with direct force and adaptive."""
    shown = QUANTITIES[quantity]
    return ThesisFigure(
        number=number,
        title=shown.title,
        caption=f"{about} {shown.caption}",
        make=lambda runs: _Compare(runs, task, shown),
    )


def _Compare(runs: ThesisRuns, task: str, quantity: _Quantity) -> Figure:
    both = runs.OfBoth(task)
    n = both.adaptive.recording.scenario.num_axes
    rows = [
        SignalRow(
            label=quantity.label.format(axis=AxisName(k)),
            unit=quantity.unit,
            signal=quantity.signal,
            components=[k],
            command=n + k if quantity.signal == "tool_velocity" else None,
        )
        for k in range(n)
    ]
    recordings = {
        "direct force": both.direct.recording,
        "adaptive": both.adaptive.recording,
    }
    figure = PlotRows(recordings, rows)
    figure.set_size_inches(WIDTH, ROW_HEIGHT * n + LEGEND_HEIGHT)
    if quantity.signal == "tool_position":
        # The panels against x go; those against time take their place.
        for left, right in zip(figure.axes[::2], figure.axes[1::2], strict=True):
            cell = left.get_subplotspec()
            assert cell is not None
            left.set_subplotspec(cell.get_gridspec()[cell.rowspan.start, :])
            right.remove()
    return figure
