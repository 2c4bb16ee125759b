"""A Diagram, however deeply nested, as a list of its blocks and their connections."""

from dataclasses import dataclass
from typing import NamedTuple

from pydrake.systems.framework import (
    Diagram,
    InputPortIndex,
    OutputPortIndex,
    System,
)

from teleop_drake.signals import NameOf, PathsIn


class UnsupportedSystem(ValueError):
    """A system that cannot be compiled; it runs in Drake's Simulator all the same.

    Args:
        system: The system.
        reason: Why not, as part of a sentence.
    """

    def __init__(self, system: System, reason: str):
        name = f"{type(system).__name__} {system.get_name()!r}"
        super().__init__(f"{name} cannot be compiled: {reason}")


class AlgebraicLoop(UnsupportedSystem):
    """A signal that depends on itself at the same instant."""


class Source(NamedTuple):
    """Where a signal comes from.

    Attributes:
        block: Index of the block.
        port: Name of its output port.
    """

    block: int
    port: str


@dataclass(frozen=True, kw_only=True)
class Block:
    """A system that is no Diagram.

    Attributes:
        system: The system.
        path: Its place, for people, as `robot/plant`.
        inputs: What its input ports are connected to, by their names.
    """

    system: System
    path: str
    inputs: dict[str, Source]


def Flatten(system: System, path: str = "") -> list[Block]:
    """Returns the blocks of a Diagram, in the order of its state.

    Args:
        system: The Diagram, or a block by itself.
        path: Its own place.
    """
    walk = list(PathsIn(system, path))
    blocks = {
        block: Block(system=block, path=place or NameOf(block), inputs={})
        for block, place in walk
        if not isinstance(block, Diagram)
    }
    places = {block: i for i, block in enumerate(blocks)}
    for diagram, _ in walk:
        if not isinstance(diagram, Diagram):
            continue
        for (target, i), (part, o) in diagram.connection_map().items():
            source, output = _OutputPort(part, int(o))
            for block, name in InputsOf(target, int(i)):
                blocks[block].inputs[name] = Source(places[source], output)
    return list(blocks.values())


def OutputOf(blocks: list[Block], system: System, index: int) -> Source:
    """Returns where an output of a system in the Diagram comes from.

    Args:
        blocks: Those of the Diagram, by Flatten().
        system: A block, or a Diagram in the Diagram.
    """
    source, port = _OutputPort(system, index)
    return Source([block.system for block in blocks].index(source), port)


def _OutputPort(system: System, index: int) -> tuple[System, str]:
    """Returns the block that an output comes from, and the name of its port."""
    if not isinstance(system, Diagram):
        return system, system.get_output_port(index).get_name()
    inner, i = system.get_output_port_locator(OutputPortIndex(index))
    return _OutputPort(inner, int(i))


def InputsOf(system: System, index: int) -> list[tuple[System, str]]:
    """Returns the blocks that an input leads to, and their ports."""
    if not isinstance(system, Diagram):
        return [(system, system.get_input_port(index).get_name())]
    inner = system.GetInputPortLocators(InputPortIndex(index))
    return [found for part, i in inner for found in InputsOf(part, int(i))]
