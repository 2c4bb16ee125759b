"""How a block diagram shows the delay margin of each connection.

Colours are those of M. Okabe and K. Ito, "Color universal design" (2008), which
colour-blind people can tell apart. The width of a line tells its class in print.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from pydrake.systems.framework import Context, Diagram, System

from teleop_drake.loops.framework.signals import PathsIn
from teleop_drake.loops.framework.validation import Refuse


class _Class(NamedTuple):
    """A class of margins.

    Attributes:
        limit: The largest margin as a multiple of the smallest one.
        color: The colour of its connections.
        width: Their width in points.
        name: Its name in the legend; {limit} stands for the limit.
    """

    limit: float
    color: str
    width: float
    name: str


_CLASSES = (
    _Class(2.0, "#D55E00", 3.6, "up to {limit}"),
    _Class(10.0, "#E69F00", 2.6, "up to {limit}"),
    _Class(math.inf, "#0072B2", 1.7, "longer"),
)
_ANY_DELAY = _Class(math.inf, "#999999", 0.7, "any delay")


class DelayWires:
    """The looks of the connections of a diagram, by their delay margins.

    Args:
        system: The diagram.
        margins: The margins in s, keyed by input ports as those of DelayMargins().
        shown: The diagrams whose connections are drawn.
    """

    def __init__(
        self, system: System, margins: Mapping[str, float], shown: Sequence[Diagram]
    ):
        self._paths = dict(PathsIn(system))
        self._margins = margins
        inputs = [
            self.Into(part, i)
            for diagram in shown
            for part in diagram.GetSystems()
            for i in range(part.num_input_ports())
        ]
        finite = [x for x in inputs if x is not None and 0 < x < math.inf]
        self._least = min(finite, default=0.0)
        self._is_unstable = bool(margins) and not any(margins.values())

    def Into(self, system: System, index: int) -> float | None:
        """Returns the margin of the connection to an input of a system, if known."""
        name = system.get_input_port(index).get_name()
        return self._margins.get(f"{self._paths[system]}.{name}")

    def Look(self, margins: Collection[float | None]) -> str:
        """Returns the DOT attributes of a line, that of the smallest of its margins."""
        known = [x for x in margins if x is not None]
        if not known or self._is_unstable:
            return "color=grey40"
        margin = min(known)
        own = _ANY_DELAY
        if margin < math.inf:
            own = next(x for x in _CLASSES if margin <= x.limit * self._least)
        return f'color="{own.color}", penwidth={own.width}'

    def Label(self, margin: float | None) -> str:
        """Returns the DOT attributes of a line's label; empty: no label."""
        if margin is None or margin == math.inf or self._is_unstable:
            return ""
        return f'label="{MarginText(margin)}", fontsize=11, fontcolor=black'

    def Legend(self) -> str:
        """Returns the DOT attributes of a graph with a legend below it."""
        if self._is_unstable:
            text = "unstable already: no signal may come later"
            return f'label="{text}", labelloc=b, labeljust=l, fontsize=14'
        cells = ["<TD>how much later each signal alone may come:</TD>"]
        for own in (*_CLASSES, _ANY_DELAY):
            limit = MarginText(own.limit * self._least)
            cells.append(_Sample(own) + f"<TD>{own.name.format(limit=limit)}</TD>")
        table = f'<TABLE BORDER="0" CELLSPACING="4"><TR>{"".join(cells)}</TR></TABLE>'
        return f"label=<{table}>, labelloc=b, labeljust=l, fontsize=14"


def _Sample(own: _Class) -> str:
    """Returns a cell of a DOT table with a line of a class."""
    size = f'WIDTH="30" HEIGHT="{math.ceil(own.width)}" FIXEDSIZE="TRUE"'
    line = f'BGCOLOR="{own.color}" {size} BORDER="0" CELLPADDING="0" CELLSPACING="0"'
    return f'<TD><TABLE {line}><TR><TD BORDER="0"></TD></TR></TABLE></TD>'


def MarginText(margin: float) -> str:
    """Returns a margin with three digits and its unit."""
    if margin >= 0.9995 or margin == 0:
        return f"{margin:.3g} s"
    if margin >= 0.9995e-3:
        return f"{1e3 * margin:.3g} ms"
    return f"{1e6 * margin:.3g} µs"


def MarginsOf(
    system: System,
    context: Context | None,
    delay_margins: bool | Mapping[str, float],
) -> Mapping[str, float] | None:
    """Returns the delay margins that a picture of a system shows, if any."""
    if delay_margins is not True:
        if context is not None:
            Refuse("context", "a Context", "left out without delay_margins=True")
        return None if delay_margins is False else delay_margins
    if not isinstance(system, Diagram):
        Refuse("delay_margins", True, "left out of a system without connections")
    from teleop_drake.loops.linear.delay_map import DelayMargins

    return DelayMargins(system, context or system.CreateDefaultContext())
