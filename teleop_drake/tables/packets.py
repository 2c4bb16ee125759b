"""Reads measured packets: when each was sent, and how long it took."""

from teleop_drake.tables.json_reports import PacketsOfReport
from teleop_drake.tables.measured import Packets as Packets
from teleop_drake.tables.packet_table import ROLES, PacketsOfTable
from teleop_drake.tables.ping import IsPing, PacketsOfPing
from teleop_drake.tables.reader import (
    IsBinary,
    OfRecords,
    OfText,
    ParseJson,
    ReadAnyText,
    ReadTable,
)
from teleop_drake.tables.source import TableSource
from teleop_drake.tables.table import Table
from teleop_drake.validation import ScenarioError


def ReadPackets(path: str, given: object) -> Packets:
    """Reads measured packets from a file.

    The file is a table (see reader), the output of `ping` (see ping), or JSON of a tool
    that measures networks (see json_reports).

    Args:
        path: The field that names the file, for messages.
        given: The path of the file, or a mapping {file, columns: {role: column},
            units: {role: unit}, interval: s}; roles are packet_table.ROLES.

    Raises:
        ScenarioError: If the file cannot be read, or leaves anything unclear.
    """
    source = TableSource.Of(path, given, ROLES, ("interval",))
    packets = _Read(source)
    if len(packets.times) < 2:
        raise ScenarioError(
            f"{source.origin}: must have two packets, and has {len(packets.times)}"
        )
    if packets.times[-1] == 0:
        raise ScenarioError(
            f"{source.origin}: must have packets that were sent at different times"
        )
    return packets


def _Read(source: TableSource) -> Packets:
    origin = source.origin
    if IsBinary(source.file):
        return _OfTable(ReadTable(source.path, source.file), source)
    text = ReadAnyText(source.file, origin)
    contents = ParseJson(text)
    if contents is not None:
        packets = PacketsOfReport(contents, origin)
        if packets is None:
            return _OfTable(OfRecords(contents, origin), source)
        source.RefuseKeys("where a tool's JSON is read", "columns", "units", "interval")
        return packets
    if IsPing(text):
        source.RefuseKeys("where the output of ping is read", "columns", "units")
        return PacketsOfPing(text, source)
    return _OfTable(OfText(text, origin), source)


def _OfTable(table: Table, source: TableSource) -> Packets:
    source.RefuseKeys("where a table is read, which has a column of times", "interval")
    return PacketsOfTable(table, source)
