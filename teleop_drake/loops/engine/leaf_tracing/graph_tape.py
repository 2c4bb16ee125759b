"""Graphs of operations as tapes, whose constants are parameters."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from teleop_drake.loops.engine.expression_tape import Tape
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.jit.symbols import AsReal, Number, Ref
from teleop_drake.loops.jit.traced_numpy import OPERATIONS
from teleop_drake.loops.jit.tracing import Graph

_FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, usual) for usual, name in OPERATIONS.items()},
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide,
    "neg": np.negative, "fabs": np.absolute, "pow": np.power, "select": np.where,
    "lt": np.less, "le": np.less_equal, "gt": np.greater, "ge": np.greater_equal,
    "eq": np.equal, "ne": np.not_equal, "and": np.logical_and, "or": np.logical_or,
    "fmod": np.fmod, "hypot": np.hypot,
    "not": np.logical_not, "floor": np.floor, "ceil": np.ceil, "trunc": np.trunc,
}  # fmt: skip


def TapeOf(
    graph: Graph, results: Sequence[Any], sizes: Mapping[str, int]
) -> tuple[Tape, Array, list[str]]:
    """Returns the tape that computes some values of a graph.

    Args:
        graph: The graph.
        results: The values: Numbers of the graph, or plain numbers.
        sizes: The width of each given vector of the graph, by its name.

    Returns:
        The tape; its constants; and the names of the vectors that it takes.
    """
    values = [AsReal(x) for x in results]
    needed = _NeededBy(graph, [x.ref for x in values if isinstance(x, Number)])
    loads = [graph.nodes[p].arguments for p in needed if _IsLoad(graph, p)]
    names = [name for name in sizes if any(name == x for x, _ in loads)]
    ends = np.cumsum([0, *(sizes[name] for name in names)]).tolist()
    starts = dict(zip(names, ends, strict=False))
    rows: list[tuple[Any, ...]] = []
    constants: list[float] = []
    places: dict[int, int] = {}

    def Place(value: Any) -> int:
        if isinstance(value, Ref):
            return places[value.place]
        constants.append(float(value))
        return Row(None, len(constants) - 1)

    def Row(*row: Any) -> int:
        rows.append(row)
        return int(ends[-1]) + len(rows) - 1

    for p in sorted(needed):
        operation, arguments = graph.nodes[p]
        if _IsLoad(graph, p):
            places[p] = starts[arguments[0]] + arguments[1]
        else:
            operands = [Place(x) for x in arguments]
            places[p] = Row(_FUNCTIONS[operation], *operands)
    found = tuple(Place(x.ref if isinstance(x, Number) else x) for x in values)
    return Tape(tuple(rows), found), np.array(constants, float), names


def _IsLoad(graph: Graph, place: int) -> bool:
    return graph.nodes[place].operation == "load"


def _NeededBy(graph: Graph, refs: Sequence[Ref]) -> set[int]:
    """Returns the nodes on which some nodes of a graph depend, and these."""
    needed: set[int] = set()
    pending = [ref.place for ref in refs]
    while pending:
        place = pending.pop()
        if place not in needed:
            needed.add(place)
            arguments = graph.nodes[place].arguments
            pending += [x.place for x in arguments if isinstance(x, Ref)]
    return needed
