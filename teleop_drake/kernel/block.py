"""Blocks whose computation is described once, by a kernel."""

import itertools
import math
import re
import weakref
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.math import inv
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DependencyTicket,
    LeafSystem,
    LeafSystem_,
    WitnessFunction,
)

from teleop_drake.kernel.callbacks import Weakly
from teleop_drake.kernel.convertible import Convertible
from teleop_drake.kernel.delay_line import DelayLine
from teleop_drake.kernel.events import Events
from teleop_drake.kernel.kernel import Delay, Kernel, Law, Name, Part, Term
from teleop_drake.kernel.packet_line import PacketLine
from teleop_drake.kernel.parameters import BlockParameters
from teleop_drake.kernel.terms import WORDS, TermReader
from teleop_drake.kernel.ticks import EndStep, Ticks
from teleop_drake.validation import Choices, Refuse

_Value = Callable[[Context], Any]


class _Rated:
    """The time derivatives of a block whose kernel has a rate."""

    _kernel_rate: _Value | None = None

    def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
        """Evaluates the rate; called by Drake several times in every step."""
        if self._kernel_rate is not None:
            derivatives.SetFromVector(self._kernel_rate(context))


class DualBlock(_Rated, LeafSystem_[AutoDiffXd]):
    """A block of AutoDiffXd with the ports, the state and the terms of another block.

    An output that the other block delays raises a ValueError when it is evaluated.

    Args:
        other: A block with a method Kernel(). Its events are left out.
    """

    is_compiled = False

    def __init__(self, other: Any):
        LeafSystem_[AutoDiffXd].__init__(self)
        kernel = other.Kernel()
        self.optional_inputs = getattr(other, "optional_inputs", ())
        for i in range(other.num_input_ports()):
            port = other.get_input_port(i)
            self.DeclareVectorInputPort(port.get_name(), port.size())
        context = other.CreateDefaultContext()
        if context.num_continuous_states():
            x = context.get_continuous_state()
            self.DeclareContinuousState(x.num_q(), x.num_v(), x.num_z())
        for i in range(context.num_discrete_state_groups()):
            self.DeclareDiscreteState(context.get_discrete_state(i).size())
        for i in range(context.num_abstract_states()):
            self.DeclareAbstractState(context.get_abstract_state(i))
        ports = [other.get_output_port(i) for i in range(other.num_output_ports())]
        units = getattr(other, "numeric_parameters", {})
        self.kernel_parameters = _MakeParameters(self, kernel, units)
        path = other.GetSystemPathname()
        lines = {delay.output: _NoDelayLine(self, path) for delay in kernel.delays}
        _DeclareTerms(self, kernel, {x.get_name(): x.size() for x in ports}, lines)


class _NoDelayLine:
    """The delayed output of a block of AutoDiffXd, which has no value.

    Attributes:
        tickets: What the output depends on.

    Args:
        block: The block.
        path: Path of the block that it was converted from.
    """

    def __init__(self, block: DualBlock, path: str):
        self.tickets = {block.nothing_ticket()}
        self._path = path

    def Eval(self, context: Context) -> Any:
        """Raises a ValueError that names the function which linearises a delay."""
        allowed = "cut: Drake linearises no delays, call teleop_drake.LinearizePorts()"
        Refuse(self._path, "a delay", allowed)


def _DeclareTerms(
    block: Any,
    kernel: Kernel,
    sizes: Mapping[str, int],
    lines: Mapping[str, DelayLine | PacketLine | _NoDelayLine],
) -> None:
    """Declares the output ports of a block, and the rate of its state."""

    def Reader(place: str) -> _Reader:
        return _Reader(block, kernel, place, is_compiled=block.is_compiled)

    values = {}
    tickets = {}
    for output, term in kernel.outputs.items():
        reader = Reader(f"outputs.{output}")
        values[output] = reader.Read(term)
        tickets[output] = reader.tickets or {block.nothing_ticket()}
    for output, line in lines.items():
        values[output] = line.Eval
        tickets[output] = line.tickets
    block._kernel_outputs = {port: _Callback(block, values[port]) for port in sizes}
    for port, size in sizes.items():
        callback = Weakly(block._kernel_outputs[port])
        block.DeclareVectorOutputPort(port, size, callback, tickets[port])
    if kernel.rate is not None:
        block._kernel_rate = Reader("rate").Read(kernel.rate)


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


def _NotingEvents(cls: type["KernelBlock"]) -> type["KernelBlock"]:
    """Makes a class of blocks record each event declared outside of its kernel."""
    names = [x for x in dir(LeafSystem) if re.fullmatch("DeclarePer.*Event", x)]
    for name in names:
        setattr(cls, name, _Noting(name))
    return cls


def _Noting(name: str) -> Callable[..., Any]:
    """Returns the method of LeafSystem with a name, extended to record its calls."""
    declare = getattr(LeafSystem, name)

    def Declare(block: "KernelBlock", *arguments: Any, **options: Any) -> Any:
        if not block._is_declaring and EndStep not in arguments:
            block.other_events = (*block.other_events, name)
        return declare(block, *arguments, **options)

    Declare.__name__ = Declare.__qualname__ = name
    Declare.__doc__ = f"Declares what LeafSystem.{name}() does, and notes the call."

    return Declare


@_NotingEvents
class KernelBlock(_Rated, Convertible):
    """A block defined by its kernel: Drake's callbacks evaluate the terms of Kernel().

    A subclass declares its input ports and its state, sets the attributes that its
    Kernel() reads, and then calls DeclareOutputs(). The prerequisites of an output
    follow from its term.

    The block's events are made from the kernel's transitions; see Events. The mode is
    one vector, which the block has declared. Each delay has a state of its own; see
    DelayLine and PacketLine. A block with delays has no mode.

    Drake can convert the block to AutoDiffXd. It therefore linearises a diagram of such
    blocks with exact derivatives. The kernel's functions are then called with arrays of
    AutoDiffXd, which support the functions of NumPy but not those of `math`.

    Attributes:
        delays: The delay lines of the block, each with the samples under way.
        longest_step: The longest step in s that the solver may take.
        optional_inputs: Names of the inputs that are zero as long as nothing is
            connected to them and they have no value.
        is_compiled: Whether the outputs and the rate call the kernel's functions as
            machine code where that is installed. It pays for functions that take more
            than a few microseconds.
        other_events: The declarations of periodic and per-step events besides those
            of the kernel. A block with such events runs in Drake's Simulator only.
        kernel_parameters: The parameters of the kernel in Drake's Contexts.
        numeric_parameters: The units of the numbers that a Context can change, by the
            names of parameters of the kernel or of fields of them.
        element_names: Names of the elements of a parameter that is an array, by the
            name of the parameter.
    """

    dual = DualBlock
    other_events: tuple[str, ...] = ()
    _is_declaring = False
    delays: tuple[DelayLine | PacketLine, ...] = ()
    longest_step = math.inf
    optional_inputs: tuple[str, ...] = ()
    is_compiled = False
    numeric_parameters: ClassVar[Mapping[str, str]] = {}
    element_names: Mapping[str, Sequence[str]] = MappingProxyType({})

    @abstractmethod
    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""

    def DeclareOutputs(self, **sizes: int) -> None:
        """Declares the output ports, the rate of the state, and the events.

        Args:
            sizes: Width of each port by its name, in the order of the ports.
        """
        self._is_declaring = True
        self._watching: weakref.WeakKeyDictionary[Any, Callable[[Any], None]]
        self._watching = weakref.WeakKeyDictionary()
        kernel = self.Kernel()
        self.kernel_parameters = _MakeParameters(self, kernel, self.numeric_parameters)
        lines: dict[str, DelayLine | PacketLine] = {}
        for delay in kernel.delays:
            is_packets = delay.shown is not None
            line = PacketLine if is_packets else DelayLine
            lines[delay.output] = line(self, delay, _DelayName(kernel, delay))
        self.delays = tuple(lines.values())
        _DeclareTerms(self, kernel, sizes, lines)

        def Read(term: Term, place: str) -> _Value:
            return _Reader(self, kernel, place, is_compiled=False).Read(term)

        self._kernel_events = Events(self, kernel, Read)
        self._is_declaring = False

    def WatchRates(self, simulator: Any, look: Callable[[Any], None]) -> None:
        """Has a function called before each evaluation of the time derivatives.

        Args:
            simulator: The Simulator whose steps are watched. It is not kept alive.
            look: Takes the Simulator; must not refer to it.
        """
        self._watching[simulator] = look

    def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
        """Evaluates the rate; called by Drake several times in every step."""
        for simulator, look in self._watching.items():
            look(simulator)
        super().DoCalcTimeDerivatives(context, derivatives)

    def IsUnderWay(self, context: Context) -> bool:
        """Returns whether a delay of the block has anything to deliver."""
        return any(line.IsUnderWay(context) for line in self.delays)

    def LongestStep(self, context: Context) -> float:
        """Returns the longest step in s that the solver may take; infinity: any."""
        steps = [line.LongestStep(context) for line in self.delays]
        return min(steps, default=self.longest_step)

    def NextJumpTime(self, context: Context) -> float:
        """Returns when a sampled or delayed signal jumps next, s; infinity: never.

        A step that ends at this very time is not disturbed by the jump.
        """
        times = [line.NextJumpTime(context) for line in self.delays]
        times += [x.After(context.get_time()) for x in self._kernel_events.ticks]
        return min(times, default=math.inf)

    @property
    def has_guards(self) -> bool:
        """Whether a transition of the kernel has a guard."""
        return self._kernel_events.has_guards

    @property
    def ticks(self) -> Sequence[Ticks]:
        """The instants of the periodic transitions that are not discrete updates."""
        return self._kernel_events.ticks

    @property
    def discrete_ticks(self) -> Sequence[Ticks]:
        """The instants of the kernel's periodic discrete updates."""
        return self._kernel_events.discrete_ticks

    def DoGetWitnessFunctions(self, context: Context) -> list[WitnessFunction]:
        """Returns the guards of the transitions, if events are to be located."""
        return self._kernel_events.Witnesses(context)


def KernelIn(block: KernelBlock, context: Context) -> Kernel:
    """Returns a block's kernel with the parameter values of one of its Contexts."""
    kernel = block.Kernel()
    values = block.kernel_parameters.In(context).values
    delays = []
    for delay in kernel.delays:
        time = values.get(_DelayName(kernel, delay), delay.time)
        delays.append(replace(delay, time=time))
    parameters = {name: values[name] for name in kernel.parameters}
    return replace(kernel, parameters=parameters, delays=delays)


def _DelayName(kernel: Kernel, delay: Delay) -> str:
    """Returns the name of the numeric parameter that stands for a constant delay."""
    return "delay" if len(kernel.delays) == 1 else f"delay.{delay.output}"


def _MakeParameters(
    block: Any, kernel: Kernel, units: Mapping[str, str]
) -> BlockParameters:
    """Declares a block's numeric parameters: those with a unit, and constant delays."""
    delays = _DefaultDelays(kernel)
    return BlockParameters(
        block,
        replace(kernel, parameters={**kernel.parameters, **delays}),
        {**units, **dict.fromkeys(delays, "s")},
    )


def _DefaultDelays(kernel: Kernel) -> dict[str, float]:
    """Returns the constant delays of a kernel in s by the names of their parameters."""
    return {
        _DelayName(kernel, delay): delay.time
        for delay in kernel.delays
        if delay.shown is None and not callable(delay.time)
    }


class FixedBlock(KernelBlock):
    """A block whose ports and kernel are given to its constructor.

    Args:
        inputs: Width of each input port by its name, in the order of the ports.
        outputs: Width of each output port by its name, in the order of the ports.
        state: The initial continuous state.
    """

    def __init__(
        self,
        name: str,
        kernel: Kernel,
        *,
        inputs: Mapping[str, int],
        outputs: Mapping[str, int],
        state: ArrayLike = (),
    ):
        KernelBlock.__init__(self)
        self.set_name(name)
        self._kernel = kernel
        for port, size in inputs.items():
            self.DeclareVectorInputPort(port, size)
        if np.size(state):
            self.DeclareContinuousState(BasicVector(np.array(state, dtype=float)))
        self.DeclareOutputs(**outputs)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        return self._kernel


def _Callback(block: Any, value: _Value) -> Callable[[Context, BasicVector], None]:
    """Returns a callback that calculates an output port; its errors name the block."""
    of = weakref.ref(block)

    def SetOutput(context: Context, output: BasicVector, block: Any = of) -> None:
        output.SetFromVector(value(context))

    return SetOutput


def _ModeOf(context: Context) -> Any:
    return context.get_discrete_state_vector().CopyToVector()


def _ValuesOfMode(context: Any) -> Any:
    """Returns the mode without derivatives, because a mode selects a law."""
    return ExtractValue(_ModeOf(context)).ravel()


def _CallOfValues(law: Law, arguments: Sequence[_Value]) -> _Value:
    """Returns the function of a Context that calls a law with values of that Context.

    Laws of one and two arguments are handled separately, which makes a run some per
    cent faster.
    """
    if len(arguments) == 1:
        (only,) = arguments
        return lambda context: law(only(context))
    if len(arguments) == 2:
        first, second = arguments
        return lambda context: law(first(context), second(context))
    return lambda context: law(*[argument(context) for argument in arguments])


class _Reader(TermReader[_Value]):
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
        self._place = place
        self._is_compiled = is_compiled
        self.tickets: set[DependencyTicket] = set()

    def Number(self, number: int) -> _Value:
        return lambda context: number

    def Joined(self, parts: list[_Value]) -> _Value:
        return lambda context: np.concatenate([part(context) for part in parts])

    def Part(self, whole: _Value, part: Part) -> _Value:
        elements = slice(*part[1:])
        return lambda context: whole(context)[elements]

    def Call(self, law: Law, arguments: Sequence[Name | int]) -> _Value:
        """Returns the call of a law, whose leading parameters are read as constants."""
        parameters = self.kernel.parameters
        names: Any = tuple(itertools.takewhile(parameters.__contains__, arguments))
        others = [self.Read(argument) for argument in arguments[len(names) :]]
        if not names and not self._is_compiled:
            return _CallOfValues(law, others)
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

    def Word(self, word: str) -> _Value:
        """Returns the time, the state or the mode, and adds its ticket."""
        block = self._block
        if word == "time":
            self.tickets.add(block.time_ticket())
            return lambda context: context.get_time()
        if word == "state":
            self.tickets.add(block.xc_ticket())
            return self._Dual(lambda x: x.get_continuous_state_vector().CopyToVector())
        self.tickets.add(block.xd_ticket())
        mode = _ValuesOfMode if isinstance(block, DualBlock) else _ModeOf
        if self.kernel.initial_mode is None:
            return mode
        self.tickets.add(block.accuracy_ticket())
        reader = _Reader(block, self.kernel, "initial_mode", is_compiled=False)
        initial = reader.Read(self.kernel.initial_mode)
        self.tickets |= reader.tickets
        return lambda x: initial(x) if x.get_accuracy() is None else mode(x)

    def _Dual(self, value: _Value) -> _Value:
        if isinstance(self._block, DualBlock):
            return lambda context: value(context).view(Duals)
        return value

    def Parameter(self, name: str, value: Any) -> _Value:
        numbers_in = self._block.kernel_parameters.In
        self.tickets.add(self._block.kernel_parameters.ticket)
        return lambda context: numbers_in(context).values[name]

    def Rate(self, term: Term) -> _Value:
        return self.Read(term)

    def Port(self, name: str) -> _Value:
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
