"""Blocks that say once what they compute."""

import functools
import itertools
import weakref
from abc import abstractmethod
from collections.abc import Callable
from types import CodeType
from typing import Any, cast

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    DependencyTicket,
    LeafSystem,
)

from teleop_drake.kernel.kernel import Kernel, Term
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
        self._kernel_outputs: list[_Value] = []
        for name, size in sizes.items():
            tickets: set[DependencyTicket] = set()
            value = _ValueOf(kernel.outputs[name], self, kernel, tickets)
            self._kernel_outputs.append(value)
            self.DeclareVectorOutputPort(name, size, _Callback(value), tickets)
        if kernel.rate is not None:
            self._kernel_rate = _ValueOf(kernel.rate, self, kernel, set())

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the rate; called by Drake several times in every step."""
        if self._kernel_rate is not None:
            derivatives.SetFromVector(self._kernel_rate(context))


def _Callback(value: _Value) -> Callable[[Context, BasicVector], None]:
    """Returns what Drake calls for a port, which does not keep the block alive."""
    reference = weakref.ref(value)

    def Calc(context: Context, output: BasicVector) -> None:
        evaluate = reference()
        assert evaluate is not None
        output.SetFromVector(evaluate(context))

    return Calc


def _ValueOf(
    term: Term, block: KernelBlock, kernel: Kernel, tickets: set[DependencyTicket]
) -> _Value:
    """Returns a function that evaluates a term; adds what the term depends on.

    It is one expression: functions that call each other made the derivatives of a whole
    loop a tenth slower.
    """
    writer = _Writer(block, kernel, tickets)
    value: _Value = eval(_CodeOf(writer.Text(term)), writer.names)
    return value


@functools.cache
def _CodeOf(text: str) -> CodeType:
    """Returns a function of the context that returns an expression, to be evaluated."""
    return compile(f"lambda context: {text}", "<kernel>", "eval")


class _Writer:
    """Writes terms as expressions of Python.

    Attributes:
        names: What the expressions call and take, by its name there.
    """

    def __init__(
        self, block: KernelBlock, kernel: Kernel, tickets: set[DependencyTicket]
    ):
        self._block, self._kernel, self._tickets = block, kernel, tickets
        self.names: dict[str, Any] = {}

    def Text(self, term: Term | int) -> str:
        """Returns a term as an expression."""
        if isinstance(term, int):
            return repr(term)
        if isinstance(term, str):
            return self._TextOfName(term)
        if isinstance(term, list):
            parts = "".join(f"{self.Text(name)}, " for name in term)
            return f"{self._Name(np.concatenate)}(({parts}))"
        first, *others = cast(tuple[Any, ...], term)
        if isinstance(first, str):
            return "{}[{}:{}]".format(self.Text(first), *others)
        function = first
        if self._block.is_compiled:
            parameters = self._kernel.parameters
            names = list(itertools.takewhile(parameters.__contains__, others))
            function = CompileLaw(first, *(parameters[name] for name in names))
            others = others[len(names) :]
        return f"{self._Name(function)}({', '.join(map(self.Text, others))})"

    def _Name(self, value: Any) -> str:
        name = f"x{len(self.names)}"
        self.names[name] = value
        return name

    def _TextOfName(self, name: str) -> str:
        block, kernel = self._block, self._kernel
        for word, ticket, text in (
            ("time", block.time_ticket, "get_time()"),
            ("state", block.xc_ticket, "get_continuous_state_vector().CopyToVector()"),
            ("mode", block.xd_ticket, "get_discrete_state_vector().CopyToVector()"),
        ):
            if name == word:
                self._tickets.add(ticket())
                return f"context.{text}"
        if name in kernel.parameters:
            return self._Name(kernel.parameters[name])
        if name == "rate" and kernel.rate is not None:
            return self.Text(kernel.rate)
        if name in kernel.outputs:
            return self.Text(kernel.outputs[name])
        port = block.GetInputPort(name)
        self._tickets.add(port.ticket())
        value = f"{self._Name(port.Eval)}(context)"
        if name not in block.optional_inputs:
            return value
        has_value = self._Name(port.HasValue)
        nothing = self._Name(np.zeros(port.size()))
        return f"({value} if {has_value}(context) else {nothing})"
