"""Blocks of Drake whose callbacks and events are made from a kernel."""

import functools
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
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import (
    BasicVector,
    Context,
    LeafSystem,
    LeafSystem_,
    System,
    SystemScalarConverter,
    WitnessFunction,
)

from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.validation import Range, Refuse
from teleop_drake.loops.kernel.delay_line import DelayLine
from teleop_drake.loops.kernel.events import EndStep, EventBlock, Weakly
from teleop_drake.loops.kernel.kernel import Delay, Kernel
from teleop_drake.loops.kernel.packet_line import PacketLine
from teleop_drake.loops.kernel.parameters import BlockParameters
from teleop_drake.loops.kernel.steered_line import SteeredLine
from teleop_drake.loops.kernel.terms import ContextReader, ValueIn


class _Rated:
    """A base class with the time derivatives of a block whose kernel has a rate."""

    _kernel_rate: ValueIn | None = None

    def CheckParameters(self, values: Mapping[str, Any]) -> None:
        """Refuses parameters that are not allowed together.

        Each parameter by itself is within its range, see KernelBlock.

        Args:
            values: The parameters of the kernel by their names.

        Raises:
            ScenarioError: Naming a parameter, its value and what is allowed.
        """

    def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
        """Evaluates the rate; called by Drake several times in every step."""
        if self._kernel_rate is not None:
            derivatives.SetFromVector(self._kernel_rate(context))


class DualBlock(_Rated, LeafSystem_[AutoDiffXd]):
    """The AutoDiffXd version of a block: its ports, state and terms, but no events.

    A delayed output raises a ValueError when it is evaluated.

    Args:
        other: The block of float, which has a method Kernel().
    """

    is_compiled = False

    def __init__(self, other: Any):
        LeafSystem_[AutoDiffXd].__init__(self)
        kernel = other.Kernel()
        self.has_fixed_delays = getattr(other, "has_fixed_delays", False)
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
        ranges = getattr(other, "numeric_parameters", {})
        self.kernel_parameters = _MakeParameters(self, kernel, ranges)
        path = other.GetSystemPathname()

        def RefuseDelay(context: Context) -> Any:
            Refuse(
                path,
                "a delay",
                "cut: Drake linearises no delays, call teleop_drake.LinearizePorts()",
            )

        nothing = {self.nothing_ticket()}
        delayed = {x.output: (RefuseDelay, nothing) for x in kernel.delays}
        _DeclareTerms(self, kernel, {x.get_name(): x.size() for x in ports}, delayed)


def _DeclareTerms(
    block: Any,
    kernel: Kernel,
    sizes: Mapping[str, int],
    delayed: Mapping[str, tuple[ValueIn, Any]],
) -> None:
    """Declares the output ports of a block, and the rate of its state.

    Args:
        sizes: The width of each output port by its name, in the order of the ports.
        delayed: The functions that evaluate the delayed outputs, and their
            prerequisites, by the names of the outputs.
    """
    outputs = dict(delayed)
    for output, term in kernel.outputs.items():
        reader = ContextReader(block, kernel, f"outputs.{output}")
        value = reader.Read(term)
        outputs[output] = value, reader.tickets or {block.nothing_ticket()}
    block._kernel_outputs = []
    for port, size in sizes.items():
        value, tickets = outputs[port]
        callback = _Callback(block, value)
        block._kernel_outputs.append(callback)
        block.DeclareVectorOutputPort(port, size, Weakly(callback), tickets)
    if kernel.rate is not None:
        block._kernel_rate = ContextReader(block, kernel, "rate").Read(kernel.rate)


def _Convert(block: "KernelBlock") -> DualBlock:
    dual = DualBlock(block)
    dual.set_name(block.get_name())
    return dual


# pydrake's TemplateSystem serves the same purpose. It inspects the call stack for each
# class that it makes, which takes up to half a second when a program starts.
_CONVERTER = SystemScalarConverter()
_CONVERTER._AddConstructor[AutoDiffXd, float](_Convert)


class KernelBlock(_Rated, EventBlock):
    """A block defined by its kernel: Drake's callbacks evaluate the terms of Kernel().

    A subclass declares its input ports and its state, sets the attributes that its
    Kernel() reads, and then calls DeclareOutputs(). The prerequisites of an output
    follow from its term.

    The block's events are made from the kernel's transitions; see EventBlock. The mode
    is one vector, which the block has declared. Each delay has a state of its own; see
    DelayLine and PacketLine. A block with delays has no mode.

    Drake can convert the block to AutoDiffXd. It therefore linearises a diagram of such
    blocks with exact derivatives. The kernel's functions are then called with arrays of
    AutoDiffXd, which support the functions of NumPy but not those of `math`.

    Attributes:
        delays: The delay lines of the block; their samples are in its Contexts.
        longest_step: The longest step in s that the solver may take.
        optional_inputs: Names of the inputs that are zero as long as nothing is
            connected to them and they have no value.
        is_compiled: Whether Drake's callbacks call the kernel's functions as machine
            code. It pays for functions that take more than a few microseconds.
        other_events: The declarations of periodic and per-step events besides those
            of the kernel. A block with such events runs in Drake's Simulator only.
        kernel_parameters: The parameters of the kernel in Drake's Contexts.
        numeric_parameters: The ranges, or only the units, of the numbers that a Context
            can change, by the names of parameters of the kernel or of fields of them.
        has_fixed_delays: Whether the block's constant delays are no numeric parameters.
        element_names: Names of the elements of a parameter that is an array, by the
            name of the parameter.
    """

    other_events: tuple[str, ...] = ()
    _is_declaring = False
    delays: tuple[DelayLine | PacketLine, ...] = ()
    longest_step = math.inf
    optional_inputs: tuple[str, ...] = ()
    is_compiled = False
    numeric_parameters: ClassVar[Mapping[str, Range | str]] = {}
    has_fixed_delays = False
    element_names: Mapping[str, Sequence[str]] = MappingProxyType({})

    def __init__(self) -> None:
        LeafSystem.__init__(self, converter=_CONVERTER)

    def ToAutoDiffXd(self) -> DualBlock:
        """Returns the block of AutoDiffXd as an instance of its Python class."""
        dual = _Convert(self)
        dual._HandlePostConstructionScalarConversion[float](self)
        return dual

    ToAutoDiffXdMaybe = ToAutoDiffXd

    @abstractmethod
    def Kernel(self) -> Kernel:
        """Returns the description of the block's computation."""

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
            line = _LineOf(delay)
            lines[delay.output] = line(self, delay, _DelayName(kernel, delay))
        self.delays = tuple(lines.values())
        delayed = {output: (x.Eval, x.tickets) for output, x in lines.items()}
        _DeclareTerms(self, kernel, sizes, delayed)
        self._DeclareEvents(kernel)
        self._is_declaring = False

    def WatchRates(self, simulator: Any, look: Callable[[Any], None]) -> None:
        """Registers a function to call before each evaluation of the time derivatives.

        Args:
            simulator: The Simulator, to which only a weak reference is stored.
            look: The function, whose argument is the Simulator. It must not hold a
                reference to the Simulator.
        """
        self._watching[simulator] = look

    def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
        """Evaluates the rate; called by Drake several times in every step."""
        for simulator, look in self._watching.items():
            look(simulator)
        super().DoCalcTimeDerivatives(context, derivatives)

    def DoGetWitnessFunctions(self, context: Context) -> list[WitnessFunction]:
        """Returns the guards; called by Drake at the start of a step, after updates."""
        for line in self.delays:
            line.BeginStep(context)
        return super().DoGetWitnessFunctions(context)

    def LongestStep(self, context: Context) -> float:
        """Returns the longest step in s that the solver may take; infinity: any."""
        steps = [line.LongestStep(context) for line in self.delays]
        return min(steps, default=self.longest_step)

    def NextJumpTime(self, context: Context) -> float:
        """Returns when a sampled or delayed signal jumps next, s; infinity: never.

        A step that ends at this very time uses the values before the jump.
        """
        times = [line.NextJumpTime(context) for line in self.delays]
        times += [x.After(context.get_time()) for x in self.ticks]
        return min(times, default=math.inf)


def LongestStep(diagram: System, context: Context, *, of_delays: bool = True) -> float:
    """Returns the longest step in s that a diagram's systems allow, or infinity.

    Args:
        context: The Context of the diagram, which has the lengths of delays.
        of_delays: Whether blocks with delays are considered.
    """
    steps = [
        LongestStepOf(system, own)
        for system, own in ContextsIn(diagram, context).items()
        if of_delays or not getattr(system, "delays", ())
    ]
    return min(steps, default=math.inf)


def LongestStepOf(system: System, context: Context) -> float:
    """Returns the longest step in s that one system allows, or infinity.

    Args:
        context: The Context of the system.
    """
    if isinstance(system, KernelBlock):
        return system.LongestStep(context)
    return getattr(system, "longest_step", math.inf)


def _LineOf(delay: Delay) -> type[DelayLine] | type[PacketLine]:
    """Returns the class that implements a delay in Drake."""
    if delay.shown is not None:
        return PacketLine
    return SteeredLine if isinstance(delay.time, str) else DelayLine


def _Noting(declare: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a method of LeafSystem, extended to record its calls."""

    @functools.wraps(declare, assigned=("__name__",))
    def Declare(block: KernelBlock, *arguments: Any, **options: Any) -> Any:
        """Calls the method, and records the call unless the kernel causes it."""
        if not block._is_declaring and EndStep not in arguments:
            block.other_events = (*block.other_events, declare.__name__)
        return declare(block, *arguments, **options)

    return Declare


# A KernelBlock records each event that is declared outside of its kernel.
for _name in dir(LeafSystem):
    if re.fullmatch("DeclarePer.*Event", _name):
        setattr(KernelBlock, _name, _Noting(getattr(LeafSystem, _name)))


def KernelIn(block: KernelBlock, context: Context) -> Kernel:
    """Returns a block's kernel with the parameter values of one of its Contexts."""
    kernel = block.Kernel()
    values = block.kernel_parameters.In(context).values
    delays = [
        replace(delay, time=values.get(_DelayName(kernel, delay), delay.time))
        for delay in kernel.delays
    ]
    parameters = {name: values[name] for name in kernel.parameters}
    return replace(kernel, parameters=parameters, delays=delays)


def _DelayName(kernel: Kernel, delay: Delay) -> str:
    """Returns the name of the numeric parameter that stands for a constant delay."""
    return "delay" if len(kernel.delays) == 1 else f"delay.{delay.output}"


def _MakeParameters(
    block: Any, kernel: Kernel, ranges: Mapping[str, Range | str]
) -> BlockParameters:
    """Declares a block's numeric parameters: those with a range, and its delays."""
    delays = {
        _DelayName(kernel, delay): delay.time
        for delay in kernel.delays
        if delay.is_constant
        if not block.has_fixed_delays
    }
    return BlockParameters(
        block,
        replace(kernel, parameters={**kernel.parameters, **delays}),
        {**ranges, **dict.fromkeys(delays, Range("s", minimum=0))},
    )


class FixedBlock(KernelBlock):
    """A block whose ports and kernel are given to its constructor.

    Args:
        name: Name of the block; empty: the diagram gives it one.
        inputs: Width of each input port by its name, in the order of the ports.
        outputs: Width of each output port by its name, in the order of the ports.
        state: The initial continuous state.
        mode: The initial discrete state.
    """

    def __init__(
        self,
        name: str,
        kernel: Kernel,
        *,
        inputs: Mapping[str, int],
        outputs: Mapping[str, int],
        state: ArrayLike = (),
        mode: ArrayLike = (),
    ):
        KernelBlock.__init__(self)
        self.set_name(name)
        self._kernel = kernel
        for port, size in inputs.items():
            self.DeclareVectorInputPort(port, size)
        if np.size(state):
            self.DeclareContinuousState(BasicVector(np.array(state, dtype=float)))
        if np.size(mode):
            self.DeclareDiscreteState(BasicVector(np.array(mode, dtype=float)))
        self.DeclareOutputs(**outputs)

    def Kernel(self) -> Kernel:
        """Returns the kernel that was given."""
        return self._kernel


def _Callback(block: Any, value: ValueIn) -> Callable[[Context, BasicVector], None]:
    """Returns a callback that calculates an output port.

    Its argument `block` is unused: simulation/failures.py finds it in the traceback of
    an error, whose message can then name the block.
    """
    of = weakref.ref(block)

    def SetOutput(context: Context, output: BasicVector, block: Any = of) -> None:
        output.SetFromVector(value(context))

    return SetOutput
