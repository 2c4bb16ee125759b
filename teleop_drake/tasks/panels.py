"""Panels of a run's figures, as plain data that teleop_drake.figures draws."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teleop_drake.blocks.environments import ShownNormal
from teleop_drake.recording import Recording
from teleop_drake.signals import AxesOf


@dataclass(kw_only=True)
class SignalRow:
    """One signal: a panel against time and one against position.

    Attributes:
        label: The label of the axis, without the unit.
        unit: SI unit; empty if there is none.
        signal: Name of the signal.
        components: The indices of the components that are shown.
        command: The index of the operator's command that is drawn beside the signal;
            None: no command is drawn.
        symbol: Name of the components in a legend, if there is more than one.
        groups: Names of the groups into which the components are divided equally, such
            as the rows of a matrix. A group has one colour. Empty: each component has a
            colour of its own.
    """

    label: str
    unit: str
    signal: str
    components: Sequence[int]
    command: int | None = None
    symbol: str = ""
    groups: Sequence[str] = ()


@dataclass(kw_only=True)
class AxisRow:
    """One quantity against time, with a panel for each task axis.

    Attributes:
        label: The label of the quantity, to which the name of the axis is appended.
        unit: SI unit.
        signals: Names of the signals (n each), a line for each.
        reference: Name of the signal that is subtracted from them; empty: none.
    """

    label: str
    unit: str
    signals: Sequence[str]
    reference: str = ""


@dataclass(kw_only=True)
class AxisPanels:
    """A figure with a column for each task axis.

    Attributes:
        rows: The rows from top to bottom.
        names: Names of the lines, in the order of the signals of a row.
    """

    rows: Sequence[AxisRow]
    names: Sequence[str]


def AxisName(axis: int) -> str:
    """Returns the name of a task axis.

    Args:
        axis: The index of the axis, from 0.
    """
    return AxesOf(6)[axis]


def NormalOfRuns(recordings: Sequence[Recording]) -> np.ndarray:
    """Returns the direction (n,) along which positions are shown; see ShownNormal.

    Args:
        recordings: One run or more, of robots with the same number of axes.
    """
    num_axes = recordings[0]["tool_position"].shape[1]
    surfaces = [surface for recording in recordings for surface in recording.surfaces]
    return ShownNormal(surfaces, num_axes)
