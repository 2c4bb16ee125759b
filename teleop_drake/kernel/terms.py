"""Readers of the terms of kernels, for Drake's callbacks and for compiled programs."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.math import inv
from pydrake.systems.framework import Context, DependencyTicket, LeafSystem_

from teleop_drake.kernel.kernel import Kernel, Law, Name, Part, Term
from teleop_drake.validation import Choices, Refuse

T = TypeVar("T")

WORDS = ("time", "state", "mode")
"""The names that a term of any kernel may use."""


class TermReader(Generic[T]):
    """Translates terms; a subclass has a method for each kind of part of a term.

    Attributes:
        names: All names that were read.
        Number: Translates an integer.
        Joined: Translates vectors one after another.
        Part: Translates some elements of a vector.
        Call: Translates the call of a function.
        Word: Translates the time, the state or the mode.
        Parameter: Translates a parameter.
        Port: Translates an input port or another output; raises an error if there is
            none of that name.

    Args:
        kernel: The kernel to which the terms belong.
    """

    Number: Callable[[int], T]
    Joined: Callable[[list[T]], T]
    Part: Callable[[T, Part], T]
    Call: Callable[[Law, Sequence[Name | int]], T]
    Word: Callable[[str], T]
    Parameter: Callable[[str, Any], T]
    Port: Callable[[str], T]

    def __init__(self, kernel: Kernel):
        self.kernel = kernel
        self.names: set[str] = set()

    def Read(self, term: Term | int) -> T:
        """Returns the translation of a term."""
        if isinstance(term, str):
            return self._Named(term)
        if isinstance(term, int):
            return self.Number(term)
        if isinstance(term, list):
            return self.Joined([self.Read(name) for name in term])
        first, *others = term
        if callable(first):
            return self.Call(first, others)  # type: ignore[arg-type]
        return self.Part(self._Named(term[0]), term)  # type: ignore[arg-type]

    def Rate(self, term: Term) -> T:
        """Returns the translation of the rate of the state."""
        return self.Read(term)

    def _Named(self, name: str) -> T:
        self.names.add(name)
        kernel = self.kernel
        if name in WORDS:
            return self.Word(name)
        if name in kernel.parameters:
            return self.Parameter(name, kernel.parameters[name])
        if name == "rate" and kernel.rate is not None:
            return self.Rate(kernel.rate)
        return self.Port(name)


ValueIn = Callable[[Context], Any]
"""Returns the value of a term in a Context of its block."""


class Duals(np.ndarray):
    """An array of AutoDiffXd that NumPy can invert."""

    __array_priority__ = 1.0

    def __array_function__(
        self, function: Any, types: Any, arguments: Any, options: Any
    ) -> Any:
        """Calls a function of NumPy, or Drake's inverse for its inverses."""
        if function in (np.linalg.inv, np.linalg.solve):
            matrix, *others = (np.asarray(x) for x in arguments)
            inverse = np.linalg.inv if matrix.dtype == float else inv
            result = inverse(matrix)
            for other in others:
                result = result @ other
            return result.view(Duals)
        return super().__array_function__(function, types, arguments, options)

    def __array_wrap__(self, array: Any, *others: Any) -> Any:
        """Returns numbers as such: NumPy would keep them as arrays without axes."""
        return array.item() if array.ndim == 0 else array.view(Duals)


def _ModeOf(context: Context) -> Any:
    return context.get_discrete_state_vector().CopyToVector()


def _ValuesOfMode(context: Any) -> Any:
    """Returns the mode without derivatives, because a mode selects a law."""
    return ExtractValue(_ModeOf(context)).ravel()


class ContextReader(TermReader[ValueIn]):
    """Translates terms into functions of a Context.

    Attributes:
        tickets: The prerequisites of the values.

    Args:
        block: The block that the kernel describes.
        kernel: The kernel.
        place: The position of the terms in the kernel, for messages.
        is_compiled: Whether to call functions as machine code.
    """

    def __init__(self, block: Any, kernel: Kernel, place: str, *, is_compiled: bool):
        super().__init__(kernel)
        self._block = block
        self._is_dual = isinstance(block, LeafSystem_[AutoDiffXd])
        self._place = place
        self._is_compiled = is_compiled
        self.tickets: set[DependencyTicket] = set()

    def Number(self, number: int) -> ValueIn:
        """Returns an integer."""
        return lambda context: number

    def Joined(self, parts: list[ValueIn]) -> ValueIn:
        """Returns vectors one after another."""
        return lambda context: np.concatenate([part(context) for part in parts])

    def Part(self, whole: ValueIn, part: Part) -> ValueIn:
        """Returns some elements of a vector."""
        elements = slice(*part[1:])
        return lambda context: whole(context)[elements]

    def Call(self, law: Law, arguments: Sequence[Name | int]) -> ValueIn:
        """Returns the call of a law, whose leading parameters are read as constants."""
        parameters = self.kernel.parameters
        names: Any = tuple(itertools.takewhile(parameters.__contains__, arguments))
        others = [self.Read(argument) for argument in arguments[len(names) :]]
        if not names and not self._is_compiled:
            return lambda context: law(*[other(context) for other in others])
        self.tickets.add(self._block.kernel_parameters.ticket)
        numbers_in = self._block.kernel_parameters.In
        if self._is_compiled:
            return lambda context: numbers_in(context).Compiled(law, names)(
                *[other(context) for other in others]
            )

        def CallWithNumbers(context: Context) -> Any:
            values = numbers_in(context).values
            constants = [values[name] for name in names]
            return law(*constants, *[other(context) for other in others])

        return CallWithNumbers

    def Word(self, word: str) -> ValueIn:
        """Returns the time, the state or the mode, and adds its ticket."""
        block = self._block
        if word == "time":
            self.tickets.add(block.time_ticket())
            return lambda context: context.get_time()
        if word == "state":
            self.tickets.add(block.xc_ticket())
            return self._Dual(lambda x: x.get_continuous_state_vector().CopyToVector())
        self.tickets.add(block.xd_ticket())
        mode = _ValuesOfMode if self._is_dual else _ModeOf
        if self.kernel.initial_mode is None:
            return mode
        self.tickets.add(block.accuracy_ticket())
        reader = ContextReader(block, self.kernel, "initial_mode", is_compiled=False)
        initial = reader.Read(self.kernel.initial_mode)
        self.tickets |= reader.tickets
        return lambda x: initial(x) if x.get_accuracy() is None else mode(x)

    def _Dual(self, value: ValueIn) -> ValueIn:
        if self._is_dual:
            return lambda context: value(context).view(Duals)
        return value

    def Parameter(self, name: str, value: Any) -> ValueIn:
        """Returns a parameter with its value in the Context."""
        numbers_in = self._block.kernel_parameters.In
        self.tickets.add(self._block.kernel_parameters.ticket)
        return lambda context: numbers_in(context).values[name]

    def Port(self, name: str) -> ValueIn:
        """Returns an input port's value or another output's term; refuses others."""
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
            owner = block.get_name() or type(block).__name__
            Refuse(f"{owner}: {self._place}", name, Choices(name, names))
        port = block.GetInputPort(name)
        self.tickets.add(port.ticket())
        evaluate = self._Dual(lambda context: port.Eval(context))
        if name not in block.optional_inputs:
            return evaluate
        has_value = port.HasValue
        nothing = np.zeros(port.size())
        return lambda context: evaluate(context) if has_value(context) else nothing
