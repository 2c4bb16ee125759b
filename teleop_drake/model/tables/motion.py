"""A recorded motion: velocities, or positions that are differentiated.

It is a table of any kind that ReadTable() reads, with a column of times and one for
each axis. Velocities are taken as they are. Positions are differentiated with a stated
bandwidth, and the summary tells how far the integral of the result is from them.
"""

import functools
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import (
    CheckChoice,
    CheckNumber,
    ScenarioError,
    Show,
)
from teleop_drake.model.laws.smoothing import SAMPLES_PER_CYCLE, smoothed_derivative
from teleop_drake.model.tables.even_rows import EvenRows, MakeEven
from teleop_drake.model.tables.headers import UNITS
from teleop_drake.model.tables.measured import ShowTime
from teleop_drake.model.tables.motion_columns import (
    QUANTITIES,
    ROLES,
    FindColumns,
    MotionColumns,
)
from teleop_drake.model.tables.reader import (
    IsBinary,
    ReadAnyText,
    ReadTable,
    TableOfText,
)
from teleop_drake.model.tables.source import TableSource
from teleop_drake.model.tables.stamps import Times
from teleop_drake.model.tables.table import Table

# The bandwidth in Hz of the derivative of positions, if none is given. Assumed:
# voluntary motions of a hand are slower, physiological tremor is at 8 to 12 Hz.
_BANDWIDTH = 10.0


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A recorded motion.

    Attributes:
        times: The times, s, ascending (N).
        velocities: The velocities at these times, m/s or rad/s (N, n).
        period: The distance of the rows, s; the last one may be shorter. None: the
            times are uneven.
        summary: A line that tells what was read.
    """

    times: Array
    velocities: Array
    period: float | None
    summary: str


def ReadMotion(path: str, given: Any, num_axes: int) -> Motion:
    """Reads a recorded motion of n axes from a file.

    Times are as in the file; those of a clock that shows dates or the time of day count
    from the first row.

    Args:
        path: The field that names the file, for messages.
        given: The path of the file, or a mapping {file, columns: {time, velocity: [...]
            or position: [...]}, units: {role: unit}, quantity, bandwidth: Hz}.
        num_axes: n.

    Raises:
        ScenarioError: If the file cannot be read, or leaves anything unclear.
    """
    source = TableSource.Of(path, given, ROLES, ("quantity", "bandwidth"))
    if "quantity" in source.options:
        CheckChoice(f"{path}.quantity", source.options["quantity"], QUANTITIES)
    if "bandwidth" in source.options:
        CheckNumber(f"{path}.bandwidth", source.options["bandwidth"], "Hz", above=0)
    if IsBinary(source.file):
        return _MotionOf(ReadTable(path, source.file), source, num_axes)
    text = ReadAnyText(source.file, source.origin)
    return _OfText(text, path, json.dumps(given, default=str), num_axes)


# A scenario's checks, its plan and its steps ask for the same file, one after another.
@functools.lru_cache(maxsize=4)
def _OfText(text: str, path: str, given: str, num_axes: int) -> Motion:
    source = TableSource.Of(path, json.loads(given), ROLES, ("quantity", "bandwidth"))
    return _MotionOf(TableOfText(text, source.origin), source, num_axes)


def _MotionOf(table: Table, source: TableSource, num_axes: int) -> Motion:
    """Returns the motion of a table."""
    columns = FindColumns(table, source, num_axes)
    read = table.Times(columns.time, source.units.get("time"))
    values = np.stack(
        [_Axis(table, name, columns, source) for name in columns.axes], axis=1
    )
    times, values, missing = _Rows(table, read, values)
    if columns.quantity == "position":
        rows, remark = _Differentiated(times, values, columns, source)
    else:
        source.RefuseKeys("where velocities are read", "bandwidth")
        rows = MakeEven(times, values)
        remark = f"velocity in {', '.join(map(Show, columns.axes))}"
    remarks = [*missing, remark, *columns.remarks, *_Assumed(table, columns, read)]
    span = float(times[-1] - times[0])
    largest = float(np.abs(rows.values).max())
    return Motion(
        times=rows.times,
        velocities=rows.values,
        period=rows.period,
        summary=f"{len(times)} rows in {ShowTime(span)}, {rows.remark}, "
        + ", ".join(remarks)
        + f", up to {largest:.4g} m/s, clock: {read.clock}",
    )


def _Axis(
    table: Table, column: str, columns: MotionColumns, source: TableSource
) -> Array:
    """Returns the numbers of an axis in SI (N); NaN: missing."""
    # Up to three axes are directions; of more, some are rotations.
    of_direction, of_rotation = QUANTITIES[columns.quantity]
    quantities = [of_direction, *[of_rotation] * (len(columns.axes) > 3)]
    unit = source.units.get(columns.quantity) or table.UnitOf(column)
    if unit and (unit not in UNITS or UNITS[unit].quantity not in quantities):
        # One spelling of each: mm/s also stands for mm_s and mm per s.
        allowed = [
            x
            for x, y in UNITS.items()
            if y.quantity in quantities and x.replace("/", "").isalpha()
        ]
        raise ScenarioError(
            f"{table.Place(column)}: unit {Show(unit)}: must be one of "
            f"{', '.join(allowed)}"
        )
    return table.Values(column, unit)


def _Rows(
    table: Table, read: Times, values: Array
) -> tuple[Array, Array, tuple[str, ...]]:
    """Returns the times and values of rows that are complete and ascend in time.

    Rows that are there twice are left out.
    """
    has_values = ~np.isnan(values).any(axis=1)
    times = read.seconds[has_values]
    lines = table.lines[has_values]
    complete = values[has_values]
    if len(times) < 2:
        raise ScenarioError(
            f"{table.origin}: must have at least two rows, not {len(times)}"
        )
    steps = np.diff(times)
    is_same = (steps == 0) & (np.diff(complete, axis=0) == 0).all(axis=1)
    for i in np.flatnonzero((steps <= 0) & ~is_same)[:1]:
        raise ScenarioError(
            f"{table.origin}: line {lines[i + 1]}: must be later than the line before, "
            f"{times[i]:g} s, and is at {times[i + 1]:g} s"
        )
    if times[0] < 0:
        raise ScenarioError(f"{table.origin}: must begin at a time >= 0 (s)")
    kept = np.append(True, ~is_same)
    if kept.sum() < 2:
        raise ScenarioError(f"{table.origin}: must have rows at different times")
    remarks: tuple[str, ...] = ()
    num_missing = int((~has_values).sum())
    if num_missing:
        remarks = (f"{num_missing} rows without values left out",)
    return times[kept], complete[kept], remarks


def _Differentiated(
    times: Array, positions: Array, columns: MotionColumns, source: TableSource
) -> tuple[EvenRows, str]:
    """Returns the velocities of positions, and how they were computed."""
    if len(columns.axes) > 3:
        raise ScenarioError(
            f"{source.origin}: must have velocities for {len(columns.axes)} axes: the "
            "derivative of a rotation is no angular velocity"
        )
    even = MakeEven(times, positions, most_uneven=0)
    assert even.period is not None
    # A shorter last distance is left out: the samples have one distance.
    count = len(even.times)
    if count > 2 and even.times[-1] - even.times[-2] < 0.9 * even.period:
        count -= 1
    values = even.values[:count]
    most = 1 / even.period / SAMPLES_PER_CYCLE
    bandwidth = source.options.get("bandwidth")
    if bandwidth is None:
        bandwidth = min(_BANDWIDTH, most)
    CheckNumber(f"{source.path}.bandwidth", bandwidth, "Hz", maximum=most)
    velocities = smoothed_derivative(values, even.period, float(bandwidth))
    # A run integrates straight lines between the rows.
    ways = np.cumsum((velocities[1:] + velocities[:-1]) / 2 * even.period, axis=0)
    error = float(np.abs(ways - (values[1:] - values[0])).max())
    remark = (
        f"position in {', '.join(map(Show, columns.axes))} differentiated with a "
        f"bandwidth of {bandwidth:.3g} Hz, its integral within {error:.2g} m"
    )
    rows = EvenRows(even.times[:count], velocities, even.period, even.remark)
    return rows, remark


def _Assumed(table: Table, columns: MotionColumns, read: Times) -> tuple[str, ...]:
    """Returns which units are those of SI because the file names none."""
    units = []
    if read.unit is None:
        units.append("s")
    if any(not table.UnitOf(name) for name in columns.axes):
        units.append("m/s" if columns.quantity == "velocity" else "m")
    return (f"taken in {' and '.join(units)} (no unit named)",) if units else ()
