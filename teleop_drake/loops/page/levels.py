"""The levels of a block diagram as pictures whose ports and wires have names."""

import functools
import inspect
import re
from typing import Any
from xml.etree import ElementTree

from pydrake.systems.framework import Diagram, System

from teleop_drake.loops.draw.block_diagram import DiagramDot, LayOut
from teleop_drake.loops.framework.signals import ClassOf, PathsIn, Visible
from teleop_drake.loops.framework.wiring import InputPorts, OutputPorts

# The class and the name of a system, as Drake writes them.
_CLASS_AND_NAME = re.compile(r"^<B>([^<]*)</B><BR/>\nname=(.*)$", re.M)
# The cells of a box that are links in the picture: its ports and its head.
_CELL = re.compile(r'<TD (?=PORT="([uy]\d+)"|BORDER="1" COLSPAN)')
_WIRE = re.compile(
    r"^\{?s(\d+)(?:in|out)?[:_]([uy]\d+)\S* -> (?:s(\d+):(u\d+))?.*$", re.M
)
_BOX = re.compile(r"(?:s|drakelcminterface)(\d+)(?:in|out)?")

_SVG = "{http://www.w3.org/2000/svg}"
ElementTree.register_namespace("", _SVG[1:-1])


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

        dot = DiagramDot(level, max_depth=min(len(parts), 1))
        picture = ElementTree.fromstring(_Picture(dot))
        del picture.attrib["width"], picture.attrib["height"]
        is_level = [isinstance(x, Diagram) and x is not level for x in systems]
        _NameParts(picture, boxes, is_level)
        levels.append(
            {"path": path, "svg": ElementTree.tostring(picture), "boxes": boxes}
        )
    return levels


def _NameParts(
    picture: ElementTree.Element, boxes: list[dict[str, Any]], is_level: list[bool]
) -> None:
    """Gives the boxes, ports and wires of a picture by Graphviz their attributes."""
    for text in picture.iter(f"{_SVG}text"):
        text.attrib.pop("font-family", None)
    for group in list(picture.iter(f"{_SVG}g")):
        title = group.find(f"{_SVG}title")
        if title is None:
            continue
        group.remove(title)
        number, _, port = group.get("id", "").removeprefix("wire ").partition(":")
        if port:
            del group.attrib["id"]
            group.attrib.update(_PortAttributes(boxes[int(number)], port, "wire"))
            _Widen(group)
        elif box := _BOX.fullmatch(title.text or ""):
            place = int(box[1])
            # Nodes of channels outside of the diagram have other numbers.
            if place < len(boxes):
                _NameCells(group, boxes[place], is_level[place])


def _Widen(wire: ElementTree.Element) -> None:
    """Adds a line to a wire that is wide enough for a pointer."""
    for path in wire.findall(f"{_SVG}path"):
        line = ElementTree.Element(
            f"{_SVG}path", {"class": "hit", "d": path.get("d", "")}
        )
        wire.insert(list(wire).index(path) + 1, line)


def _NameCells(group: ElementTree.Element, box: dict[str, Any], is_level: bool) -> None:
    """Gives the head and the ports of a box attributes; keys can reach them."""
    for cell in group.findall(f"{_SVG}g"):
        (link,) = cell
        place = link.get("{http://www.w3.org/1999/xlink}href", "")
        cell.clear()
        cell.extend(link)
        if place == "box":
            cell.attrib.update(_BoxAttributes(box, is_level))
        else:
            cell.attrib.update(_PortAttributes(box, place, place[0]))
        cell.set("tabindex", "0")


def _BoxAttributes(box: dict[str, Any], is_level: bool) -> dict[str, str]:
    """Returns the SVG attributes of a box, among them its label for screen readers."""
    path = box["path"]
    opens = ", opens" if is_level else ""
    num_ports = len(box["u"]) + len(box["y"])
    # The label has all of the visible text, as voice control needs it.
    name = path.rpartition("/")[2].replace("_", " ")
    label = f"block {name} {box['kind']}{opens}; {num_ports} ports"
    attributes = {"data-box": path, "role": "button", "aria-label": label}
    return attributes | ({"data-level": path} if is_level else {})


def _PortAttributes(box: dict[str, Any], place: str, kind: str) -> dict[str, str]:
    """Returns the SVG attributes of a port, "u" or "y", or of a "wire" at a port.

    Args:
        place: The side and the number of the port, such as "u0".
    """
    # A side of a box without ports has an empty cell.
    names = box[place[0]][int(place[1:]) :]
    if not names:
        return {}
    words = {"u": "input", "y": "output", "wire": "wire at"}[kind]
    return {
        "data-port": f"{box['path']}:{names[0]}",
        # Keys reach ports, but not wires, which plot the signal of a port.
        "role": "img" if kind == "wire" else "button",
        "aria-label": f"{words} {names[0]} of {box['path'] or 'the diagram'}",
    }


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


def _WithId(found: re.Match[str]) -> str:
    """Returns a wire with its port as id: the input that it leads to, if it does."""
    box_from, port_from, box_to, port_to = found.groups()
    end = f"{box_to}:{port_to}" if box_to else f"{box_from}:{port_from}"
    return f'{found[0]} [id="wire {end}"]'


@functools.lru_cache(maxsize=64)
def _Picture(dot: str) -> bytes:
    """Lays out a level as SVG.

    The head and the ports of a box are links to "box", "u0", "y0" and so on, and a wire
    has an id such as "wire 1:y0".
    """
    # The name is above the class and larger, because people search for names.
    named = _CLASS_AND_NAME.sub(_NameFirst, dot)
    linked = _CELL.sub(lambda x: f'<TD HREF="{x[1] or "box"}" TITLE="." ', named)
    return LayOut(_WIRE.sub(_WithId, linked), "svg")
