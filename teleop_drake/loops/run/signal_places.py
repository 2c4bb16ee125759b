"""Where the recorded signals are in the rows of a compiled run."""

from collections.abc import Mapping

from pydrake.systems.framework import OutputPort

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import OutputOf, UnsupportedSystem
from teleop_drake.loops.framework.signals import IsPlant


def UnknownSignals(
    evaluator: Evaluator, signals: Mapping[str, OutputPort]
) -> list[str]:
    """Returns the signals that are outputs of a plant and that its kernel lacks."""
    known = evaluator.program.signals
    return [
        name
        for name, port in signals.items()
        if IsPlant(port.get_system())
        and OutputOf(evaluator.blocks, port.get_system(), int(port.get_index()))
        not in known
    ]


def SignalPlaces(
    evaluator: Evaluator, signals: Mapping[str, OutputPort]
) -> dict[str, slice]:
    """Returns the columns of each signal in a row, by its name.

    Args:
        signals: The output port of each signal, by name.

    Raises:
        UnsupportedSystem: If the kernel of a block lacks one of the signals.
    """
    places = {}
    for name, port in signals.items():
        index = int(port.get_index())
        source = OutputOf(evaluator.blocks, port.get_system(), index)
        if source not in evaluator.program.signals:
            block = evaluator.blocks[source.block].system
            raise UnsupportedSystem(block, f"its kernel has no output {source.port}")
        places[name] = evaluator.program.signals[source]
    return places
