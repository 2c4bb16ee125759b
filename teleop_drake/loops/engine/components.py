"""The names of a signal's components: those that plants and vectors of Drake define.

A block that passes its input on, such as a delay, keeps the names. A signal without
names that leads to the motors of a plant has the names of the motors. A signal of one
component needs no name for it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
from pydrake.systems.framework import OutputPort, System
from pydrake.systems.primitives import (
    Demultiplexer,
    DiscreteTimeDelay,
    FirstOrderLowPassFilter,
    PassThrough,
    Saturation,
    ZeroOrderHold,
)

from teleop_drake.loops.engine.flatten import Block, Flatten, OutputOf, Source
from teleop_drake.loops.framework.signals import IsPlant
from teleop_drake.loops.kernel import KernelBlock

Names = Sequence[str]

_PASSING = (
    DiscreteTimeDelay,
    FirstOrderLowPassFilter,
    PassThrough,
    Saturation,
    ZeroOrderHold,
)


def ComponentsIn(
    diagram: System, signals: Mapping[str, OutputPort]
) -> dict[str, list[str]]:
    """Returns the names of the components of each signal that has such names.

    Args:
        diagram: The system of the ports.
        signals: Output ports, by the name of the signal.
    """
    finder = ComponentFinder(Flatten(diagram))
    names = {name: finder.Of(port) for name, port in signals.items()}
    return {name: list(x) for name, x in names.items() if x}


class ComponentFinder:
    """Finds the names of components in a diagram, given its blocks from Flatten()."""

    def __init__(self, blocks: Sequence[Block]):
        self._blocks = blocks
        self._known: dict[Source, Names] = {}
        self._motors: dict[Source, Names] = {}
        for block in blocks:
            if IsPlant(block.system):
                for port, source in block.inputs.items():
                    self._motors[source] = _OfPlant(block.system, port)

    def Of(self, port: OutputPort) -> Names:
        """Returns the names of an output's components; () if there are none."""
        source = OutputOf(self._blocks, port.get_system(), int(port.get_index()))
        return self.OfSource(source)

    def OfSource(self, source: Source) -> Names:
        """Returns the names of the components of a block's output."""
        if source not in self._known:
            self._known[source] = ()  # Where a loop of blocks passes its signal on.
            names = self._Find(source) or self._motors.get(source, ())
            size = self._blocks[source.block].system.GetOutputPort(source.port).size()
            self._known[source] = names if len(names) == size > 1 else ()
        return self._known[source]

    def OfInput(self, place: int, port: str) -> Names:
        """Returns the names of an input of the block at a place in the list."""
        block = self._blocks[place]
        own = _OfPlant(block.system, port) if IsPlant(block.system) else ()
        if own or port not in block.inputs:
            return own
        return self.OfSource(block.inputs[port])

    def _Find(self, source: Source) -> Names:
        """Returns the names that a block gives to its output, or passes on."""
        block = self._blocks[source.block]
        system: Any = block.system
        port = system.GetOutputPort(source.port)
        if IsPlant(system):
            return _OfPlant(system, source.port)
        if type(system).__module__ == "pydrake.examples":
            fields = FieldsOf(port.Allocate().get_value())
            return sorted(fields, key=fields.__getitem__)
        if isinstance(system, Demultiplexer):
            before = range(int(port.get_index()))
            begin = sum(system.get_output_port(i).size() for i in before)
            return self._Passed(block)[begin : begin + port.size()]
        if isinstance(system, KernelBlock):
            late = (x for x in system.Kernel().delays if x.output == source.port)
            inputs = [block.inputs.get(delay.signal) for delay in late]
            return self.OfSource(inputs[0]) if inputs and inputs[0] else ()
        return self._Passed(block) if isinstance(system, _PASSING) else ()

    def _Passed(self, block: Block) -> Names:
        """Returns the names of the only input of a block."""
        sources = [*block.inputs.values()]
        return self.OfSource(sources[0]) if len(sources) == 1 else ()


def _OfPlant(plant: Any, port: str) -> Names:
    """Returns the names of a port of a MultibodyPlant, without those of its models."""
    names: dict[str, Callable[..., list[str]]] = {
        "state": lambda *model: StateNamesOf(plant, *model),
        "desired_state": lambda *model: StateNamesOf(plant, *model),
        "generalized_acceleration": lambda *model: plant.GetVelocityNames(
            *model, add_model_instance_prefix=False, always_add_suffix=False
        ),
        "actuation": lambda *model: plant.GetActuatorNames(
            *model, add_model_instance_prefix=False
        ),
    }
    names["net_actuation"] = names["actuation"]
    names["applied_generalized_force"] = names["generalized_acceleration"]
    if port in names:
        return names[port]()
    for kind, read in names.items():
        model = port.removesuffix(f"_{kind}")
        if model != port and plant.HasModelInstanceNamed(model):
            return read(plant.GetModelInstanceByName(model))
    return ()


def StateNamesOf(plant: Any, *model: Any) -> list[str]:
    """Returns Drake's names of the states of a plant, or of one of its models.

    They have the name of their model before them if they would be equal without it.
    """
    names: list[str] = plant.GetStateNames(*model, add_model_instance_prefix=False)
    if len(set(names)) < len(names):
        return cast(list[str], plant.GetStateNames(*model))
    return names


def FieldsOf(vector: Any) -> dict[str, int]:
    """Returns the index of each named element in one of Drake's vectors.

    Such a vector has a method for each element, for example PendulumParams.set_mass().
    A call of the method on a copy of the vector shows which element it sets.
    """
    places = {}
    for method in dir(vector):
        name = method.removeprefix("set_")
        if name in (method, "value"):
            continue
        copy = vector.Clone()
        copy.SetFromVector(np.zeros(vector.size()))
        getattr(copy, method)(1.0)
        places[name] = int(np.argmax(copy.CopyToVector()))
    return places
