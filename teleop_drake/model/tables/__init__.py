"""Tables of measurements as people have them: text, spreadsheets, logs of `ping`.

ReadTable() reads named columns, ReadPackets() the delays of packets. Both say in one
line what was read. What a file does not tell, such as an unknown unit, is asked for in
a ScenarioError and never assumed in silence.
"""

from teleop_drake.model.tables.packets import Packets, ReadPackets
from teleop_drake.model.tables.reader import ReadTable
from teleop_drake.model.tables.source import TableSource
from teleop_drake.model.tables.stamps import Times
from teleop_drake.model.tables.table import Table

__all__ = ["Packets", "ReadPackets", "ReadTable", "Table", "TableSource", "Times"]
