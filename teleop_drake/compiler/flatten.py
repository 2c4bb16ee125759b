"""A Diagram, however deeply nested, as a list of its blocks and their connections."""

from dataclasses import dataclass
from typing import NamedTuple

from pydrake.systems.framework import (
    Diagram,
    InputPortIndex,
    OutputPortIndex,
    System,
)


class UnsupportedSystem(ValueError):
    """A system that cannot be compiled; it runs in Drake's Simulator all the same.

    Args:
        system: The system.
        reason: Why not, as part of a sentence.
    """

    def __init__(self, system: System, reason: str):
        name = f"{type(system).__name__} {system.get_name()!r}"
        super().__init__(f"{name} cannot be compiled: {reason}")


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
    blocks = _Blocks(system, path)
    places = {block.GetSystemPathname(): i for i, (block, _) in enumerate(blocks)}
    inputs: list[dict[str, Source]] = [{} for _ in blocks]

    def Connect(system: System, sources: dict[int, Source]) -> None:
        """Follows the connections inside of a system.

        Args:
            sources: What its own input ports are connected to, by their indices.
        """
        if not isinstance(system, Diagram):
            inputs[places[system.GetSystemPathname()]].update(
                (system.get_input_port(i).get_name(), source)
                for i, source in sources.items()
            )
            return
        # By the subsystem's pathname and the index of its input port.
        inner: dict[str, dict[int, Source]] = {}
        for (target, i), (source, o) in system.connection_map().items():
            name, port = _OutputPort(source, int(o))
            inner.setdefault(target.GetSystemPathname(), {})[int(i)] = Source(
                places[name], port
            )
        for i, outer in sources.items():
            for target, j in system.GetInputPortLocators(InputPortIndex(i)):
                inner.setdefault(target.GetSystemPathname(), {})[int(j)] = outer
        for subsystem in system.GetSystems():
            Connect(subsystem, inner.get(subsystem.GetSystemPathname(), {}))

    Connect(system, {})
    return [
        Block(system=block, path=path, inputs=inputs[i])
        for i, (block, path) in enumerate(blocks)
    ]


def _Blocks(system: System, path: str) -> list[tuple[System, str]]:
    if not isinstance(system, Diagram):
        return [(system, path or system.get_name())]
    folder = f"{path}/" if path else ""
    return [
        block
        for subsystem in system.GetSystems()
        for block in _Blocks(subsystem, f"{folder}{subsystem.get_name()}")
    ]


def OutputOf(blocks: list[Block], system: System, index: int) -> Source:
    """Returns where an output of a system in the Diagram comes from.

    Args:
        blocks: Those of the Diagram, by Flatten().
        system: A block, or a Diagram in the Diagram.
    """
    pathname, port = _OutputPort(system, index)
    places = [block.system.GetSystemPathname() for block in blocks]
    return Source(places.index(pathname), port)


def _OutputPort(system: System, index: int) -> tuple[str, str]:
    """Returns the pathname of the block that an output comes from, and its port."""
    if not isinstance(system, Diagram):
        name = system.get_output_port(index).get_name()
        return system.GetSystemPathname(), name
    inner, i = system.get_output_port_locator(OutputPortIndex(index))
    return _OutputPort(inner, int(i))
