"""The columns of a recorded motion: which are velocities, and which positions."""

import re
from collections.abc import Sequence
from typing import NamedTuple, NoReturn

from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.model.tables.headers import UNITS, IsTime, ParseHeader
from teleop_drake.model.tables.source import TableSource
from teleop_drake.model.tables.table import Table

ROLES = ("time", "velocity", "position")
"""The roles of columns that a user may name; all but `time` are lists, one an axis."""

QUANTITIES = {"velocity": ("speed", "turning speed"), "position": ("length", "angle")}
"""The quantities that a motion may be given as, with those of their units."""

# Keys of ParseHeader(). Velocities are tried first: `linear_x` is one.
_NAMES = {
    "velocity": r"(.+_)?(v|vel|velocity|velocities|speed|qd|qvel)(_?(d|x|y|z|\d+))*"
    r"|(.+_)?(linear|angular)(_velocity)?_(x|y|z)",
    "position": r"(.+_)?(p|pos|position|positions|qpos|x|y|z)(_?(x|y|z|\d+))*",
}
_ANGULAR = r"(.+_)?(angular|w|omega|orientation|rotation)(_.+)?"


class MotionColumns(NamedTuple):
    """The columns of a motion.

    Attributes:
        time: The column of the times.
        axes: The column of each axis.
        quantity: `velocity` or `position`.
        remarks: What was left out or taken, in words.
    """

    time: str
    axes: list[str]
    quantity: str
    remarks: tuple[str, ...]


def FindColumns(table: Table, source: TableSource, num_axes: int) -> MotionColumns:
    """Returns the columns of a motion with n axes.

    Raises:
        ScenarioError: If they are not clear; the message has the line that names them.
    """
    if not table.has_header and not source.columns:
        return _WithoutHeader(table, source, num_axes)
    time = _FindTime(table, source)
    others = [name for name in table.names if name != time]
    for quantity in QUANTITIES:
        if quantity in source.columns:
            given = source.columns[quantity]
            named = given if isinstance(given, list) else [given]
            axes = [table.Find(name) for name in named]
            _CheckCount(table, time, axes, quantity, num_axes)
            return MotionColumns(time, axes, quantity, ())
    found: dict[str, list[str]] = {quantity: [] for quantity in QUANTITIES}
    for name in others:
        meant = _Meant(table, name)
        if meant:
            found[meant].append(name)
    quantity = source.options.get("quantity") or next(filter(found.get, found), "")
    axes = found.get(quantity, [])
    if not axes and quantity and len(others) == num_axes:
        axes = others
    if not axes:
        _Ask(table, time, others[:num_axes], "a velocity or a position", num_axes)
    remarks: tuple[str, ...] = ()
    linear = [x for x in axes if not re.fullmatch(_ANGULAR, ParseHeader(x).key)]
    if len(axes) > num_axes and len(linear) == num_axes:
        remarks = ("angular columns left out",)
        axes = linear
    _CheckCount(table, time, axes, quantity, num_axes)
    return MotionColumns(time, axes, quantity, remarks)


def _WithoutHeader(table: Table, source: TableSource, num_axes: int) -> MotionColumns:
    """Returns the columns of a file without header: time, then one for each axis."""
    time, *axes = table.names
    quantity = source.options.get("quantity") or "velocity"
    _CheckCount(table, time, axes, quantity, num_axes)
    return MotionColumns(time, axes, quantity, ("no header",))


def _FindTime(table: Table, source: TableSource) -> str:
    if "time" in source.columns:
        return table.Find(source.columns["time"])
    times = [name for name in table.names if IsTime(ParseHeader(name).key)]
    if len(times) == 1:
        return times[0]
    shown = ", ".join(map(Show, table.names))
    what = "one of these as its time" if times else "a time"
    raise ScenarioError(
        f"{table.origin}: columns {shown}: must have {what}; write {{file: ..., "
        f"columns: {{time: {Show((times or table.names)[0])}}}}}"
    )


def _Meant(table: Table, name: str) -> str:
    """Returns what a column's unit or name means: velocity, position or nothing."""
    unit = table.UnitOf(name)
    if unit in UNITS:
        quantity = UNITS[unit].quantity
        return next((x for x, units in QUANTITIES.items() if quantity in units), "")
    key = ParseHeader(name).key
    return next((x for x, form in _NAMES.items() if re.fullmatch(form, key)), "")


def _CheckCount(
    table: Table, time: str, axes: Sequence[str], quantity: str, num_axes: int
) -> None:
    if len(axes) != num_axes:
        _Ask(
            table,
            time,
            axes,
            f"{num_axes} columns of {quantity}, one an axis, not {len(axes)}",
            num_axes,
            quantity,
        )


def _Ask(
    table: Table,
    time: str,
    axes: Sequence[str],
    what: str,
    num_axes: int,
    quantity: str = "velocity",
) -> NoReturn:
    shown = ", ".join(map(Show, table.names))
    named = ", ".join(map(Show, axes[:num_axes])) or "..."
    raise ScenarioError(
        f"{table.origin}: columns {shown}: must have {what}; write {{file: ..., "
        f"columns: {{time: {Show(time)}, {quantity}: [{named}]}}}}"
    )
