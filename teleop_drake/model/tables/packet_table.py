"""Packets in a table: stamps of sending and of arrival, delays or round trips."""

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Flags
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
from teleop_drake.model.tables.stamps import CheckTimeUnit, ReadTimes, RefuseCell
from teleop_drake.model.tables.table import Table

# What names of columns mean, in the order in which they are tried: a `round_trip_time`
# is no time of sending. The names are those of ParseHeader().
_MEANINGS = {
    "rtt": r"(.+_)?(rtt|round_?trips?)(_.+)?",
    "delay": r"(.+_)?(delay|owd|one_way)(_time)?|(one_way_|network_)latency",
    "lost": r"(is_|was_)?(lost|dropped|loss)",
    "number": r"((icmp_)?seq(uence)?|packet)(_?(no|nr|num|number|id))?",
    "received": rf"((t|time|timestamp|stamp)_)?(received?|recv|rx|arrival|arrived)"
    rf"(_(at|{TIME_WORDS}))?",
    "time": rf"(.+_)?({TIME_WORDS})"
    rf"|(({TIME_WORDS})_)?(sent|send|tx)(_(at|{TIME_WORDS}))?",
}
ROLES = ("time", *(role for role in _MEANINGS if role != "time"))
"""The roles of columns that a user may name."""

# Packet numbers without a packet are lost; with more than this, they are no numbers.
_MOST_GAPS = 100

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
    sent = table.Times(roles["time"], source.units.get("time"))
    if sent.unit is None:
        _AskForUnit(table, roles["time"], "time")
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
    if "lost" in roles:
        delays = np.where(_Flags(table, roles["lost"]), np.nan, delays)
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
        key = ParseHeader(name).key
        for role, form in _MEANINGS.items():
            if re.fullmatch(form, key):
                found.setdefault(role, []).append(name)
                break
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


def _Line(
    roles: Mapping[str, str],
    units: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Returns the line of a scenario that would read a file with these columns."""
    columns = ", ".join(f"{role}: {Show(name)}" for role, name in roles.items())
    text = f"{{file: ..., columns: {{{columns}}}"
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


def _AskForUnit(table: Table, column: str, role: str) -> NoReturn:
    raise ScenarioError(
        f"{table.origin}: column {Show(column)}: must have a unit, in its header or as "
        f"units: {{{role}: s}} (s, ms, us or ns)"
    )


def _Delays(table: Table, column: str, role: str, source: TableSource) -> Array:
    """Returns the delays of a column, s; NaN: lost."""
    unit = source.units.get(role) or table.UnitOf(column)
    if not unit:
        _AskForUnit(table, column, role)
    where = f", in its header or as units: {{{role}: ms}}"
    CheckTimeUnit(table.Place(column), unit, where)
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
    is_lost = AreLost(received.astype(str)) | (received.astype(str) == "NaT").to_numpy()
    both = pandas.concat([sent, received[~is_lost]], ignore_index=True)
    lines = np.concatenate([table.lines, table.lines[~is_lost]])
    place = f"{table.origin}: columns {', '.join(map(Show, columns))}"
    seconds = ReadTimes(both, units.pop(), place, lines).seconds
    delays = np.full(len(sent), np.nan)
    delays[~is_lost] = seconds[len(sent) :] - seconds[: len(sent)][~is_lost]
    return delays


def _Flags(table: Table, column: str) -> Flags:
    """Returns whether each packet is marked as lost."""
    texts = table.frame[column].astype(str).str.strip().str.lower()
    is_true = np.isin(texts, ("true", "1", "1.0", "yes", "lost", "t", "y"))
    is_false = np.isin(texts, ("false", "0", "0.0", "no", "", "ok", "f", "n", "nan"))
    is_bad = ~(is_true | is_false)
    RefuseCell(table.Place(column), table.lines, texts, is_bad, "true or false")
    return is_true


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
    all_delays = np.full(len(all_numbers), np.nan)
    all_delays[counted - counted[0]] = delays[rows]
    all_times = np.interp(all_numbers, counted, times[rows])
    if (np.diff(all_times) < 0).any():
        raise ScenarioError(f"{table.origin}: packet numbers: must ascend with time")
    remarks = (f"{copies} duplicates left out",) if copies else ()
    return all_times, all_delays, remarks
