"""Flattens a nested Diagram to a list of its blocks and their connections."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from pydrake.systems.framework import (
    Diagram,
    InputPortIndex,
    OutputPortIndex,
    System,
)

from teleop_drake.loops.framework.signals import ClassOf, NameOf, PathsIn
from teleop_drake.loops.framework.validation import ScenarioError

# The force with which a person draws a body in Meshcat. AddDefaultVisualization() of
# newer Drake connects it to every plant; pydrake has no class for it.
_MOUSE = "drake::multibody::meshcat::MeshcatMouseSpring"


class UnsupportedSystem(ValueError):
    """Raised for a system that cannot be compiled; Drake's Simulator can still run it.

    Args:
        system: The system.
        reason: The reason, which ends the sentence of the message.
    """

    def __init__(self, system: System, reason: str):
        name = f"{ClassOf(system)} {system.get_name()!r}"
        super().__init__(f"{name} cannot be compiled: {reason}")


class UnreadableLeaf(UnsupportedSystem):
    """Raised for a user's block in Python whose functions cannot be followed.

    Attributes:
        name: The name of the block.
        reason: The function, the line and the reason, with advice.
    """

    def __init__(self, system: System, reason: str):
        super().__init__(system, reason)
        self.name = NameOf(system)
        self.reason = reason


class AlgebraicLoop(UnsupportedSystem):
    """Raised for a signal that depends on itself at the same instant."""


class NearLimit(ScenarioError):
    """A joint of a discrete plant has come near to its limit; the message says when."""


class Source(NamedTuple):
    """The source of a signal: an output port of a block.

    Attributes:
        block: Index of the block in the list of Flatten().
        port: Name of its output port.
    """

    block: int
    port: str


@dataclass(frozen=True, kw_only=True)
class Block:
    """A system that is not a Diagram.

    Attributes:
        system: The system.
        path: Its path in the Diagram, such as `robot/plant`, for messages.
        inputs: The source of each connected input port, keyed by the port's name.
        idle: The names of the input ports that are connected to the mouse in Meshcat,
            and that count as not connected.
    """

    system: System
    path: str
    inputs: dict[str, Source]
    idle: set[str] = field(default_factory=set)


def Flatten(system: System, path: str = "") -> list[Block]:
    """Returns the blocks of a Diagram, in the order of their states in its Context.

    Args:
        system: The Diagram, or a single block.
        path: The path of `system`; the paths of the blocks begin with it.
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
            is_idle = type(source) is System and source.GetSystemType() == _MOUSE
            for block, name in InputsOf(target, int(i)):
                if is_idle:
                    blocks[block].idle.add(name)
                else:
                    blocks[block].inputs[name] = Source(places[source], output)
    return list(blocks.values())


def Reached(starts: Iterable[int], steps: Mapping[int, Iterable[int]]) -> set[int]:
    """Returns some blocks and all blocks that can be reached from them, by index.

    Args:
        starts: The blocks to start from.
        steps: The blocks that follow each block directly.
    """
    found: set[int] = set()
    new = set(starts)
    while new:
        found |= new
        new = {k for i in new for k in steps[i]} - found
    return found


def OutputOf(blocks: Sequence[Block], system: System, index: int) -> Source:
    """Returns the block and the port that compute an output of a system.

    Args:
        blocks: The blocks of the Diagram, from Flatten().
        system: One of these blocks, or a Diagram that contains some of them.
        index: Index of the output port.
    """
    source, port = _OutputPort(system, index)
    return Source([block.system for block in blocks].index(source), port)


def _OutputPort(system: System, index: int) -> tuple[System, str]:
    """Returns the block that computes an output, and the name of the block's port."""
    if not isinstance(system, Diagram):
        return system, System.get_output_port(system, index).get_name()
    inner, i = system.get_output_port_locator(OutputPortIndex(index))
    return _OutputPort(inner, int(i))


def InputsOf(system: System, index: int) -> list[tuple[System, str]]:
    """Returns the blocks that an input port leads to, and the names of their ports."""
    if not isinstance(system, Diagram):
        return [(system, System.get_input_port(system, index).get_name())]
    inner = system.GetInputPortLocators(InputPortIndex(index))
    return [found for part, i in inner for found in InputsOf(part, int(i))]
