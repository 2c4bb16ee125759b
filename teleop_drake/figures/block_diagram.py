"""Block diagrams as pictures: DOT text, SVG, PNG and PDF of any Drake system.

The DOT text is Drake's own (`System.GetGraphvizString`) in a reproducible form and with
a block-diagram layout: signals run from left to right, and a feedback connection runs
back in a lane of its own instead of across the boxes. It needs no Graphviz. Everything
else is laid out by the `dot` on the PATH, or else by the one in the wheel
graphviz-pure.
"""

import io
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Diagram, System

from teleop_drake.files import Replacing
from teleop_drake.upper import UpperFunction
from teleop_drake.validation import Refuse

_SUFFIXES = (".svg", ".png", ".pdf", ".dot", ".html")

# How the levels stand that a picture opens: below each other in the order of their
# insertion, which dot counts from the bottom, and even on the left.
_BELOW_EACH_OTHER = 'graph [pack=18, packmode="array_itc1"]'

# Dots per inch of a PNG, enough for print.
_PNG_DPI = 200

# What a picture asks for, and what it is to ask for: where there is no Helvetica, fonts
# of the same widths come before any other, from which names would stick out of boxes.
_FONTS = b'font-family="Helvetica,sans-Serif"'
_MORE_FONTS = b'font-family="Helvetica,Arial,Liberation Sans,Arimo,sans-serif"'

# Arimo, the metric twin of Helvetica, is what graphviz-pure measures text with.
_STYLE = """\
graph [fontname="Helvetica", nodesep=0.3, ranksep=0.45]
node [fontname="Helvetica"]
edge [arrowsize=0.8, fontname="Helvetica"]"""

# A box with more ports on a side shows only those that are connected.
_MOST_PORTS = 10

# A diagram's own output ports stand at the far right, and the lines that lead there
# cross the picture. Drawn faintly they leave the loop itself visible.
_EXPORTED_OUTPUT = "color=palegreen3, penwidth=0.7"

# Graphviz 2.43 draws an arrowhead on some lines in spite of dir=none.
_NO_ARROW = "dir=none, arrowsize=0"

# How the width of a vector stands on its wire.
_WIDTH = "fontsize=10, fontcolor=grey40, labeldistance=1.2, labelangle=30"

# How the frame of a diagram begins in Drake's DOT text, and without a line.
_FRAME = "diagram {\ncolor=black"
_NO_FRAME = "diagram {\ncolor=white"

# The lines of Drake's DOT text that carry the process-wide number of a system.
_NUMBERED_LINE = re.compile(
    r"^(digraph _|subgraph clusters?|s)(\d+)((?:in|out|diagram|subsystems)? [\[{])"
)
_EDGE_LINE = re.compile(
    r"^s(\d+)(in|out)?:([uy]?)(\d+):e -> s(\d+)(in|out)?:([uy]?)(\d+):w(?: \[(.*)\];)?$"
)
# LCM's node has the address of the object.
_LCM = re.compile(r"(drakelcminterface)(\d+)(in|out)")
_BOX_LINE = re.compile(r"^s(\d+) \[")
_PORT_LINE = re.compile(r'^<TD PORT="([uy]\d+)"[^>]*>(.+)</TD>$')
_PYTHON_CLASS = re.compile(r"^<B>[^<]*\.(\w+)</B>")


def DiagramDot(system: System, *, max_depth: int | None = None) -> str:
    """The block diagram of a system as DOT text, the same in every process.

    Four things differ from Drake's `GetGraphvizString`. The numbers that stand for
    systems count from 0 in order of appearance and the connections are sorted, so that
    two builds of one diagram give the same bytes. A system written in Python is
    labelled with its class name alone, like those of Drake. Of a box with more than ten
    ports on a side, those that are not connected are only counted. A connection that
    closes a loop is drawn around the boxes; which one of a loop's connections that is
    follows from the order in which the systems were added to the builder.

    Args:
        system: any Drake system; a system without a name is labelled by its class only.
        max_depth: how many levels of nested diagrams to open: 0 is a single box, 1
            shows the system's own parts as boxes, None opens everything.

    Raises:
        ValueError: if max_depth is negative.
    """
    # Drake ends the process on a negative depth.
    if max_depth is not None and max_depth < 0:
        Refuse("max_depth", max_depth, "null, 0 or positive")
    return _Dot(system, max_depth, {})


def _Dot(system: System, max_depth: int | None, numbers: dict[str, int]) -> str:
    """Returns the DOT text of a system, whose numbers are added to `numbers`."""

    def Number(drake_id: str) -> int:
        return numbers.setdefault(drake_id, len(numbers))

    text: list[str] = []
    edges: list[_Edge] = []
    used: set[tuple[int, str]] = set()
    drawn = system.GetGraphvizString(max_depth=max_depth)
    widths = _Widths(system, drawn) if max_depth == 1 else {}
    # A box of LCM begins in the line of another one.
    for line in re.sub(r";(?=s\d+ \[)", ";\n", drawn).splitlines():
        edge = _EDGE_LINE.match(line)
        if edge:
            edges.append(_Edge(edge, Number, widths))
            used |= edges[-1].ports
            continue
        # The connections of one diagram stand together.
        text += _Connections(edges)
        edges = []
        own = line
        if "->" in line and not line.startswith("<"):
            # To what is no system: Meshcat, LCM. An LCM may have no box of its own.
            own = re.sub(r"\bs(\d+)\b", lambda m: f"s{Number(m[1])}", line)
            outside = _LCM.search(own)
            if outside and f"\n{outside[0]} [" not in drawn:
                own = f"{own}\n{outside[0]} [label=LCM]"
        own = _LCM.sub(lambda m: f"{m[1]}{Number(m[2])}{m[3]}", own)
        numbered = _NUMBERED_LINE.sub(lambda m: f"{m[1]}{Number(m[2])}{m[3]}", own)
        text.append(_PYTHON_CLASS.sub(r"<B>\1</B>", numbered))
        if line == "rankdir=LR":
            text.append(_STYLE)
    return "\n".join(_WithoutIdlePorts(text, used)).rstrip() + "\n"


def RenderSvg(system: System, *, max_depth: int | None = None) -> str:
    """The block diagram of a system as SVG text, for `IPython.display.SVG` and the web.

    Args and errors are those of `DiagramDot`; raises RuntimeError where nothing can lay
    the diagram out (see `WriteDiagram`). More than one level is drawn as there.
    """
    return _Render(system, max_depth, "svg").decode()


def WriteDiagram(
    system: System, path: str | os.PathLike[str], *, max_depth: int | None = None
) -> None:
    """Writes the block diagram of a system to a file, in the format of its suffix.

    The file appears complete or not at all, and replaces one of the same name.

    A picture of more than one level has each diagram by itself, first the whole with
    its parts as closed boxes, then below it these boxes opened. A .dot file has one
    graph of boxes in boxes, as `DiagramDot` returns it.

    Args:
        path: ends in .svg, .png (200 dots per inch), .pdf, .dot or .html, a page in
            which boxes open at a click, so that max_depth has no effect.
        max_depth: how many levels of nested diagrams to open, see `DiagramDot`.

    Raises:
        ValueError: if the suffix is another one, or max_depth is negative.
        RuntimeError: if there is neither a `dot` on the PATH nor graphviz-pure, or if
            the one found fails, or if a PDF is asked for without the extra `pdf`. A
            .dot file needs none of them.
        OSError: if the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        Refuse("path", str(path), f"a file that ends in one of {', '.join(_SUFFIXES)}")
    if suffix == ".html":
        content = UpperFunction("DiagramPage")(system).html.encode()
    elif suffix == ".dot":
        content = DiagramDot(system, max_depth=max_depth).encode()
    else:
        content = _Render(system, max_depth, "png" if suffix == ".png" else "svg")
        if suffix == ".pdf":
            content = _SvgToPdf(content)
    with Replacing(path) as temporary:
        temporary.write_bytes(content)


def _Render(system: System, max_depth: int | None, file_format: str) -> bytes:
    """Returns the picture of a diagram, and of each in it that is to be opened."""
    if not isinstance(system, Diagram) or max_depth == 0:
        return LayOut(DiagramDot(system, max_depth=max_depth), file_format)
    levels = [system]
    deepest = [system]
    depth = 1
    while deepest and depth != max_depth:
        parts = [part for outer in deepest for part in outer.GetSystems()]
        deepest = [part for part in parts if isinstance(part, Diagram)]
        levels += deepest
        depth += 1
    if len(levels) == 1:
        return LayOut(DiagramDot(system, max_depth=1), file_format)
    numbers: dict[str, int] = {}
    text = ["}"]
    for level in levels:
        dot = _Dot(level, 1, numbers)
        # A frame of its own, wide enough for the lines that run around the boxes.
        dot = dot.replace("digraph _", "subgraph cluster_level", 1)
        dot = dot.replace("rankdir=LR", "margin=30", 1)
        text.append(dot.replace(_FRAME, f"{_NO_FRAME}\nmargin=8", 1))
    text += [_BELOW_EACH_OTHER, "rankdir=LR", "digraph levels {"]
    return LayOut("\n".join(reversed(text)), file_format)


class _Edge:
    """One connection in Drake's DOT text, with the systems renumbered."""

    def __init__(
        self,
        line: re.Match[str],
        number: Callable[[str], int],
        widths: Mapping[tuple[str, str], int],
    ):
        self.source = number(line[1])
        self.target = number(line[5])
        tail = line[3] + line[4]
        head = line[7] + line[8]
        self.tail = _End(f"s{self.source}", line[2], tail, "e")
        self.head = _End(f"s{self.target}", line[6], head, "w")
        # Drake marks the lines that lead to the ports of the diagram itself.
        self.attributes = line[9] or ""
        width = widths.get((line[1], tail), 1)
        # A number beside a wire is the width of its vector.
        self.label = f'taillabel="{width}", {_WIDTH}' if width > 1 else ""
        self.ports = {(self.source, tail), (self.target, head)}
        ends = (self.source, int(line[4])), (self.target, int(line[8]))
        self.order = (bool(self.attributes), *ends)


class _End:
    """Where a connection meets a box, and where it turns if it runs back."""

    def __init__(self, system: str, side: str | None, port: str, compass: str):
        # A diagram that is opened has a node for its inputs and one for its outputs.
        node = system + (side or "")
        self.port = f"{node}:{port}:{compass}"
        turn = f"{node}_{port}_turn"
        self.turn = [f"{turn} [shape=point, width=0.02]"]
        # Outside and inside: towards the box, and towards the other turn.
        self.outside = self.inside = turn
        # The turn lies above or below a closed box. Dot cannot do so with an opened
        # one, so there it lies beside it.
        if not side:
            self.turn.append(f"{{rank=same; {node}; {turn}}}")
            self.outside += f":{compass}"
            self.inside += ":w" if compass == "e" else ":e"


def _WithoutIdlePorts(text: list[str], used: set[tuple[int, str]]) -> list[str]:
    """Leaves out ports that nothing is connected to, of boxes with many.

    Args:
        used: What something is connected to: the system and the port, as `u0` or `y0`.
    """
    result: list[str] = []
    begin = box = 0
    for line in text:
        result.append(line)
        header = _BOX_LINE.match(line)
        if header:
            begin = len(result)
            box = int(header[1])
        elif line == ">];" and begin:
            cells = [x for x in map(_PORT_LINE.match, result[begin:]) if x]
            sides = [[x for x in cells if x[1][0] == side] for side in "uy"]
            if max(map(len, sides)) > _MOST_PORTS:
                shown = [[x for x in side if (box, x[1]) in used] for side in sides]
                first = result.index("<TR>", begin)
                result[first:-2] = _PortRows(*map(_Cells, shown, map(len, sides)))
            begin = 0
    return result


def _Cells(used: list[re.Match[str]], count: int) -> list[str]:
    """Returns the cells of the ports that are used, and how many others there are."""
    cells = [f'<TD PORT="{port[1]}" BORDER="1">{port[2]}</TD>' for port in used]
    rest = count - len(used)
    if rest > 0:
        text = f"{rest} more" if used else f"{rest} ports"
        cells.append(f'<TD BORDER="1"><FONT COLOR="grey">{text}</FONT></TD>')
    return cells


def _PortRows(inputs: list[str], outputs: list[str]) -> list[str]:
    """Returns the rows of a box; where a side has fewer cells, the last is higher."""
    rows = []
    for i in range(max(len(inputs), len(outputs))):
        rows.append("<TR>")
        for cells, other in ((inputs, outputs), (outputs, inputs)):
            if i < len(cells):
                height = len(other) - i if i == len(cells) - 1 else 1
                rows.append(cells[i].replace("<TD", f'<TD ROWSPAN="{max(height, 1)}"'))
        rows.append("</TR>")
    return rows


def _Widths(system: System, dot: str) -> dict[tuple[str, str], int]:
    """Returns the widths of vectors by Drake's number of a system and the port.

    Args:
        system: A system whose parts are boxes.
        dot: Drake's text, in which they stand in their order.
    """
    parts = system.GetSystems() if isinstance(system, Diagram) else []
    parts = [part for part in parts if type(part).__name__ != "LcmInterfaceSystem"]
    numbers = re.findall(r"(?:^|;)s(\d+) \[", dot, re.MULTILINE)
    widths = {}
    for part, number in zip(parts, numbers, strict=False):
        for i in range(part.num_output_ports()):
            widths[number, f"y{i}"] = part.get_output_port(i).size()
    (own,) = re.findall(r"subgraph clusters?(\d+)(?:diagram)? \{", dot)[:1] or [""]
    for i in range(system.num_input_ports()):
        widths[own, str(i)] = system.get_input_port(i).size()
    return widths


def _Connections(edges: list[_Edge]) -> list[str]:
    """The DOT text of the connections inside one diagram."""
    # Drake's own order follows the addresses of the systems in memory.
    edges = sorted(edges, key=lambda edge: edge.order)
    feedback = _Feedback(edges)
    text: list[str] = []
    drawn: set[str] = set()
    labelled: set[str] = set()
    for edge in edges:
        tail = edge.tail
        head = edge.head
        label = f", {edge.label}" if edge.label and tail.port not in labelled else ""
        labelled.add(tail.port)
        if edge.attributes:
            attributes = edge.attributes.replace("color=green", _EXPORTED_OUTPUT)
            text.append(f"{tail.port} -> {head.port} [{attributes}{label}]")
        elif (edge.source, edge.target) not in feedback:
            # The weight keeps the forward path straight.
            text.append(f"{tail.port} -> {head.port} [weight=10{label}]")
        else:
            # A line with two turns, in pieces of which none runs against the layout:
            # dot leads only such lines cleanly between the boxes.
            if tail.port not in drawn:
                text += tail.turn
                text.append(f"{tail.port} -> {tail.outside} [{_NO_ARROW}{label}]")
                drawn.add(tail.port)
            text += head.turn
            text.append(f"{head.inside} -> {tail.inside} [{_NO_ARROW}]")
            text.append(f"{head.outside} -> {head.port}")
    return text


def _Feedback(edges: list[_Edge]) -> set[tuple[int, int]]:
    """The pairs of systems whose connection closes a loop, by depth-first search."""
    successors: dict[int, list[int]] = {}
    for edge in edges:
        if not edge.attributes:
            successors.setdefault(edge.source, []).append(edge.target)
    feedback: set[tuple[int, int]] = set()
    done: set[int] = set()

    def Visit(system: int, upstream: tuple[int, ...]) -> None:
        upstream += (system,)
        for successor in successors.get(system, []):
            if successor in upstream:
                feedback.add((system, successor))
            elif successor not in done:
                Visit(successor, upstream)
        done.add(system)

    for system in sorted(successors):
        if system not in done:
            Visit(system, ())
    return feedback


def LayOut(dot: str, file_format: str) -> bytes:
    """Lays DOT text out as svg or png."""
    program = shutil.which("dot") or _EmbeddedDot()
    if program is None:
        raise RuntimeError(
            f"nothing here can lay out a diagram as {file_format}: install Graphviz, "
            "so that `dot` is on the PATH, or `pip install graphviz-pure`; a path that "
            "ends in .dot needs neither"
        )
    # Dot's frame of a diagram is made for the boxes in it, and lines that run
    # around them leave it. The picture is made for both.
    inner = dot.replace(_FRAME, _NO_FRAME, 1)
    picture = _RunDot(program, inner, file_format)
    if inner == dot:
        return picture
    if file_format == "png":
        return _FramedPng(picture)
    none = rb'stroke="(none|transparent)"'
    return re.sub(none, b'stroke="black"', picture, count=1)


def _FramedPng(png: bytes) -> bytes:
    """Draws a line around a picture."""
    from PIL import Image, ImageDraw

    image = Image.open(io.BytesIO(png)).convert("RGB")
    width, height = image.size
    ImageDraw.Draw(image).rectangle((2, 2, width - 3, height - 3), outline=0, width=3)
    file = io.BytesIO()
    image.save(file, format="png", dpi=(_PNG_DPI, _PNG_DPI))
    return file.getvalue()


def _EmbeddedDot() -> str | None:
    """The program in the wheel graphviz-pure, which need not be on the PATH."""
    try:
        files = metadata.files("graphviz-pure") or []
    except metadata.PackageNotFoundError:
        return None
    programs = [str(f.locate()) for f in files if f.stem == "graphviz-pure"]
    return programs[0] if programs else None


def _RunDot(program: str, dot: str, file_format: str) -> bytes:
    command = [program, f"-T{file_format}"]
    if file_format == "png":
        command.append(f"-Gdpi={_PNG_DPI}")
    run = subprocess.run(command, input=dot.encode(), capture_output=True, check=False)
    if run.returncode != 0 or not run.stdout:
        reason = run.stderr.decode(errors="replace").strip()
        raise RuntimeError(f"{program} wrote no {file_format}: {reason}")
    # A PNG has no such text.
    return run.stdout.replace(_FONTS, _MORE_FONTS)


def _SvgToPdf(svg: bytes) -> bytes:
    """Turns SVG into PDF: vectors, and text that can be searched."""
    from matplotlib import font_manager

    try:
        from reportlab.graphics import renderPDF
        from reportlab.pdfgen.canvas import Canvas
        from svglib import fonts, svglib
    except ModuleNotFoundError as e:
        raise RuntimeError(
            f"a PDF of a diagram needs {e.name}: `pip install 'teleop-drake[pdf]'`"
        ) from None
    if not svg.isascii():  # Helvetica, which every reader has, has Latin letters only.
        fonts.register_font("DejaVu Sans", font_manager.findfont("DejaVu Sans"))
        svg = svg.replace(b'family="Helvetica,', b'family="DejaVu Sans,')
    drawing: Any = svglib.svg2rlg(io.BytesIO(svg))
    file = io.BytesIO()
    # Invariant: without a date the same diagram gives the same bytes.
    canvas = Canvas(file, pagesize=(drawing.width, drawing.height), invariant=True)
    renderPDF.draw(drawing, canvas, 0, 0)
    canvas.save()
    return file.getvalue()
