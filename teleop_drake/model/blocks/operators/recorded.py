"""An operator who repeats a recorded motion."""

import math

import numpy as np

from teleop_drake.loops.framework.arrays import Interval
from teleop_drake.loops.framework.validation import REQUIRED, Config, Refuse
from teleop_drake.model.blocks.operators.base import MOST_VELOCITY
from teleop_drake.model.blocks.operators.planned import (
    Plan,
    PlannedConfig,
    PlanOfPieces,
)
from teleop_drake.model.kinds import FileOf, GivenFile
from teleop_drake.model.laws.piecewise_polynomial import linear_pieces
from teleop_drake.model.tables.motion import Motion, ReadMotion


@Config
class RecordedConfig(PlannedConfig):
    """v_d(t) from a file: linear between its rows, zero before and after."""

    kind = "recorded"
    file_fields = ("file",)

    # A table of times and a velocity or a position for each axis; see
    # tables.motion. A mapping {file, columns: {time: ..., velocity: [...]}, units,
    # quantity, bandwidth} names what the file does not tell.
    file: GivenFile | None = REQUIRED

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; reads the file."""
        super().Check(path, num_axes)
        if FileOf(self.file) is None:
            allowed = "a table of time and v_d, or a mapping {file: ...}"
            Refuse(f"{path}.file", self.file, allowed)
        motion = ReadMotion(f"{path}.file", self.file, num_axes)
        largest = float(np.abs(motion.velocities).max())
        if largest > MOST_VELOCITY:
            allowed = f"of velocities up to {MOST_VELOCITY:g} m/s, not {largest:g} m/s"
            Refuse(f"{path}.file", self.file, allowed)

    def MakePlan(self) -> Plan:
        """Returns the plan that is linear between the rows; steps end at each row."""
        motion = ReadMotion("surgeon.file", self.file, np.size(self.velocity))
        times = motion.times
        return PlanOfPieces(
            *linear_pieces(times, motion.velocities),
            ends=_Ends(motion),
            longest_step=motion.period or float(np.diff(times).min()),
            notes=[motion.summary],
        )


def _Ends(motion: Motion) -> list[Interval]:
    """Returns the times of the rows, where the velocity bends; see Plan.ends."""
    times = motion.times
    if motion.period is None:
        return [(time, math.inf) for time in times.tolist()]
    return [(float(times[0]), motion.period), (float(times[-1]), math.inf)]
