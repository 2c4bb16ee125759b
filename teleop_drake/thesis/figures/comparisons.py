"""Figures of chapters 4 and 5 that show both controllers together."""

from dataclasses import dataclass

from matplotlib.figure import Figure

from teleop_drake.figures.runs import PlotRows
from teleop_drake.figures.style import WIDTH
from teleop_drake.tasks.panels import AxisName, SignalRow
from teleop_drake.thesis.claims.requests import ADAPTIVE, DIRECT
from teleop_drake.thesis.figures.figure import LEGEND_HEIGHT, ROW_HEIGHT, ThesisFigure
from teleop_drake.thesis.runs import ThesisRuns


@dataclass(frozen=True, kw_only=True)
class _Quantity:
    """What is compared.

    Attributes:
        title: In a few words.
        caption: What the curves are.
        signal: Name of the recorded signal.
        label: Of a panel, with the axis left open.
        unit: Of the signal.
        has_command: Whether the surgeon's command is shown with it.
        is_position: Whether it is the position, which is shown against time only.
    """

    title: str
    caption: str
    signal: str
    label: str
    unit: str
    has_command: bool = False
    is_position: bool = False

    def Rows(self, n: int) -> list[SignalRow]:
        """Returns a row of panels for each of n axes."""
        return [
            SignalRow(
                label=self.label.format(axis=AxisName(k)),
                unit=self.unit,
                signal=self.signal,
                components=[k],
                command=n + k if self.has_command else None,
            )
            for k in range(n)
        ]


_BOTH = (
    " Left against time, right against the position along x; dotted lines mark the end "
    "of the tissue and the surface of the bone. A cross is where a run that diverges "
    "is ended."
)

_QUANTITIES = {
    "velocity": _Quantity(
        title="Velocity of the tool",
        caption="Velocity of the tool with either controller, and in grey what the "
        "surgeon commands." + _BOTH,
        signal="tool_velocity",
        label="velocity $v_{axis}$",
        unit="m/s",
        has_command=True,
    ),
    "sensed_force": _Quantity(
        title="Sensed force",
        caption="Force of the robot on its environment, as the sensor at the tool "
        "reads it." + _BOTH,
        signal="environment_force",
        label="sensed force $F_{{e,{axis}}}$",
        unit="N",
    ),
    "position": _Quantity(
        title="Position of the tool",
        caption="Position of the tool with either controller against time; dotted "
        "lines mark the end of the tissue and the surface of the bone.",
        signal="tool_position",
        label="position ${axis}$",
        unit="m",
        is_position=True,
    ),
    "control_force": _Quantity(
        title="Control force",
        caption="Force that the controller asks of the robot: the delayed haptic force "
        "under direct force, the state of the backstepping law otherwise." + _BOTH,
        signal="control_force",
        label="control force $F_{{c,{axis}}}$",
        unit="N",
    ),
}


def ComparisonFigure(
    *, number: str, task: str, about: str, quantity: str
) -> ThesisFigure:
    """Returns a figure that shows a quantity with direct force and adaptive."""
    shown = _QUANTITIES[quantity]
    return ThesisFigure(
        number=number,
        title=shown.title,
        caption=f"{about} {shown.caption}",
        requests=[(task, DIRECT), (task, ADAPTIVE)],
        make=lambda runs: _Compare(runs, task, shown),
    )


def _Compare(runs: ThesisRuns, task: str, quantity: _Quantity) -> Figure:
    recordings = {
        "direct force": runs(task, **DIRECT),
        "adaptive": runs(task, **ADAPTIVE),
    }
    num_axes = recordings["adaptive"].scenario.num_axes
    figure = PlotRows(recordings, quantity.Rows(num_axes))
    figure.set_size_inches(WIDTH, ROW_HEIGHT * num_axes + LEGEND_HEIGHT)
    if quantity.is_position:
        # The panels against x go; those against time take their place.
        for left, right in zip(figure.axes[::2], figure.axes[1::2], strict=True):
            cell = left.get_subplotspec()
            assert cell is not None
            left.set_subplotspec(cell.get_gridspec()[cell.rowspan.start, :])
            right.remove()
    return figure
