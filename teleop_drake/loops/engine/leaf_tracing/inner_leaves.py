"""A block that a user wrote in Python, which another such block has inside.

Its functions are followed like those of the outer block, and belong to one graph with
them. Its time, state and inputs are those that the outer block sets in this call.
"""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context, InputPort

from teleop_drake.loops.engine.leaf_tracing.block_stand_ins import OwnInput, OwnOutput
from teleop_drake.loops.engine.leaf_tracing.inner_systems import TIME, InnerContext
from teleop_drake.loops.engine.leaf_tracing.reader import LeafReader
from teleop_drake.loops.engine.leaf_tracing.stand_ins import Copied
from teleop_drake.loops.jit.symbolic_arrays import AsNumbers, Objects
from teleop_drake.loops.jit.symbols import Untraceable


class _Input(OwnInput):
    """An input port of the inner block; the outer block fixes its value."""

    def FixValue(self, context: InnerContext, value: Any) -> None:
        context.others[self.get_index()] = Objects(value).ravel()

    def HasValue(self, context: Any) -> bool:
        is_set = self.get_index() in self._reader.inside.others
        return is_set or OwnInput.HasValue(self, context)


class _Output(OwnOutput):
    """An output port of the inner block; the outer block evaluates it."""

    def Eval(self, context: Any) -> Any:
        if type(context) is InnerContext:
            return self._reader.InlineIn(context, self._port)
        return OwnOutput.Eval(self, context)


class InnerReader(LeafReader):
    """Follows the functions of a block that another block has inside.

    Attributes:
        inside: The Context in which the outer block evaluates it.

    Args:
        system: The inner block.
        outer: The reader of the outer block.
        memory: As for InnerContext.
    """

    def __init__(self, system: Any, outer: LeafReader, memory: dict[Context, Any]):
        LeafReader.__init__(self, system)
        self._outer = outer
        self._memory = memory
        self.inside: Any = None

    def Port(self, port: Any) -> Any:
        return (_Input if isinstance(port, InputPort) else _Output)(self, port)

    def InlineIn(self, context: InnerContext, port: Any) -> Any:
        """Returns the value of an output in a Context of the inner block."""
        self.inside = context
        self._Use(context.original)
        return self.Inline(port)

    def Load(self, name: str) -> Any:
        context = self.inside
        if name in self._parameters:
            return AsNumbers(self._parameters[name])
        if name == "state":
            context.CheckIsSet()
            return Copied(context.state)
        if name == "mode" and self.num_modes == 0:
            return np.zeros(0)
        if name == "time" and TIME not in context.others:
            return self._outer.Unset("the time of a block inside")
        key = TIME
        if name.startswith("input "):
            port = self.system.GetInputPort(name.removeprefix("input "))
            key = int(port.get_index())
        if name == "mode" or key not in context.others:
            raise Untraceable(f"it does not set the {name} of a block inside")
        return AsNumbers(Objects(context.others[key]).ravel())
