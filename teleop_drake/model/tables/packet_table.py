"""Packets in a table: stamps of sending and of arrival, delays or round trips."""

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Flags, Indices
from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.model.tables.headers import TIME_WORDS, ParseHeader
from teleop_drake.model.tables.losses import AreLost, Unwrapped
from teleop_drake.model.tables.measured import (
    BETWEEN_STAMPS,
    HALVED,
    ONE_WAY,
    InOrder,
    Packets,
)
from teleop_drake.model.tables.source import TableSource
from teleop_drake.model.tables.stamps import (
    DAY,
    LENGTH_OF_DAY,
    IsTimeUnit,
    ReadTimes,
    RefuseCell,
)
from teleop_drake.model.tables.table import Table

# What names of columns mean, in the order in which they are tried: a `round_trip_time`
# is no time of sending. The names are those of ParseHeader().
_MEANINGS = {
    "rtt": r"(.+_)?(rtt|round_?trips?)(_.+)?",
    "delay": r"(.+_)?(delay|owd|one_way)(_time)?|(one_way_|network_)latency",
    "lost": r"(is_|was_)?(lost|dropped|loss)",
    "arrived": r"(is_|was_)?(ok|success|successful|succeeded|answered|delivered)"
    r"|status|result",
    "number": r"((icmp_)?seq(uence)?|packet)(_?(no|nr|num|number|id))?",
    "received": rf"((t|time|timestamp|stamp)_)?(received?|recv|rx|arrival|arrived)"
    rf"(_(at|{TIME_WORDS}))?",
    "time": rf"(.+_)?({TIME_WORDS})"
    rf"|(({TIME_WORDS})_)?(sent|send|tx)(_(at|{TIME_WORDS}))?",
}
ROLES = ("time", *(role for role in _MEANINGS if role != "time"))
"""The roles of columns that a user may name."""

# Quantities of many packets, which are asked for.
_STATISTIC = (
    r"(.+_)?(min|max|avg|mean|median|std|stddev|sd|dev|mdev|deviation|var|variance|"
    r"jitter|p\d+|percentile|count|minimum|maximum|average)(_.+)?"
)

# Marks of packets, in the columns of the roles `lost` and `arrived`.
_YES = ("true", "1", "1.0", "yes", "t", "y")
_NO = ("false", "0", "0.0", "no", "f", "n")
_WELL = ("ok", "success", "successful", "received", "reply", "answered", "delivered")

# Packet numbers without a packet are lost; with more than this, they are no numbers.
_MOST_GAPS = 100
# So few packets may be all that arrived of a longer count.
_FEW = 5

# Names that mean one way to some and there and back to others.
_UNCLEAR = r"(.+_)?(latency|ping|lag|response(_time)?|value)(_.+)?"


def PacketsOfTable(table: Table, source: TableSource) -> Packets:
    """Returns the packets of a table.

    Raises:
        ScenarioError: If the columns or their units are not clear, or a cell is not
            allowed.
    """
    roles = _Roles(table, source.columns)
    if "time" not in roles:
        _AskForColumns(table, "the time when a packet was sent", roles)
    unit = source.units.get("time") or table.UnitOf(roles["time"])
    if unit and not IsTimeUnit(unit):
        _AskForUnit(table, roles["time"], "time", source)
    sent = table.Times(roles["time"], unit)
    if sent.unit is None:
        _AskForUnit(table, roles["time"], "time", source)
    times = sent.since_first
    remarks: tuple[str, ...] = ()
    if "delay" in roles:
        delays = _Delays(table, roles["delay"], "delay", source)
        kind = ONE_WAY
        arrivals = times + delays
    elif "received" in roles:
        delays = _BetweenStamps(table, roles, source)
        kind = BETWEEN_STAMPS
        arrivals = times + delays
    elif "rtt" in roles:
        round_trips = _Delays(table, roles["rtt"], "rtt", source)
        delays = round_trips / 2
        kind = HALVED
        arrivals = times + round_trips
    else:
        _AskForColumns(table, "a delay (delay, rtt or received)", roles)
    for role in ("lost", "arrived"):
        if role in roles:
            delays = np.where(_AreLost(table, role, roles[role]), np.nan, delays)
    is_negative = delays < 0
    for i in np.flatnonzero(is_negative)[:1]:
        reason = "; the clocks of sender and receiver differ" if kind != HALVED else ""
        raise ScenarioError(
            f"{table.origin}: line {table.lines[i]}: must be a delay >= 0, not "
            f"{delays[i]:g} s{reason}"
        )
    order = InOrder(times, delays, arrivals, table.origin, table.lines)
    times = times[order]
    delays = delays[order]
    if "number" in roles:
        numbers = table.Values(roles["number"])[order]
        times, delays, remarks = _WithGaps(times, delays, numbers, table)
    return Packets(
        times=times - times[0],
        delays=delays,
        kind=kind,
        clock=sent.clock,
        remarks=remarks,
    )


def _Roles(table: Table, given: Mapping[str, Any]) -> dict[str, str]:
    """Returns the column of each role: those that a user names, else those found."""
    roles = {role: table.Find(column) for role, column in given.items()}
    found: dict[str, list[str]] = {}
    has_delay = {"delay", "rtt", "received"} & set(given)
    for name in table.names:
        role = _Meant(table, name)
        if role:
            found.setdefault(role, []).append(name)
    for role, names in found.items():
        is_another_delay = role in ("delay", "rtt", "received") and has_delay
        if role in roles or is_another_delay:
            continue
        if len(names) > 1 and not (role == "rtt" and "delay" in found):
            raise ScenarioError(
                f"{table.origin}: columns {', '.join(map(Show, names))}: must be one "
                f"for {role}; {_Line({**roles, role: names[0]})}"
            )
        roles[role] = names[0]
    return roles


def _Meant(table: Table, name: str) -> str:
    """Returns the role that a column's name means; empty: none."""
    key = ParseHeader(name).key
    found = (role for role, form in _MEANINGS.items() if re.fullmatch(form, key))
    role = next(found, "")
    if role in ("rtt", "delay") and re.fullmatch(_STATISTIC, key):
        return ""
    if role in ("received", "arrived") and not table.UnitOf(name):
        texts = _Marks(table, name)
        if (np.isin(texts, (*_YES, *_NO, *_WELL)) | AreLost(texts)).all():
            return "arrived"
    # The status of a line may be anything.
    return "" if role == "arrived" else role


def _Line(
    roles: Mapping[str, Any],
    units: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Returns the line of a scenario that would read a file with these columns."""
    text = "{file: ..."
    if roles:
        columns = ", ".join(f"{role}: {Show(name)}" for role, name in roles.items())
        text += f", columns: {{{columns}}}"
    if units:
        named = ", ".join(f"{role}: {unit}" for role, unit in units.items())
        text += f", units: {{{named}}}"
    return f"write {text}}}"


def _AskForColumns(table: Table, what: str, roles: Mapping[str, str]) -> NoReturn:
    """Refuses a table without a column; the message has the line that names it."""
    names = [x for x in table.names if x not in roles.values()]
    unclear = [x for x in names if re.fullmatch(_UNCLEAR, ParseHeader(x).key)]
    shown = ", ".join(map(Show, table.names))
    if not table.has_header:
        shown += " (no header)"
    line = {"time": roles.get("time") or table.names[0]}
    rest = [x for x in table.names if x != line["time"]]
    delay = (unclear or rest or ["..."])[0]
    hint = ""
    if unclear:
        hint = f"; {Show(delay)} may be one way or there and back"
    either = _Line({**line, "rtt": delay}, _UnknownUnits(table, line["time"], delay))
    raise ScenarioError(
        f"{table.origin}: columns {shown}: must have {what}{hint}; {either}, or with "
        "delay for rtt if it is one way"
    )


def _UnknownUnits(table: Table, time: str, delay: str) -> dict[str, str]:
    units = {}
    if time in table.names and not table.UnitOf(time):
        units["time"] = "s"
    if delay in table.names and not table.UnitOf(delay):
        units["rtt"] = "ms"
    return units


def _AskForUnit(table: Table, column: str, role: str, source: TableSource) -> NoReturn:
    """Refuses a column whose unit is not known; the message has the line that tells."""
    unit = table.UnitOf(column)
    has = f"a unit of time, not {unit!r}" if unit else "a unit"
    units = {**source.units, role: "s" if role == "time" else "ms"}
    raise ScenarioError(
        f"{table.origin}: columns {', '.join(map(Show, table.names))}: {Show(column)} "
        f"must have {has}; {_Line(source.columns, units)}, with s, ms, us or ns"
    )


def _Delays(table: Table, column: str, role: str, source: TableSource) -> Array:
    """Returns the delays of a column, s; NaN: lost."""
    unit = source.units.get(role) or table.UnitOf(column)
    if not IsTimeUnit(unit):
        _AskForUnit(table, column, role, source)
    return table.Values(column, unit, minus_one_is_lost=True)


def _BetweenStamps(
    table: Table, roles: Mapping[str, str], source: TableSource
) -> Array:
    """Returns the times from sending to arrival, s; NaN: not received."""
    import pandas

    columns = [roles["time"], roles["received"]]
    units = {source.units.get("time") or table.UnitOf(columns[0])}
    units.add(source.units.get("received") or table.UnitOf(columns[1]))
    if len(units) > 1:
        raise ScenarioError(
            f"{table.origin}: columns {', '.join(map(Show, columns))}: must have one "
            f"unit, not {' and '.join(map(Show, sorted(units)))}"
        )
    sent, received = (table.frame[column] for column in columns)
    is_lost = AreLost(received.astype(str))
    numbers = pandas.to_numeric(received, errors="coerce")
    is_lost |= numbers.to_numpy(dtype=float, na_value=np.nan) == -1
    both = pandas.concat([sent, received[~is_lost]], ignore_index=True)
    lines = np.concatenate([table.lines, table.lines[~is_lost]])
    place = f"{table.origin}: columns {', '.join(map(Show, columns))}"
    read = ReadTimes(both, units.pop(), place, lines)
    seconds = read.seconds
    delays = np.full(len(sent), np.nan)
    delays[~is_lost] = seconds[len(sent) :] - seconds[: len(sent)][~is_lost]
    if read.clock == DAY:  # One of both may be behind midnight.
        delays = (delays + LENGTH_OF_DAY / 2) % LENGTH_OF_DAY - LENGTH_OF_DAY / 2
    return delays


def _Marks(table: Table, column: str) -> Array:
    return np.array([x.strip().lower() for x in table.Texts(column)])


def _AreLost(table: Table, role: str, column: str) -> Flags:
    """Returns whether each packet is marked as lost, or is not as arrived."""
    texts = _Marks(table, column)
    if role == "lost":
        is_lost = np.isin(texts, (*_YES, "lost"))
        is_known = is_lost | np.isin(texts, (*_NO, "", "ok", "nan"))
    else:
        is_lost = np.isin(texts, _NO) | AreLost(texts)
        is_known = is_lost | np.isin(texts, (*_YES, *_WELL))
    cells = table.frame[column]
    RefuseCell(table.Place(column), table.lines, cells, ~is_known, "true or false")
    return is_lost


def _CheckCount(steps: Indices, is_copy: Flags, table: Table) -> None:
    """Refuses numbers that count by more than 1, or that begin anew.

    Args:
        steps: The differences of the numbers.
        is_copy: Whether the number of a row was there before, in the rows' order (N).
        table: The table, for messages.
    """
    if len(steps) > _FEW and steps.min() > 1:
        raise ScenarioError(
            f"{table.origin}: packet numbers: must count by 1, not by {steps.min()} or "
            "more"
        )
    # The network copies single packets; where numbers begin anew, all are there.
    if len(is_copy) > _FEW and (is_copy[2:] & is_copy[1:-1] & is_copy[:-2]).any():
        raise ScenarioError(
            f"{table.origin}: packet numbers: must count on, and begin anew; split the "
            "file there"
        )


def _WithGaps(
    times: Array, delays: Array, numbers: Array, table: Table
) -> tuple[Array, Array, tuple[str, ...]]:
    """Returns times and delays with a lost packet for each number that is missing."""
    if not ((numbers == np.round(numbers)) & (np.abs(numbers) < 2.0**53)).all():
        raise ScenarioError(f"{table.origin}: packet numbers: must be whole numbers")
    counted, rows = np.unique(Unwrapped(numbers), return_index=True)
    all_numbers = np.arange(counted[0], counted[-1] + 1)
    if len(all_numbers) > _MOST_GAPS * len(counted):
        raise ScenarioError(
            f"{table.origin}: packet numbers: must have fewer gaps; {len(counted)} of "
            f"{len(all_numbers)} are there"
        )
    copies = len(numbers) - len(counted)
    is_copy = np.ones(len(numbers), bool)
    is_copy[rows] = False
    _CheckCount(np.diff(counted), is_copy, table)
    all_delays = np.full(len(all_numbers), np.nan)
    all_delays[counted - counted[0]] = delays[rows]
    all_times = np.interp(all_numbers, counted, times[rows])
    if (np.diff(all_times) < 0).any():
        raise ScenarioError(f"{table.origin}: packet numbers: must ascend with time")
    remarks = (f"{copies} duplicates left out",) if copies else ()
    return all_times, all_delays, remarks
