"""Blocks that say once what they compute."""

import itertools
import weakref
from abc import abstractmethod
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    DependencyTicket,
    LeafSystem,
)

from teleop_drake.kernel import Kernel, Term
from teleop_drake.machine_code.compiled import CompileLaw

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
        self._kernel_outputs: dict[str, _Value] = {}
        for name, size in sizes.items():
            tickets: set[DependencyTicket] = set()
            term = kernel.outputs[name]
            self._kernel_outputs[name] = _ValueOf(term, self, kernel, tickets)
            self.DeclareVectorOutputPort(name, size, self._Callback(name), tickets)
        if kernel.rate is not None:
            self._kernel_rate = _ValueOf(kernel.rate, self, kernel, set())

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the rate; called by Drake several times in every step."""
        if self._kernel_rate is not None:
            derivatives.SetFromVector(self._kernel_rate(context))

    def _Callback(self, name: str) -> Callable[[Context, BasicVector], None]:
        """Returns what Drake calls for a port, which does not keep the block alive."""
        reference = weakref.ref(self)

        def Calc(context: Context, output: BasicVector) -> None:
            block = reference()
            assert block is not None
            output.SetFromVector(block._kernel_outputs[name](context))

        return Calc


def _ValueOf(
    term: Term | int, block: KernelBlock, kernel: Kernel, tickets: set[DependencyTicket]
) -> _Value:
    """Returns a function that evaluates a term; adds what the term depends on."""
    if isinstance(term, int):
        return lambda context: term
    if isinstance(term, str):
        return _ValueOfName(term, block, kernel, tickets)
    if isinstance(term, list):
        parts = [_ValueOf(name, block, kernel, tickets) for name in term]
        return lambda context: np.concatenate([part(context) for part in parts])
    first, *others = cast(tuple[Any, ...], term)
    if isinstance(first, str):
        whole, part = _ValueOf(first, block, kernel, tickets), slice(*others)
        return lambda context: whole(context)[part]
    function = first
    if block.is_compiled:
        names = list(itertools.takewhile(kernel.parameters.__contains__, others))
        function = CompileLaw(first, *(kernel.parameters[name] for name in names))
        others = others[len(names) :]
    values = [_ValueOf(other, block, kernel, tickets) for other in others]
    return lambda context: function(*[value(context) for value in values])


def _ValueOfName(
    name: str, block: KernelBlock, kernel: Kernel, tickets: set[DependencyTicket]
) -> _Value:
    if name == "time":
        tickets.add(block.time_ticket())
        return lambda context: context.get_time()
    if name == "state":
        tickets.add(block.xc_ticket())
        return lambda context: context.get_continuous_state_vector().CopyToVector()
    if name == "mode":
        tickets.add(block.xd_ticket())
        return lambda context: context.get_discrete_state_vector().CopyToVector()
    if name in kernel.parameters:
        parameter = kernel.parameters[name]
        return lambda context: parameter
    if name == "rate" and kernel.rate is not None:
        return _ValueOf(kernel.rate, block, kernel, tickets)
    if name in kernel.outputs:
        return _ValueOf(kernel.outputs[name], block, kernel, tickets)
    port = block.GetInputPort(name)
    tickets.add(port.ticket())
    if name in block.optional_inputs:
        nothing = np.zeros(port.size())
        return lambda context: port.Eval(context) if port.HasValue(context) else nothing
    return lambda context: port.Eval(context)
