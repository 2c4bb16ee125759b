"""The levels of a block diagram as pictures whose ports and wires have names."""

import functools
import html
import inspect
import re
from typing import Any

from pydrake.systems.framework import Diagram, System

from teleop_drake.figures.block_diagram import DiagramDot, LayOut
from teleop_drake.page.model import Systems

_AT = re.compile(r'data-at="(\d+)(?::([uy])(\d+))?"')
_BOX = re.compile(r"^s(\d+) \[")
_PORT = re.compile(r'<TD PORT="([uy]\d+)"')
_HEADER = re.compile(r'<TD BORDER="1" COLSPAN')
_NODE_OF_DIAGRAM = re.compile(r"^s0(in|out) \[")
_WIRE = re.compile(r"^(\{?)s(\d+)(?:in|out)?[:_]([uy]\d+)\S* -> \S+( \[(.*)\])?$")


def Levels(diagram: System) -> list[dict[str, Any]]:
    """Returns a picture of each diagram in a diagram, the outermost first.

    Each has its `path`, the picture `svg` as bytes, and `boxes`: path, class, first
    sentence and ports of its systems. In the picture the attribute `data-box` is the
    path of a box, of one with a level in it `data-level` too, and `data-port` that of a
    port or a wire.
    """
    paths = {system.GetSystemPathname(): path for system, path in Systems(diagram)}
    levels = []
    for level, path in Systems(diagram):
        if not isinstance(level, Diagram):
            continue
        systems = [level, *level.GetSystems()]
        boxes = [_Box(x, paths[x.GetSystemPathname()]) for x in systems]

        def Name(
            found: re.Match[str], boxes: Any = boxes, systems: Any = systems
        ) -> str:
            box, side, system = boxes[int(found[1])], found[2], systems[int(found[1])]
            text = html.escape(box["path"])
            if side is None:
                is_level = system is not systems[0] and isinstance(system, Diagram)
                return f'data-box="{text}"' + is_level * f' data-level="{text}"'
            # A side without ports has an empty place.
            names = box[side][int(found[3]) :]
            return f'data-port="{text}:{html.escape(names[0])}"' if names else ""

        svg = _AT.sub(Name, _Picture(DiagramDot(level, max_depth=1)))
        levels.append({"path": path, "svg": svg.encode(), "boxes": boxes})
    return levels


def _Box(system: System, path: str) -> dict[str, Any]:
    text = "" if isinstance(system, Diagram) else inspect.getdoc(type(system)) or ""
    inputs = [system.get_input_port(i) for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i) for i in range(system.num_output_ports())]
    return {
        "path": path,
        "kind": type(system).__name__,
        "says": " ".join(text.partition("\n\n")[0].split()),
        "u": [port.get_name() for port in inputs],
        "y": [port.get_name() for port in outputs],
    }


@functools.lru_cache(maxsize=64)
def _Picture(dot: str) -> str:
    """Lays a level out, with data-at="1" at a box, "1:y0" at a port or wire."""
    lines, box = [], "0"
    for line in dot.splitlines():
        if found := _BOX.match(line):
            box = found[1]
        elif _NODE_OF_DIAGRAM.match(line):
            box = "0"
        line = _PORT.sub(rf'<TD HREF="{box}:\1" TITLE="." PORT="\1"', line)
        line = _HEADER.sub(f'<TD HREF="{box}" TITLE="." BORDER="1" COLSPAN', line)
        if found := _WIRE.match(line):
            attributes = found[5] + ", " if found[5] else ""
            line = line.removesuffix(found[4] or "")
            line += f' [{attributes}id="wire {found[2]}:{found[3]}"]'
        lines.append(line)
    svg = LayOut("\n".join(lines), "svg").decode()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(
        r"<!--.*?-->\n?|<title>.*?</title>\n?| font-family=\"[^\"]*\"", "", svg
    )
    svg = re.sub(
        r'<g id="a_[^"]*">\s*<a xlink:href="([^"]*)"[^>]*>', r'<g data-at="\1">', svg
    )
    svg = svg.replace("</a>\n</g>", "</g>").replace("</a></g>", "</g>")
    svg = re.sub(
        r'<g id="wire ([^"]*)" class="edge">', r'<g data-at="\1" class="edge">', svg
    )
    # Boxes and ports can be reached by keys; wires are wide enough for a pointer.
    svg = re.sub(r'(data-at="[^"]*")>', r'\1 tabindex="0">', svg)
    svg = re.sub(r'<path [^>]*(d="[^"]*")/>', r'\g<0><path class="hit" \1/>', svg)
    return re.sub(r' width="[^"]*" height="[^"]*"', "", svg, count=1)
