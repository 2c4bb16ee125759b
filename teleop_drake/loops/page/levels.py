"""The levels of a block diagram as pictures whose ports and wires have names."""

import functools
import html
import inspect
import re
from typing import Any

from pydrake.systems.framework import Diagram, System

from teleop_drake.loops.draw.block_diagram import DiagramDot, LayOut
from teleop_drake.loops.framework.signals import ClassOf, PathsIn, Visible
from teleop_drake.loops.framework.wiring import InputPorts, OutputPorts

_AT = re.compile(r'data-(at|wire)="(\d+)(?::([uy])(\d+))?"')
# The class and the name of a system, as Drake writes them.
_CLASS_AND_NAME = re.compile(r"^<B>([^<]*)</B><BR/>\nname=(.*)$", re.M)
_BOX = re.compile(r"^(?:s|drakelcminterface)(\d+)(?:in|out)? \[")
_PORT = re.compile(r'<TD PORT="([uy]\d+)"')
_HEADER = re.compile(r'<TD BORDER="1" COLSPAN')
# Replacements in the picture that Graphviz has drawn.
_REPLACED = (
    (r"<!--.*?-->\n?|<title>.*?</title>\n?| font-family=\"[^\"]*\"", ""),
    # Links, which name boxes and ports, and the groups of wires.
    (r'<g id="a_[^"]*">\s*<a xlink:href="([^"]*)"[^>]*>', r'<g data-at="\1">'),
    (r"</a>\n?</g>", "</g>"),
    (r'<g id="wire ([^"]*)" class="edge">', r'<g data-wire="\1" class="edge">'),
    # Boxes and ports can be reached by keys; wires are wide enough for a pointer.
    (r'(data-at="[^"]*")>', r'\1 tabindex="0">'),
    (r'<path [^>]*(d="[^"]*")/>', r'\g<0><path class="hit" \1/>'),
)
_WIRE = re.compile(
    r"^(\{?)s(\d+)(?:in|out)?[:_]([uy]\d+)\S* -> (?:s(\d+):(u\d+))?\S*( \[(.*)\])?$"
)


def Levels(diagram: System) -> list[dict[str, Any]]:
    """Returns a picture of a diagram and of each diagram in it, the outermost first.

    Each picture has the `path` of its diagram, the bytes `svg`, and `boxes`, the
    descriptions of the diagram and its systems by _Box(). In the SVG a box has the
    attribute `data-box` with its path; a box that opens has `data-level` too. A port or
    a wire has `data-port` with the path and the name of the port.
    """
    paths = dict(PathsIn(diagram))
    levels = []
    for level, path in PathsIn(diagram):
        parts = level.GetSystems() if isinstance(level, Diagram) else []
        if not parts and level is not diagram:
            continue
        systems = [level, *parts]
        boxes = [_Box(x, paths[x]) for x in systems]

        def Name(
            found: re.Match[str], boxes: Any = boxes, systems: Any = systems
        ) -> str:
            sort, number, side, port = found.groups()
            place = int(number)
            box = boxes[place]
            if side is None:
                is_level = place > 0 and isinstance(systems[place], Diagram)
                return _BoxAttributes(box, is_level)
            # A side of a box without ports has an empty cell.
            names = box[side][int(port) :]
            kind = "wire" if sort == "wire" else side
            return _PortAttributes(box, names[0], kind) if names else ""

        dot = DiagramDot(level, max_depth=min(len(parts), 1))
        svg = _AT.sub(Name, _Picture(dot))
        levels.append({"path": path, "svg": svg.encode(), "boxes": boxes})
    return levels


def _BoxAttributes(box: dict[str, Any], is_level: bool) -> str:
    """Returns the SVG attributes of a box, among them its label for screen readers."""
    path = html.escape(box["path"])
    opens = ", opens" if is_level else ""
    num_ports = len(box["u"]) + len(box["y"])
    # The label has all of the visible text, as voice control needs it.
    name = path.rpartition("/")[2].replace("_", " ")
    label = f"block {name} {box['kind']}{opens}; {num_ports} ports"
    attributes = f'data-box="{path}" role="button" aria-label="{label}"'
    return attributes + (f' data-level="{path}"' if is_level else "")


def _PortAttributes(box: dict[str, Any], port: str, kind: str) -> str:
    """Returns the SVG attributes of a port, "u" or "y", or of a "wire" from a port."""
    words = {"u": "input", "y": "output", "wire": "wire at"}[kind]
    path, name = html.escape(box["path"]), html.escape(port)
    label = f"{words} {name} of {path or 'the diagram'}"
    # Keys reach ports, but not wires, which plot the signal of a port.
    role = "img" if kind == "wire" else "button"
    return f'data-port="{path}:{name}" role="{role}" aria-label="{label}"'


def _Box(system: System, path: str) -> dict[str, Any]:
    """Returns path, class, first paragraph of the docstring, and ports of a system."""
    text = "" if isinstance(system, Diagram) else inspect.getdoc(type(system)) or ""
    return {
        "path": path,
        "kind": ClassOf(system),
        "says": " ".join(text.partition("\n\n")[0].split()),
        "u": [Visible(port.get_name()) for port in InputPorts(system)],
        "y": [Visible(port.get_name()) for port in OutputPorts(system)],
    }


def _NameFirst(found: re.Match[str]) -> str:
    """Returns the head of a box: its name in words, and its class below."""
    kind, name = found[1], found[2].replace("_", " ")
    return (
        f'<FONT POINT-SIZE="17"><B>{name}</B></FONT><BR/>\n'
        f'<FONT POINT-SIZE="10">{kind}</FONT>'
    )


@functools.lru_cache(maxsize=64)
def _Picture(dot: str) -> str:
    """Lays out a level as SVG, in which boxes, ports and wires have numbers.

    They are data-at="1" at a box, data-at="1:y0" at a port of it, and data-wire="1:y0"
    at a wire from this port.
    """
    lines, box = [], "0"
    # The name is above the class and larger, because people search for names.
    named = _CLASS_AND_NAME.sub(_NameFirst, dot)
    for line in named.splitlines():
        if found := _BOX.match(line):
            box = found[1]
        linked = _PORT.sub(rf'<TD HREF="{box}:\1" TITLE="." PORT="\1"', line)
        linked = _HEADER.sub(f'<TD HREF="{box}" TITLE="." BORDER="1" COLSPAN', linked)
        if found := _WIRE.match(linked):
            _, box_from, port_from, box_to, port_to, whole, inside = found.groups()
            attributes = inside + ", " if inside else ""
            linked = linked.removesuffix(whole or "")
            # A wire that leads to an input has the name of this input.
            end = f"{box_to}:{port_to}" if box_to else f"{box_from}:{port_from}"
            linked += f' [{attributes}id="wire {end}"]'
        lines.append(linked)
    svg = LayOut("\n".join(lines), "svg").decode()
    svg = svg[svg.index("<svg") :]
    for pattern, replacement in _REPLACED:
        svg = re.sub(pattern, replacement, svg)
    return re.sub(r' width="[^"]*" height="[^"]*"', "", svg, count=1)
