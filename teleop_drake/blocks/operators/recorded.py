"""An operator who repeats a recorded velocity."""

import math

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.blocks.channels.base import SHORTEST_TIME
from teleop_drake.blocks.operators.planned import Plan, PlannedConfig, PlanOfPieces
from teleop_drake.files import ReadNumbers, ReadRows
from teleop_drake.numerics.piecewise_polynomial import linear_pieces
from teleop_drake.validation import REQUIRED, Config, Refuse, ScenarioError, Show

MAX_UNEVEN = 100
"""Largest number of rows of a file that are not at equal distances in time."""


@Config
class RecordedConfig(PlannedConfig):
    """v_d(t) from a file: linear between its rows, zero before and after."""

    kind = "recorded"
    file_fields = ("file",)

    # CSV file of time (s, ascending) and v_d (m/s, n entries); a header line is
    # allowed. A file of more than MAX_UNEVEN rows must have them at equal distances in
    # time, except for the last one.
    file: str | None = REQUIRED

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; reads the file."""
        super().Check(path, num_axes)
        if self.file is None:
            Refuse(f"{path}.file", self.file, "the path of a CSV file of time and v_d")
        ReadCommand(f"{path}.file", self.file, num_axes)

    def MakePlan(self) -> Plan:
        """Returns the plan that is linear between the rows; steps end at each row."""
        assert self.file is not None
        n = np.size(self.velocity)
        times, velocities = ReadCommand("surgeon.file", self.file, n)
        return PlanOfPieces(
            *linear_pieces(times, velocities),
            ends=_Ends(times),
            longest_step=float(np.diff(times).min()),
        )


def ReadCommand(path: str, file: str, num_axes: int) -> tuple[Array, Array]:
    """Returns times (N,) in s and velocities (N, n) in m/s of a CSV file; N >= 2.

    Its first line may be a header. Empty lines and those that begin with # are skipped.

    Args:
        path: The field that names the file, for messages.

    Raises:
        ScenarioError: If the file cannot be read or a line is not allowed.
    """
    origin = f"{path} = {Show(file)}"
    numbered = ReadRows(file, origin)
    if numbered and _IsHeader(numbered[0][1]):
        del numbered[0]
    columns = ["time", *(f"v{i + 1}" for i in range(num_axes))]
    table = ReadNumbers(numbered, origin, columns, least_step=SHORTEST_TIME)
    if len(table) < 2:
        raise ScenarioError(f"{origin}: must have at least two rows, not {len(table)}")
    if table[0, 0] < 0:
        raise ScenarioError(f"{origin}: must begin at a time >= 0 (s)")
    if len(table) > MAX_UNEVEN and not _IsEven(table[:, 0]):
        raise ScenarioError(
            f"{origin}: must have rows at equal distances in time, except for the last "
            f"one, or at most {MAX_UNEVEN} rows, not {len(table)}"
        )
    return table[:, 0], table[:, 1:]


def _IsEven(times: Array) -> bool:
    """Returns whether the times are equidistant; the last distance may be shorter."""
    distances = np.diff(times)
    even = np.allclose(distances[:-1], distances[0], rtol=1e-6, atol=0)
    return bool(even and distances[-1] <= distances[0] * (1 + 1e-6))


def _Ends(times: Array) -> list[tuple[float, float]]:
    """Returns the times of the rows, where the velocity bends; see Plan.ends."""
    if not _IsEven(times):
        return [(time, math.inf) for time in times.tolist()]
    period = float(times[1] - times[0])
    return [(float(times[0]), period), (float(times[-1]), math.inf)]


def _IsHeader(line: str) -> bool:
    """Returns whether every column begins with a letter."""
    names = [name.strip(' "').lower() for name in line.split(",")]
    numbers = {"nan", "inf", "infinity"}
    return all(name[:1].isalpha() and name not in numbers for name in names)
