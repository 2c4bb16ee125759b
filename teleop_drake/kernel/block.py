"""Blocks that say once what they compute."""

import functools
import itertools
import math
import weakref
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
    WitnessFunction,
)

from teleop_drake.kernel.delay_line import DelayLine
from teleop_drake.kernel.events import Events
from teleop_drake.kernel.kernel import Kernel, Law, Name, Part, Term
from teleop_drake.kernel.packet_line import PacketLine
from teleop_drake.kernel.terms import WORDS, TermReader
from teleop_drake.machine_code.compiled import CompileLaw
from teleop_drake.validation import Choices, Refuse

_Value = Callable[[Context], Any]


class KernelBlock(LeafSystem):
    """A block that is its kernel: Drake's callbacks evaluate the terms of Kernel().

    A subclass declares its input ports and its state, sets what its Kernel() takes, and
    then calls DeclareOutputs(). What an output depends on follows from its term.

    Events are made of the transitions; see Events. The mode is one vector, which the
    block has declared. Delays have a state of their own, see DelayLine and
    PacketLine; a block that has some has no mode.

    Attributes:
        delays: What is under way.
        longest_step: No step of the solver may be longer, s.
        optional_inputs: Names of the inputs that are zero as long as nothing is
            connected to them and they have no value.
        is_compiled: Whether the outputs and the rate call the kernel's functions as
            machine code where that is installed: worth its while for those that take
            more than a few microseconds.
    """

    optional_inputs: tuple[str, ...] = ()
    is_compiled = False
    delays: tuple[DelayLine | PacketLine, ...] = ()
    longest_step = math.inf
    _kernel_rate: _Value | None = None

    @abstractmethod
    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""

    def DeclareOutputs(self, **sizes: int) -> None:
        """Declares the output ports, the rate of the state, and the events.

        Args:
            sizes: Width of each port by its name, in the order of the ports.
        """
        kernel, is_compiled = self.Kernel(), self.is_compiled
        self._kernel_outputs: dict[str, _Value] = {}
        tickets = {}
        for name, term in kernel.outputs.items():
            reader = _Reader(self, kernel, f"outputs.{name}", is_compiled=is_compiled)
            self._kernel_outputs[name] = reader.Read(term)
            tickets[name] = reader.tickets or {self.nothing_ticket()}
        lines = {
            delay.output: (PacketLine if delay.shown else DelayLine)(self, delay)
            for delay in kernel.delays
        }
        for name, line in lines.items():
            self._kernel_outputs[name], tickets[name] = line.Eval, line.tickets
        self.delays = tuple(lines.values())
        self.longest_step = min(
            (line.longest_step for line in self.delays), default=self.longest_step
        )
        for name, size in sizes.items():
            callback = _Callback(self, name)
            self.DeclareVectorOutputPort(name, size, callback, tickets[name])
        if kernel.rate is not None:
            reader = _Reader(self, kernel, "rate", is_compiled=is_compiled)
            self._kernel_rate = reader.Read(kernel.rate)

        def Read(term: Term, place: str) -> _Value:
            return _Reader(self, kernel, place, is_compiled=False).Read(term)

        self._kernel_events = Events(self, kernel, Read)

    def NextJumpTime(self, context: Context) -> float:
        """Returns when a sample or what is delayed will jump next, s; infinity: never.

        A step that ends at this very time is not disturbed by the jump.

        Args:
            context: The Context of this block.
        """
        times = [line.NextJumpTime(context) for line in self.delays]
        times += [x.After(context.get_time()) for x in self._kernel_events.ticks]
        return min(times, default=math.inf)

    def DoGetWitnessFunctions(self, context: Context) -> list[WitnessFunction]:
        """Returns the guards of the transitions, if events are to be located."""
        return self._kernel_events.Witnesses(context)

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the rate; called by Drake several times in every step."""
        if self._kernel_rate is not None:
            derivatives.SetFromVector(self._kernel_rate(context))


def _Callback(block: KernelBlock, name: str) -> Callable[[Context, BasicVector], None]:
    """Returns what Drake calls for a port, which does not keep the block alive."""
    reference = weakref.ref(block)

    def Calc(context: Context, output: BasicVector) -> None:
        alive = reference()
        assert alive is not None
        output.SetFromVector(alive._kernel_outputs[name](context))

    return Calc


def _ModeOf(context: Context) -> Any:
    return context.get_discrete_state_vector().CopyToVector()


class _Reader(TermReader[_Value]):
    """Makes functions of a Context of terms.

    Attributes:
        tickets: What the values depend on.

    Args:
        block: Whose kernel it is.
        kernel: The kernel.
        place: Where the terms stand in the kernel, for messages.
        is_compiled: Whether to call functions as machine code.
    """

    def __init__(
        self, block: KernelBlock, kernel: Kernel, place: str, *, is_compiled: bool
    ):
        super().__init__(kernel)
        self._block, self._place, self._is_compiled = block, place, is_compiled
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
        bound = law
        if self._is_compiled:
            bound = CompileLaw(law, *constants)
        elif constants:
            bound = functools.partial(law, *constants)
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
        if self.kernel.initial_mode is None:
            return _ModeOf
        self.tickets.add(block.accuracy_ticket())
        reader = _Reader(block, self.kernel, "initial_mode", is_compiled=False)
        initial = reader.Read(self.kernel.initial_mode)
        self.tickets |= reader.tickets
        return lambda x: initial(x) if x.get_accuracy() is None else _ModeOf(x)

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
            owner = block.get_name() or type(block).__name__
            Refuse(f"{owner}: {self._place}", name, Choices(name, names))
        port = block.GetInputPort(name)
        self.tickets.add(port.ticket())
        evaluate: _Value = port.Eval
        if name not in block.optional_inputs:
            return evaluate
        has_value, nothing = port.HasValue, np.zeros(port.size())
        return lambda context: evaluate(context) if has_value(context) else nothing
