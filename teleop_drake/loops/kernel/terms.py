"""Translates the terms of kernels into functions that evaluate them.

The argument of such a function is a Context of the block, for Drake's callbacks, or the
Arrays of a program, for compiled runs.
"""

import itertools
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.math import inv
from pydrake.systems.framework import Context, DependencyTicket, LeafSystem_

from teleop_drake.loops.framework.validation import Choices, Refuse
from teleop_drake.loops.kernel.kernel import Kernel, Law, Name, Term

WORDS = ("time", "state", "mode")
"""The names that a term of any kernel may use."""

ValueIn = Callable[[Any], Any]
"""A function that evaluates a term in a Context of its block or on Arrays."""


class TermReader:
    """Translates terms; a subclass translates the names and the calls in them."""

    @abstractmethod
    def Named(self, name: str) -> ValueIn:
        """Returns the function that evaluates a named vector; refuses unknown names."""

    @abstractmethod
    def Input(self, name: str) -> ValueIn:
        """Returns the function that evaluates an input port."""

    @abstractmethod
    def Call(self, law: Law, arguments: Sequence[Name | int]) -> ValueIn:
        """Returns the function that evaluates a law and its arguments."""

    def Read(self, term: Term | int) -> ValueIn:
        """Returns the function that evaluates a term."""
        if isinstance(term, str):
            return self.Named(term)
        if isinstance(term, int):
            return lambda _: term
        if isinstance(term, list):
            vectors = [self.Read(name) for name in term]
            if not vectors:
                return lambda _: np.empty(0)
            return lambda place: np.concatenate([vector(place) for vector in vectors])
        first, *others = term
        if callable(first):
            return self.Call(first, others)  # type: ignore[arg-type]
        if first == "input" and len(others) == 1:
            return self.Input(str(others[0]))
        whole = self.Read(first)
        elements = slice(*others)
        return lambda place: whole(place)[elements]


class Duals(np.ndarray):
    """An array of AutoDiffXd that NumPy can invert."""

    __array_priority__ = 1.0

    def __array_function__(
        self, function: Any, types: Any, arguments: Any, options: Any
    ) -> Any:
        """Calls a function of NumPy; inv() and solve() use Drake's inverse."""
        if function in (np.linalg.inv, np.linalg.solve):
            matrix, *others = (np.asarray(x) for x in arguments)
            inverse = np.linalg.inv if matrix.dtype == float else inv
            result = inverse(matrix)
            for other in others:
                result = result @ other
            return result.view(Duals)
        return super().__array_function__(function, types, arguments, options)

    def __array_wrap__(self, array: Any, *others: Any) -> Any:
        """Returns an array without axes as a number, and other arrays as Duals."""
        return array.item() if array.ndim == 0 else array.view(Duals)


def _ModeOf(context: Context) -> Any:
    return context.get_discrete_state_vector().CopyToVector()


def _ValuesOfMode(context: Any) -> Any:
    """Returns the mode without derivatives, because a mode selects a law."""
    return ExtractValue(_ModeOf(context)).ravel()


class ContextReader(TermReader):
    """Translates terms into functions of a Context.

    Attributes:
        tickets: The prerequisites of the values.

    Args:
        block: The block that the kernel describes.
        kernel: The kernel.
        place: The position of the terms in the kernel, for messages.
    """

    def __init__(self, block: Any, kernel: Kernel, place: str):
        self._block = block
        self._kernel = kernel
        self._is_dual = isinstance(block, LeafSystem_[AutoDiffXd])
        self._place = place
        self.tickets: set[DependencyTicket] = set()

    def Call(self, law: Law, arguments: Sequence[Name | int]) -> ValueIn:
        """Returns the function that evaluates a law.

        Leading arguments that are parameters become constants of the law, once for each
        set of their values; see Numbers.Bound().
        """
        parameters = self._kernel.parameters
        names: Any = tuple(itertools.takewhile(parameters.__contains__, arguments))
        others = [self.Read(argument) for argument in arguments[len(names) :]]
        is_compiled = self._block.is_compiled
        if not names and not is_compiled:
            return lambda context: law(*[other(context) for other in others])
        self.tickets.add(self._block.kernel_parameters.ticket)
        numbers_in = self._block.kernel_parameters.In
        return lambda context: numbers_in(context).Bound(law, names, is_compiled)(
            *[other(context) for other in others]
        )

    def Named(self, name: str) -> ValueIn:
        """Returns the function that evaluates a named vector, and adds its tickets."""
        block = self._block
        kernel = self._kernel
        if name == "time":
            self.tickets.add(block.time_ticket())
            return lambda context: context.get_time()
        if name == "state":
            self.tickets.add(block.xc_ticket())
            return self._Dual(lambda x: x.get_continuous_state_vector().CopyToVector())
        if name == "mode":
            return self._Mode()
        if name in kernel.parameters:
            numbers_in = block.kernel_parameters.In
            self.tickets.add(block.kernel_parameters.ticket)
            return lambda context: numbers_in(context).values[name]
        if name == "rate" and kernel.rate is not None:
            return self.Read(kernel.rate)
        if block.HasInputPort(name):
            return self.Input(name)
        if name not in kernel.outputs:
            ports = map(block.get_input_port, range(block.num_input_ports()))
            inputs = [port.get_name() for port in ports]
            names = [*inputs, *kernel.outputs, *kernel.parameters, *WORDS]
            owner = block.get_name() or type(block).__name__
            Refuse(f"{owner}: {self._place}", name, Choices(name, names))
        return self.Read(kernel.outputs[name])

    def _Mode(self) -> ValueIn:
        block = self._block
        self.tickets.add(block.xd_ticket())
        mode = _ValuesOfMode if self._is_dual else _ModeOf
        if self._kernel.initial_mode is None:
            return mode
        self.tickets.add(block.accuracy_ticket())
        initial = self.Read(self._kernel.initial_mode)
        return lambda x: initial(x) if x.get_accuracy() is None else mode(x)

    def Input(self, name: str) -> ValueIn:
        """Returns the function that evaluates an input port, and adds its ticket."""
        port = self._block.GetInputPort(name)
        self.tickets.add(port.ticket())
        evaluate = self._Dual(lambda context: port.Eval(context))
        if name not in self._block.optional_inputs:
            return evaluate
        has_value = port.HasValue
        nothing = np.zeros(port.size())
        return lambda context: evaluate(context) if has_value(context) else nothing

    def _Dual(self, value: ValueIn) -> ValueIn:
        if self._is_dual:
            return lambda context: value(context).view(Duals)
        return value
