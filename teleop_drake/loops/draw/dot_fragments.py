"""Drake's DOT text of a system, with readable names and a box for every system."""

import html
import itertools
import re
from collections.abc import Sequence
from typing import NamedTuple

from pydrake.systems.framework import Diagram, System

from teleop_drake.loops.framework.signals import ClassOf, NameOf, Visible
from teleop_drake.loops.framework.wiring import InputPorts, OutputPorts

NUMBERED = re.compile(r"(^subgraph clusters?|^s|-> s|drakelcminterface)(\d+)", re.M)
"""Names with the process-wide number of a system or, for LCM, an address."""

# The text with which Drake begins the parts of a diagram.
_PARTS = 'color=white\nlabel=""\n'
# The class of a system that is written in Python, with its module.
_PYTHON_CLASS = re.compile(r"^<B>[^<]*\.(\w+)</B>", re.M)

# The numbers of boxes of our own; a 0 precedes them, so that none of Drake's is equal.
_own_numbers = itertools.count()


class Fragment(NamedTuple):
    """The DOT text of a system in which systems have Drake's numbers.

    Attributes:
        system: The system.
        text: Its box or, for a diagram that is opened, its frame without the parts.
        number: The system's number in the text.
        inputs: The names of its input ports in DOT.
        outputs: The names of its output ports in DOT.
        parts: The systems in the frame.
    """

    system: System
    text: str
    number: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    parts: Sequence[System]


def FragmentOf(system: System, *, is_open: bool) -> Fragment:
    """Returns Drake's DOT text of a system; of a diagram that is opened, its frame."""
    drake = system.GetGraphvizFragment(max_depth=int(is_open))
    inputs = InputPorts(system)
    outputs = OutputPorts(system)
    text = "".join(drake.fragments)
    # A name may consist of several lines, which Drake writes as they are.
    for named in (system, *inputs, *outputs):
        name = html.escape(named.get_name(), quote=False)
        text = text.replace(name, Visible(name)) if Visible(name) != name else text
    text = "\n".join(map(Visible, text.split("\n")))
    head, begin, _ = text.partition(_PARTS)
    text = _PYTHON_CLASS.sub(r"<B>\1</B>", head + begin).rstrip()
    found = NUMBERED.search(text)
    ports = drake.input_ports, drake.output_ports
    if found is None or (len(ports[0]), len(ports[1])) != (len(inputs), len(outputs)):
        return _OwnFragment(system)
    parts = system.GetSystems() if isinstance(system, Diagram) and is_open else []
    return Fragment(system, text, found[2], *ports, parts)


def _OwnFragment(system: System) -> Fragment:
    """Returns a box for a system for which Drake has no box that shows its ports.

    An example is the SharedPointerSystem of AddDefaultVisualization().
    """
    number = f"0{next(_own_numbers)}"
    sides = (("u", InputPorts(system)), ("y", OutputPorts(system)))
    columns = [
        [
            f'PORT="{side}{i}" BORDER="1">{html.escape(Visible(port.get_name()))}</TD>'
            for i, port in enumerate(ports)
        ]
        for side, ports in sides
    ]
    heading = f"<B>{html.escape(ClassOf(system))}</B>"
    name = Visible(system.get_name())
    if NameOf(system) == name:
        heading += f"<BR/>\nname={html.escape(name)}"
    lines = (
        f"s{number} [shape=none, border=0, label=<",
        '<TABLE BORDER="0" CELLSPACING="0">',
        f'<TR><TD BORDER="1" COLSPAN="2">\n{heading}\n</TD></TR>',
        *Rows(columns),
        "</TABLE>\n>];",
    )
    inputs, outputs = (
        [f"s{number}:{side}{i}" for i, _ in enumerate(ports)] for side, ports in sides
    )
    return Fragment(system, "\n".join(lines), number, inputs, outputs, [])


def Rows(columns: Sequence[list[str]]) -> list[str]:
    """Returns the lines of the rows of a table with two columns of cells.

    On the side with fewer cells, the last one spans the remaining rows.
    """
    height = max(map(len, columns))
    for cells in filter(None, columns):
        cells[-1] = f'ROWSPAN="{height - len(cells) + 1}" {cells[-1]}'
    rows = []
    for row in itertools.zip_longest(*columns):
        rows += ["<TR>", *(f"<TD {cell}" for cell in row if cell), "</TR>"]
    return rows
