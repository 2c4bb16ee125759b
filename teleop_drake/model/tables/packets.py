"""Reads measured packets: when each was sent, and how long it took."""

from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.model.kinds import FileOf
from teleop_drake.model.tables.histogram import Histogram, HistogramOf
from teleop_drake.model.tables.json_reports import PacketsOfReport
from teleop_drake.model.tables.measured import Packets as Packets
from teleop_drake.model.tables.packet_table import ROLES, PacketsOfTable
from teleop_drake.model.tables.ping import IsPing, PacketsOfPing
from teleop_drake.model.tables.reader import (
    IsBinary,
    OfRecords,
    OfText,
    ParseJson,
    ReadAnyText,
    ReadTable,
)
from teleop_drake.model.tables.source import TableSource
from teleop_drake.model.tables.table import Table


def ReadPackets(path: str, given: object) -> Packets:
    """Reads measured packets from a file.

    The arguments and errors are those of ReadMeasured(). A histogram is refused, which
    has no packets.
    """
    found = ReadMeasured(path, given)
    if isinstance(found, Histogram):
        raise ScenarioError(
            f"{path} = {Show(FileOf(given))}: must have a column of times; it is a "
            "histogram, from which only a channel of kind network draws delays"
        )
    return found


def ReadMeasured(path: str, given: object) -> Packets | Histogram:
    """Reads measured packets, or a histogram of their delays, from a file.

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
    if isinstance(packets, Histogram):
        return packets
    if len(packets.times) < 2:
        raise ScenarioError(
            f"{source.origin}: must have two packets, and has {len(packets.times)}"
        )
    if packets.times[-1] == 0:
        raise ScenarioError(
            f"{source.origin}: must have packets that were sent at different times"
        )
    return packets


def _Read(source: TableSource) -> Packets | Histogram:
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


def _OfTable(table: Table, source: TableSource) -> Packets | Histogram:
    source.RefuseKeys("where a table is read, which has a column of times", "interval")
    return HistogramOf(table, source) or PacketsOfTable(table, source)
