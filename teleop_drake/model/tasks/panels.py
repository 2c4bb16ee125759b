"""Panels of a run's figures, as plain data that teleop_drake.study.figures draws."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teleop_drake.model.blocks.environments import ShownNormal
from teleop_drake.model.signals import AxesOf
from teleop_drake.model.task_recording import TaskRecording


@dataclass(kw_only=True)
class SignalRow:
    """One signal: a panel against time and, of a teleoperation, against position.

    Attributes:
        label: The label of the axis, without the unit.
        unit: SI unit; empty if there is none.
        signal: Name of the signal.
        components: The indices of the components that are shown.
        command: The index of the operator's command that is drawn beside the signal;
            None if no command is drawn.
        beside: Name of a signal whose components are drawn beside those of the signal;
            empty if there is none.
        reference: Name of a signal that is subtracted from the signal; empty if there
            is none.
        groups: Names of the groups into which the components are divided equally, such
            as the rows of a matrix; each component or all of them may be a group. They
            are required for more than one component. Each group has its own colour.
    """

    label: str
    unit: str
    signal: str
    components: Sequence[int]
    command: int | None = None
    beside: str = ""
    reference: str = ""
    groups: Sequence[str] = ()


def AxisName(axis: int) -> str:
    """Returns the name of a task axis.

    Args:
        axis: The index of the axis, from 0.
    """
    return AxesOf(6)[axis]


def NormalOfRuns(recordings: Sequence[TaskRecording]) -> np.ndarray:
    """Returns the direction (n,) along which positions are shown; see ShownNormal.

    Args:
        recordings: One run or more, of robots with the same number of axes.
    """
    num_axes = recordings[0]["tool_position"].shape[1]
    surfaces = [surface for recording in recordings for surface in recording.surfaces]
    return ShownNormal(surfaces, num_axes)
