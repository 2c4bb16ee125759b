"""Blocks that say once what they compute."""

import functools
import itertools
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    DependencyTicket,
    LeafSystem,
)

from teleop_drake.kernel.callbacks import Weakly
from teleop_drake.kernel.kernel import Kernel, Law, Name, Part, Term
from teleop_drake.kernel.terms import WORDS, TermReader
from teleop_drake.machine_code.compiled import CompileLaw
from teleop_drake.validation import Choices, Refuse

_Value = Callable[[Context], Any]


class KernelBlock(LeafSystem):
    """A block that is its kernel: Drake's callbacks evaluate the terms of Kernel().

    A subclass declares its input ports and its state, sets what its Kernel() takes, and
    then calls DeclareOutputs(). What an output depends on follows from its term.

    Events are not made of transitions and delays: a block that has some declares them
    itself.

    Attributes:
        optional_inputs: Names of the inputs that are zero as long as nothing is
            connected to them and they have no value.
        is_compiled: Whether Drake's callbacks call the kernel's functions as machine
            code where that is installed: worth its while for those that take more than
            a few microseconds.
    """

    optional_inputs: tuple[str, ...] = ()
    is_compiled = False
    _kernel_rate: _Value | None = None

    @abstractmethod
    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""

    def DeclareOutputs(self, **sizes: int) -> None:
        """Declares the output ports, and the rate of the state.

        Args:
            sizes: Width of each port by its name, in the order of the ports.
        """
        kernel = self.Kernel()
        name = self.get_name() or type(self).__name__
        values, tickets = {}, {}
        for output, term in kernel.outputs.items():
            reader = _Reader(self, kernel, f"{name}: outputs.{output}")
            values[output], tickets[output] = reader.Read(term), reader.tickets
        for port, size in sizes.items():
            depends_on = tickets[port] or {self.nothing_ticket()}
            calc = _Callback(values[port])
            self.DeclareVectorOutputPort(port, size, calc, depends_on)
        # Drake's callbacks do not keep them alive.
        self._kernel_outputs = values
        if kernel.rate is not None:
            self._kernel_rate = _Reader(self, kernel, f"{name}: rate").Read(kernel.rate)

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the rate; called by Drake several times in every step."""
        if self._kernel_rate is not None:
            derivatives.SetFromVector(self._kernel_rate(context))


def _Callback(value: _Value) -> Callable[[Context, BasicVector], None]:
    """Returns what Drake calls for a port, which does not keep the block alive."""
    evaluate = Weakly(value)
    return lambda context, output: output.SetFromVector(evaluate(context))


class _Reader(TermReader[_Value]):
    """Makes functions of a Context of terms.

    Attributes:
        tickets: What the values depend on.

    Args:
        block: Whose kernel it is.
        kernel: The kernel.
        place: Where the terms stand in the kernel, for messages.
    """

    def __init__(self, block: KernelBlock, kernel: Kernel, place: str):
        super().__init__(kernel)
        self._block, self._place = block, place
        self.tickets: set[DependencyTicket] = set()

    def Number(self, number: int) -> _Value:
        return lambda context: number

    def Joined(self, parts: list[_Value]) -> _Value:
        return lambda context: np.concatenate([part(context) for part in parts])

    def Part(self, whole: _Value, part: Part) -> _Value:
        elements = slice(*part[1:])
        return lambda context: whole(context)[elements]

    def Call(self, law: Law, arguments: Sequence[Name | int]) -> _Value:
        parameters = self.kernel.parameters
        names = list(itertools.takewhile(parameters.__contains__, arguments))
        constants = [parameters[name] for name in names]  # type: ignore[index]
        bind = CompileLaw if self._block.is_compiled else functools.partial
        bound = bind(law, *constants) if constants or self._block.is_compiled else law
        others = [self.Read(argument) for argument in arguments[len(names) :]]
        if len(others) == 1:  # Short ways, which make a loop some per cent faster.
            (first,) = others
            return lambda context: bound(first(context))
        if len(others) == 2:
            first, second = others
            return lambda context: bound(first(context), second(context))
        return lambda context: bound(*[other(context) for other in others])

    def Word(self, word: str) -> _Value:
        block = self._block
        if word == "time":
            self.tickets.add(block.time_ticket())
            return lambda context: context.get_time()
        if word == "state":
            self.tickets.add(block.xc_ticket())
            return lambda x: x.get_continuous_state_vector().CopyToVector()
        self.tickets.add(block.xd_ticket())
        return lambda context: context.get_discrete_state_vector().CopyToVector()

    def Parameter(self, name: str, value: Any) -> _Value:
        return lambda context: value

    def Rate(self, term: Term) -> _Value:
        return self.Read(term)

    def Port(self, name: str) -> _Value:
        block = self._block
        if not block.HasInputPort(name):
            outputs = self.kernel.outputs
            if name in outputs:
                return self.Read(outputs[name])
            inputs = [
                block.get_input_port(i).get_name()
                for i in range(block.num_input_ports())
            ]
            names = [*inputs, *outputs, *self.kernel.parameters, *WORDS]
            Refuse(self._place, name, Choices(name, names))
        port = block.GetInputPort(name)
        self.tickets.add(port.ticket())
        evaluate: _Value = port.Eval
        if name not in block.optional_inputs:
            return evaluate
        has_value, nothing = port.HasValue, np.zeros(port.size())
        return lambda context: evaluate(context) if has_value(context) else nothing
