"""Block diagrams as pictures: DOT text, SVG, PNG and PDF of any Drake system.

The DOT text is Drake's own (`System.GetGraphvizString`) in a reproducible form and with
a block-diagram layout: signals run from left to right, and a feedback connection runs
back in a lane of its own instead of across the boxes. It needs no Graphviz. The other
formats are laid out by the `dot` on the PATH or, without one, by the program in the
wheel graphviz-pure.
"""

import io
import os
import re
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPortIndex,
    OutputPortIndex,
    System,
)

from teleop_drake.loops.draw.delay_wires import DelayWires, MarginsOf
from teleop_drake.loops.draw.dot_fragments import NUMBERED, Fragment, FragmentOf, Rows
from teleop_drake.loops.draw.spacers import Spacers
from teleop_drake.loops.framework.files import Replacing
from teleop_drake.loops.framework.signals import CheckSystem, PathsIn
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.framework.wiring import InputPorts, OutputPorts

_SUFFIXES = (".svg", ".png", ".pdf", ".dot", ".html")

# Layout of the levels of a picture: below each other in the order of their insertion,
# which dot counts from the bottom, and aligned on the left.
_BELOW_EACH_OTHER = 'graph [pack=18, packmode="array_itc1"]'

# Dots per inch of a PNG, enough for print.
_PNG_DPI = 200

# The fonts of an SVG and their replacement. Without Helvetica, fonts of the same widths
# are preferred, because names in a wider font would stick out of their boxes.
_FONTS = b'font-family="Helvetica,sans-Serif"'
_MORE_FONTS = b'font-family="Helvetica,Arial,Liberation Sans,Arimo,sans-serif"'

# graphviz-pure measures text in Arimo, which has the widths of Helvetica.
_STYLE = """\
graph [fontname="Helvetica", nodesep=0.3, ranksep=0.45]
node [fontname="Helvetica"]
edge [arrowsize=0.8, fontname="Helvetica"]"""

# A box with more ports on a side shows only those that are connected.
_MOST_PORTS = 10

# The lines to a diagram's own output ports, at the far right, cross the picture. They
# are faint, so that the loop itself remains visible.
_EXPORTED_OUTPUT = "color=palegreen3, penwidth=0.7"

# Graphviz 2.43 draws an arrowhead on some lines in spite of dir=none.
_NO_ARROW = "dir=none, arrowsize=0"

# A node that is as large as the pen that draws it.
_FILLED = 'shape=box, label="", fixedsize=true, width=0.001, height=0.001'

# Style of the size of a vector, which is written on its connection.
_WIDTH = "fontsize=10, fontcolor=grey40, labeldistance=1.2, labelangle=30"

# Dot's frame of a diagram fits the boxes only; the margin is for lines around them.
_FRAME = "margin=40"

_CELL = re.compile(r'^<TD PORT="([uy]\d+)"[^>]*>(.+)</TD>$', re.M)


def DiagramDot(
    system: System,
    *,
    max_depth: int | None = None,
    delay_margins: Mapping[str, float] | None = None,
) -> str:
    """Returns the block diagram of a system as DOT text, the same in every process.

    If several levels are opened, each diagram is drawn separately: the whole with its
    parts as closed boxes at the top, and these boxes opened below it.

    Four things differ from Drake's `GetGraphvizString`:

    * The numbers of systems count from 0 in order of appearance, and the connections
      are sorted, so that two builds of one diagram give the same bytes.
    * A system written in Python is labelled with its class name without the module,
      like the systems of Drake.
    * If a box has more than ten ports on a side, its unconnected ports are replaced by
      their number.
    * A connection that closes a loop is drawn around the boxes. The order in which the
      systems were added to the builder determines which connection of the loop it is.

    Args:
        system: Any Drake system; a system without a name is labelled by its class only.
        max_depth: The number of levels of nested diagrams to open: 0 gives a single
            box, 1 shows the system's own parts as boxes, None opens everything.
        delay_margins: The margins of DelayMargins() in s, which the connections show
            by their colour, width and label; None: they show nothing.

    Raises:
        ValueError: If max_depth is negative.
    """
    CheckSystem("system", system)
    # Drake terminates the process if the depth is negative.
    if max_depth is not None and max_depth < 0:
        Refuse("max_depth", max_depth, "null, 0 or positive")
    levels = [
        (path.count("/"), level)
        for level, path in PathsIn(system, "root")
        if isinstance(level, Diagram)
    ]
    levels.sort(key=itemgetter(0))
    # The diagrams to open, the outermost first.
    shown = [level for k, level in levels if max_depth is None or k < max_depth]
    numbers: dict[str, int] = {}
    if not shown:
        box = _Draw(FragmentOf(system, is_open=False), numbers, None)
        return _Graph("_0", [_WithoutIdlePorts(box, set())])
    opened = [FragmentOf(level, is_open=True) for level in shown]
    wires = None
    if delay_margins is not None:
        wires = DelayWires(system, delay_margins, shown)
    drawings = [_Draw(level, numbers, wires).text for level in opened]
    # Attributes at the end of a graph do not apply to the graphs in it.
    legend = [] if wires is None else [f"graph [{wires.Legend()}]"]
    if len(drawings) == 1:
        return _Graph("_0", [*drawings, *legend])
    # Where dot packs graphs, it leaves out the labels of connections.
    arrange = [_BELOW_EACH_OTHER] if wires is None else []
    return _Graph("levels", [*arrange, *reversed(drawings), *legend])


class _Port(NamedTuple):
    """A port in a drawing.

    Attributes:
        system: The number of its system.
        place: Its index among the inputs or the outputs of the system.
        name: Its name in DOT: `s1:u0`, or `s1in:0` for a diagram that is opened.
        size: The size of its vector.
    """

    system: int
    place: int
    name: str
    size: int


class _Edge(NamedTuple):
    """A connection in a diagram.

    Attributes:
        color: Its DOT attributes if it leads to a port of the diagram itself.
        tail: The port from which it leads.
        head: The port to which it leads.
        margin: Its delay margin in s, if known.
    """

    color: str
    tail: _Port
    head: _Port
    margin: float | None = None


@dataclass
class _Drawn:
    """A system as DOT text, a box or a frame with boxes in it, and its ports."""

    text: str
    inputs: Sequence[_Port]
    outputs: Sequence[_Port]


def _Graph(name: str, drawings: Iterable[str]) -> str:
    """Returns the DOT text of a graph with the given systems in it."""
    text = "\n".join([f"digraph {name} {{", "rankdir=LR", _STYLE, *drawings])
    # Drake may draw no box for an LCM interface.
    for node in dict.fromkeys(re.findall(r"drakelcminterface\w+", text)):
        if f"\n{node} [" not in text:
            text += f"\n{node} [label=LCM]"
    return text + "\n}\n"


def _Draw(
    fragment: Fragment, numbers: dict[str, int], wires: DelayWires | None
) -> _Drawn:
    """Returns a system as a box or, if it is opened, a frame with its parts as boxes.

    Args:
        numbers: The reproducible numbers of systems by Drake's; new ones are added.
        wires: The looks of connections by their margins; None: they have no margins.
    """

    def Number(found: re.Match[str]) -> str:
        return f"{found[1]}{numbers.setdefault(found[2], len(numbers))}"

    Numbered = partial(NUMBERED.sub, Number)
    number = numbers.setdefault(fragment.number, len(numbers))

    def Ports(names: Sequence[str], ports: Sequence[Any]) -> list[_Port]:
        return [
            _Port(number, i, Numbered(name), port.size())
            for i, (name, port) in enumerate(zip(names, ports, strict=True))
        ]

    system = fragment.system
    inputs = Ports(fragment.inputs, InputPorts(system))
    outputs = Ports(fragment.outputs, OutputPorts(system))
    # The numbers of the parts precede those of LCM interfaces that are no part.
    parts = [FragmentOf(part, is_open=False) for part in fragment.parts]
    for part in parts:
        numbers.setdefault(part.number, len(numbers))
    drawn = _Drawn(Numbered(fragment.text), inputs, outputs)
    if parts:
        boxes = {part.system.get_name(): _Draw(part, numbers, None) for part in parts}
        edges = _Edges(system, drawn, boxes, wires)
        used = {port.name for edge in edges for port in (edge.tail, edge.head)}
        texts = [_WithoutIdlePorts(box, used) for box in boxes.values()]
        inside = ["", *texts, *_Connections(edges, wires), "}", _FRAME, "}"]
        drawn.text += "\n".join(inside)
    return drawn


def RenderSvg(
    system: System,
    *,
    max_depth: int | None = None,
    delay_margins: Mapping[str, float] | None = None,
) -> str:
    """Returns the block diagram of a system as SVG text.

    Arguments and errors are those of `DiagramDot`. Raises RuntimeError if no program
    can lay the diagram out (see `WriteDiagram`).
    """
    dot = DiagramDot(system, max_depth=max_depth, delay_margins=delay_margins)
    return LayOut(dot, "svg").decode()


def WriteDiagram(
    system: System,
    path: str | os.PathLike[str],
    *,
    max_depth: int | None = None,
    context: Context | None = None,
    delay_margins: bool | Mapping[str, float] = False,
) -> None:
    """Writes the block diagram of a system to a file, in the format of its suffix.

    The diagram is that of `DiagramDot`. The file appears complete or not at all, and
    replaces one of the same name.

    Args:
        path: The file, which ends in .svg, .png (200 dots per inch), .pdf, .dot or
            .html. The latter is a page in which boxes open at a click; max_depth has no
            effect on it.
        max_depth: The number of levels of nested diagrams to open; see `DiagramDot`.
        context: The equilibrium at which the margins are computed; None: the default
            Context.
        delay_margins: Whether each connection shows how much later its signal may come,
            see `DelayMargins`; or these margins, if they have been computed. A page
            shows none.

    Raises:
        ValueError: If the suffix is another one, max_depth is negative, a context or
            margins are given without effect, or as in DelayMargins().
        RuntimeError: If there is neither a `dot` on the PATH nor graphviz-pure, the
            program fails, or a PDF is requested without the extra `pdf`. A .dot file
            needs none of them.
        OSError: If the file cannot be written.
    """
    CheckSystem("system", system)
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        Refuse("path", str(path), f"a file that ends in one of {', '.join(_SUFFIXES)}")
    margins = MarginsOf(system, context, delay_margins)
    if suffix == ".html":
        if margins is not None:
            Refuse("delay_margins", "given", "left out of a page")
        from teleop_drake.loops.page.diagram_page import DiagramPage

        content = DiagramPage(system).html.encode()
    else:
        dot = DiagramDot(system, max_depth=max_depth, delay_margins=margins)
        content = dot.encode()
    if suffix == ".png":
        content = LayOut(dot, "png")
    elif suffix in (".svg", ".pdf"):
        content = LayOut(dot, "svg")
    if suffix == ".pdf":
        content = _SvgToPdf(content)
    with Replacing(path) as temporary:
        temporary.write_bytes(content)


def _WithoutIdlePorts(drawn: _Drawn, used: Container[str]) -> str:
    """Returns the text of a box, without unused ports if a side has many ports."""
    sides = (drawn.inputs, drawn.outputs)
    if max(map(len, sides)) <= _MOST_PORTS:
        return drawn.text
    labels = dict(_CELL.findall(drawn.text))
    columns = []
    for side in sides:
        shown = [x.name.split(":")[1] for x in side if x.name in used]
        cells = [f'PORT="{port}" BORDER="1">{labels[port]}</TD>' for port in shown]
        rest = len(side) - len(shown)
        if rest > 0:
            count = f"{rest} more" if shown else f"{rest} ports"
            cells.append(f'BORDER="1"><FONT COLOR="grey">{count}</FONT></TD>')
        columns.append(cells)
    head, _, rest_of_text = drawn.text.partition("<TR>\n")
    _, end, tail = rest_of_text.rpartition("</TABLE>")
    return head + "\n".join([*Rows(columns), end + tail])


def _Edges(
    system: Diagram,
    own: _Drawn,
    parts: Mapping[str, _Drawn],
    wires: DelayWires | None,
) -> list[_Edge]:
    """Returns the connections in a diagram, those with its own ports last."""

    def Margin(part: System, i: int) -> float | None:
        return None if wires is None else wires.Into(part, i)

    def Input(part: System, i: int) -> _Port:
        return parts[part.get_name()].inputs[i]

    def Output(part: System, i: int) -> _Port:
        return parts[part.get_name()].outputs[i]

    inside = system.connection_map().items()
    edges = [
        _Edge("", Output(*tail), Input(*head), Margin(*head)) for head, tail in inside
    ]
    for port in own.inputs:
        heads = system.GetInputPortLocators(InputPortIndex(port.place))
        edges += [_Edge("color=blue", port, Input(*x), Margin(*x)) for x in heads]
    for port in own.outputs:
        tail = system.get_output_port_locator(OutputPortIndex(port.place))
        edges.append(_Edge(_EXPORTED_OUTPUT, Output(*tail), port))
    # Drake's order depends on the addresses of the systems in memory.
    return sorted(edges)


def _Connections(edges: Sequence[_Edge], wires: DelayWires | None) -> list[str]:
    """Returns the DOT text of the connections inside one diagram."""

    def Look(*shown: _Edge) -> str:
        """Returns the attributes of a line that some connections share."""
        if wires is None or shown[0].color == _EXPORTED_OUTPUT:
            return ""
        return f", {wires.Look([x.margin for x in shown])}"

    feedback = _Feedback(edges)
    is_ahead = [bool(x.color) or _Ends(x) not in feedback for x in edges]
    spacers = Spacers([(x.tail.name, x.head.name) for x in edges], is_ahead)
    text: list[str] = []
    turned: set[str] = set()
    labelled: set[str] = set()
    for edge in edges:
        tail = edge.tail.name
        head = edge.head.name
        label = ""
        if edge.tail.size > 1 and tail not in labelled:
            label = f', taillabel="{edge.tail.size}", {_WIDTH}'
            labelled.add(tail)
        own = "" if wires is None else f", {wires.Label(edge.margin)}".rstrip(", ")
        if edge.color or _Ends(edge) not in feedback:
            # The weight keeps the forward path straight.
            look = edge.color or "weight=10"
            text.append(f"{tail}:e -> {head}:w [{look}{label}{Look(edge)}{own}]")
            continue
        # A line with two turns. None of its pieces runs against the direction of the
        # layout, so that dot leads them between the boxes.
        shared = [x for x in edges if x.tail == edge.tail and _Ends(x) in feedback]
        look = Look(*shared)
        tail_turn, tail_text = _Turn(tail, look)
        if tail not in turned:
            text += tail_text
            text.append(f"{tail}:e -> {tail_turn}:e [{_NO_ARROW}{label}{look}]")
            turned.add(tail)
        look = Look(edge)
        head_turn, head_text = _Turn(head, look)
        text += head_text
        text.append(f"{head_turn}:e -> {tail_turn}:w [{_NO_ARROW}{look}{own}]")
        text.append(f"{head_turn}:w -> {head}:w" + f" [{look[2:]}]" * bool(look))
    # At the end, they have the least effect on the order of the boxes.
    return text + spacers


def _Ends(edge: _Edge) -> tuple[int, int]:
    """Returns the systems at the ends of a connection."""
    return edge.tail.system, edge.head.system


def _Turn(port: str, look: str) -> tuple[str, list[str]]:
    """Returns the node beside a port at which a feedback connection turns, and its DOT.

    The node is above or below the box of the port.

    Args:
        look: The attributes of the line, whose gap at the turn the node fills; empty: a
            black line.
    """
    node = port.partition(":")[0]
    turn = f"{port.replace(':', '_')}_turn"
    text = [f"{turn} [{_FILLED}{look}]", f"{{rank=same; {node}; {turn}}}"]
    return turn, text


def _Feedback(edges: Sequence[_Edge]) -> set[tuple[int, int]]:
    """Returns the pairs of systems whose connection closes a loop."""
    successors = defaultdict(list)
    for edge in edges:
        if not edge.color:
            successors[edge.tail.system].append(edge.head.system)
    feedback = set()
    done = set()

    # A depth-first search: an edge back to a system on the way closes a loop.
    def Visit(system: int, *upstream: int) -> None:
        for successor in successors[system]:
            if successor in (system, *upstream):
                feedback.add((system, successor))
            elif successor not in done:
                Visit(successor, system, *upstream)
        done.add(system)

    for system in sorted(successors):
        Visit(system)
    return feedback


def LayOut(dot: str, file_format: str) -> bytes:
    """Returns DOT text laid out as `svg` or `png`."""
    program = shutil.which("dot") or _EmbeddedDot()
    if program is None:
        raise RuntimeError(
            f"nothing here can lay out a diagram as {file_format}: install Graphviz, "
            "so that `dot` is on the PATH, or `pip install graphviz-pure`; a path that "
            "ends in .dot needs neither"
        )
    command = [program, f"-T{file_format}"]
    if file_format == "png":
        command.append(f"-Gdpi={_PNG_DPI}")
    run = subprocess.run(command, input=dot.encode(), capture_output=True, check=False)
    if run.returncode != 0 or not run.stdout:
        reason = run.stderr.decode(errors="replace").strip()
        raise RuntimeError(f"{program} wrote no {file_format}: {reason}")
    # A PNG does not contain this text.
    return run.stdout.replace(_FONTS, _MORE_FONTS)


def _EmbeddedDot() -> str | None:
    """Returns the path of the program in the wheel graphviz-pure, if installed."""
    try:
        files = metadata.files("graphviz-pure") or []
    except metadata.PackageNotFoundError:
        return None
    programs = (str(f.locate()) for f in files if f.stem == "graphviz-pure")
    return next(programs, None)


def _SvgToPdf(svg: bytes) -> bytes:
    """Returns an SVG as a PDF with vectors and searchable text."""
    from matplotlib import font_manager

    try:
        from reportlab.graphics import renderPDF
        from reportlab.pdfgen.canvas import Canvas
        from svglib import fonts, svglib
    except ModuleNotFoundError as e:
        raise RuntimeError(
            f"a PDF of a diagram needs {e.name}: `pip install 'teleop-drake[pdf]'`"
        ) from None
    if not svg.isascii():  # Helvetica, which all PDF readers have, is Latin only.
        fonts.register_font("DejaVu Sans", font_manager.findfont("DejaVu Sans"))
        svg = svg.replace(b'family="Helvetica,', b'family="DejaVu Sans,')
    drawing: Any = svglib.svg2rlg(io.BytesIO(svg))
    file = io.BytesIO()
    # Invariant means without a date: the same diagram gives the same bytes.
    canvas = Canvas(file, pagesize=(drawing.width, drawing.height), invariant=True)
    renderPDF.draw(drawing, canvas, 0, 0)
    canvas.save()
    return file.getvalue()
