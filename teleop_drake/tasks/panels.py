"""Panels of a run's figures: plain data, which teleop_drake.figures draws."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teleop_drake.environments import ShownNormal
from teleop_drake.recording import Recording
from teleop_drake.signals import AxesOf


@dataclass(kw_only=True)
class SignalRow:
    """One signal: a panel against time and one against position.

    Attributes:
        label: What the axis shows, without the unit.
        unit: SI unit; empty if there is none.
        signal: Name of the signal.
        components: Which of its components are shown.
        command: Component of the operator's commands that is shown beside, or None.
        symbol: Name of the components in a legend, if there is more than one.
        groups: Names of as many equal parts of the components, each of which has one
            colour: the rows of a matrix. Empty: every component has its own.
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
        label: What it is; the name of the axis comes after it.
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
        rows: From top to bottom.
        names: Of the lines, in the order of the signals of a row.
    """

    rows: Sequence[AxisRow]
    names: Sequence[str]


def AxisName(axis: int) -> str:
    """Returns how a task axis is called.

    Args:
        axis: Its number, from 0 on.
    """
    return AxesOf(6)[axis]


def NormalOfRuns(recordings: Sequence[Recording]) -> np.ndarray:
    """Returns along which direction (n,) positions are shown; see ShownNormal.

    Args:
        recordings: Runs of robots with as many axes, at least one.
    """
    num_axes = recordings[0]["tool_position"].shape[1]
    surfaces = [surface for recording in recordings for surface in recording.surfaces]
    return ShownNormal(surfaces, num_axes)
