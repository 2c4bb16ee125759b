"""Small Diagrams from tables of their systems and connections."""

from itertools import pairwise

from pydrake.systems.framework import Diagram

from teleop_drake.loops.framework.wiring import Wire


def Wired(systems, connections, outputs=None, inputs=None):
    """Returns a Diagram of systems, which get their names in the table.

    Args:
        connections: The output that is connected to each input.
        outputs: The outputs that are exported, by their names in the Diagram.
        inputs: The inputs that an input of the Diagram feeds, with spaces between them.
    """
    for name, system in systems.items():
        system.set_name(name)
    return Wire(
        Diagram(),
        "",
        systems,
        inputs={name: places.split() for name, places in (inputs or {}).items()},
        connections=connections,
        outputs=outputs or {},
    )


def InSeries(*places):
    """Returns connections of places, each of which is fed by the one before it."""
    return {target: source for source, target in pairwise(places)}
