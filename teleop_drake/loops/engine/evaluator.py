"""A diagram as one function of its time, states and signals, interpreted or compiled.

It is the function `evaluate` of a program; see teleop_drake.loops.engine.program.
"""

import copy
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from pydrake.systems.framework import (
    Context,
    OutputPort,
    PortDataType,
    System,
)

from teleop_drake.loops.engine.block_events import CheckEvents
from teleop_drake.loops.engine.block_kernels import IsReadable, KernelOf, ReadLeaf
from teleop_drake.loops.engine.constants import ConstantValues
from teleop_drake.loops.engine.flatten import (
    Block,
    Flatten,
    Source,
    UnreadableLeaf,
    UnsupportedSystem,
)
from teleop_drake.loops.engine.known_programs import KnownFunction, Remember
from teleop_drake.loops.engine.left_out import EmptyKernel, FindLeftOut
from teleop_drake.loops.engine.primitives import IsSilent
from teleop_drake.loops.engine.program import Program
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import ContextsIn, DiscreteState
from teleop_drake.loops.framework.signals import (
    IsOfDrake,
    IsPlainLeaf,
    IsPlant,
    SignalsOf,
)
from teleop_drake.loops.jit.native import Evaluate, Kept, Library
from teleop_drake.loops.jit.scalar_code import ALL, MakeCode
from teleop_drake.loops.kernel import Kernel

if TYPE_CHECKING:
    from teleop_drake.loops.engine.leaf_tracing import LeafReader
    from teleop_drake.loops.engine.plant_limits import JointLimits


def pass_at_zero(delay: float, delayed: Array, signal: Array) -> Array:
    """Returns the output of a delay: the signal itself if the delay is 0 s."""
    passed: Array = np.where(delay > 0.0, delayed, signal)
    return passed


def PassAtZero(system: Any, kernel: Kernel) -> Kernel:
    """Returns a block's kernel, extended so that its constant delays may be 0 s.

    In a program, the output of a delay is given, so a signal may depend on itself
    through a delay. In the extended kernel, the output is computed by pass_at_zero()
    from the delayed signal and the signal, so the signal must not depend on it. The
    extended kernel serves all values of a delay, including 0. A block whose kernel has
    no delay because it is 0 s has a method ZeroDelay().
    """
    delays = list(kernel.delays)
    if not delays and hasattr(system, "ZeroDelay"):
        delays.append(system.ZeroDelay())
    outputs: dict[str, Any] = dict(kernel.outputs)
    parameters = dict(kernel.parameters)
    for k, delay in enumerate(delays):
        if not delay.is_constant:
            continue
        time = f"time of {delay.output}"
        under_way = f"{delay.output} under way"
        parameters[time] = delay.time
        outputs[delay.output] = pass_at_zero, time, under_way, delay.signal
        delays[k] = replace(delay, output=under_way)
    return replace(kernel, outputs=outputs, parameters=parameters, delays=delays)


def IsDelayed(kernel: Kernel, output: str) -> bool:
    """Returns whether an output comes from a delay, see also PassAtZero()."""
    term = kernel.outputs.get(output)
    is_passed = isinstance(term, tuple) and term[0] is pass_at_zero
    return is_passed or output in [delay.output for delay in kernel.delays]


class Inserted(Protocol):
    """Blocks on connections of a diagram that are not part of it.

    Attributes:
        contexts: The Context of each of these blocks, which have no states.
    """

    @property
    def contexts(self) -> dict[System, Context]:
        """See above."""
        ...

    def Insert(self, blocks: list[Block]) -> list[Block]:
        """Returns the blocks of the diagram and, behind them, the others."""
        ...


class Evaluator:
    """Evaluates the time derivatives and the outputs of a diagram, without Drake.

    Args:
        system: The diagram, or a single block.
        context: The Context of `system`, with the values of the parameters.
        as_machine_code: Whether to compile the program.
        like: An Evaluator whose machine code is reused if it is the same.
        has_zero_delays: Whether every constant delay may be 0 in the program.
            Otherwise, only the delays of a block that has a delay of 0 in `context`.
        recorded: The output ports of the recorded signals; None: those of SignalsOf().
        needs_states: Whether a block of Drake's with a state must have a kernel even if
            no recorded signal depends on it.
        inserted: Blocks on connections of the diagram that are not part of it.
        ignores_limits: Whether the caller compares runs with `limits`.

    Attributes:
        system: The diagram.
        blocks: The blocks of the diagram.
        program: The program of the diagram.
        function: The function `evaluate`: Program.Evaluate() or its machine code.
        left_out: The paths of the blocks without effect, such as logs and visualizers;
            see FindLeftOut().
        limits: The limits of the joints of discrete plants, by the index of the plant.
        read: The paths of the blocks that a user wrote in Python without a kernel, and
            whose functions were followed.

    Raises:
        UnsupportedSystem: If a block cannot be compiled; the message names it.
        AlgebraicLoop: If a signal depends on itself, for example through a delay of
            0 s.
    """

    def __init__(
        self,
        system: System,
        context: Context,
        *,
        as_machine_code: bool = False,
        like: "Evaluator | None" = None,
        has_zero_delays: bool = False,
        recorded: Iterable[OutputPort] | None = None,
        needs_states: bool = True,
        inserted: "Inserted | None" = None,
        ignores_limits: bool = False,
    ):
        self.blocks = Flatten(system)
        self._added: dict[System, Context] = {}
        if inserted is not None:
            self.blocks = inserted.Insert(self.blocks)
            self._added = inserted.contexts
        self.system = system
        self._as_machine_code = as_machine_code
        self._has_zero_delays = has_zero_delays
        contexts = self.ContextsIn(context)
        # The kernels, with the parameter values of the blocks' Contexts.
        self._readers: dict[int, LeafReader] = {}
        kernels, obstacles = self._ReadKernels(contexts)
        self.read = [self.blocks[i].path for i in self._readers]
        self._left_out = FindLeftOut(
            self.blocks,
            contexts,
            obstacles,
            recorded=SignalsOf(system).values() if recorded is None else recorded,
            needs_states=needs_states,
        )
        has_own = any(IsPlainLeaf(block.system) for block in self.blocks)
        if has_own and len(self._left_out) == len(self.blocks):
            raise UnsupportedSystem(system, "nothing in it has a signal or a state")
        self._without_kernel = frozenset(obstacles)
        self.left_out = [self.blocks[i].path for i in sorted(self._left_out)]
        for i, block in enumerate(self.blocks):
            is_left_out = i in self._left_out
            own = contexts[block.system]
            # A user may have added an event to a block that is left out, too.
            if is_left_out and IsPlainLeaf(block.system):
                from teleop_drake.loops.engine.leaf_tracing import CheckSink

                CheckSink(block.system)
            elif i not in obstacles and not self._HasKnownEvents(i):
                CheckEvents(block.system, kernels[i], own, is_sink=is_left_out)
            if is_left_out:
                kernels[i] = EmptyKernel(block.system)
            kernels[i] = self._Extended(block.system, kernels[i])
        self.limits = self._ReadLimits()
        if self.limits and not ignores_limits:
            i, limits = next(iter(self.limits.items()))
            reason = f"it is discrete, and joint {limits.Limited()} has limits"
            raise UnsupportedSystem(self.blocks[i].system, reason)
        in_order = [kernels[i] for i, _ in enumerate(self.blocks)]
        self._SetProgram(Program(self.blocks, in_order), [like] if like else [])

    def With(
        self,
        context: Context,
        changed: Collection[System],
        kept: "Sequence[Evaluator]" = (),
        constants: ConstantValues = MappingProxyType({}),
        inserted: "Inserted | None" = None,
    ) -> "Evaluator":
        """Returns an evaluator with the numbers of another Context.

        Functions of a user's blocks without a kernel are followed anew.

        Args:
            context: The Context of `system`.
            changed: The blocks of which the numbers differ.
            kept: Further evaluators whose machine code is reused if it is the same.
            constants: Other values of constants of the blocks.
            inserted: The inserted blocks with other numbers.

        Raises:
            UnsupportedSystem: If a block cannot be compiled with its numbers.
            AlgebraicLoop: If a signal depends on itself, see Evaluator.
        """
        contexts = self.ContextsIn(context)
        if inserted is not None:
            contexts |= inserted.contexts
            changed = {*changed, *inserted.contexts}
        kernels = {}
        for i, block in enumerate(self.blocks):
            system = block.system
            if i in self._readers:
                own = constants.get(system)
                kernels[i] = ReadLeaf(self._readers[i], contexts[system], own)
            elif system in changed and i not in self._left_out:
                kernel = KernelOf(system, contexts[system], constants.get(system))
                kernels[i] = self._Extended(system, kernel)
        other = self._WithKernels(kernels)
        if other is None:
            other = copy.copy(self)
            in_order = [kernels.get(i, x) for i, x in enumerate(self.program.kernels)]
            other._SetProgram(Program(self.blocks, in_order), [self, *kept])
        if inserted is not None:
            other._added = inserted.contexts
        return other

    def Detached(self) -> "Evaluator":
        """Returns an evaluator without its systems; see AttachedTo()."""
        other = copy.copy(self)
        del other.system
        other.blocks = []
        other._added = {}
        other.program = self.program.WithBlocks([])
        return other

    def AttachedTo(self, system: System, context: Context) -> "Evaluator":
        """Returns a detached evaluator of machine code with its systems again.

        Args:
            system: The diagram from which it was detached, which has not changed.
            context: A Context with the same numbers.

        Raises:
            UnsupportedSystem: If a block has an event that its kernel does not have.
        """
        other = copy.copy(self)
        other.system = system
        other.blocks = Flatten(system)
        other.program = self.program.WithBlocks(other.blocks)
        contexts = ContextsIn(system, context)
        for i, block in enumerate(other.blocks):
            if i not in self._without_kernel:
                kernel = self.program.kernels[i]
                is_sink = i in self._left_out
                own = contexts[block.system]
                CheckEvents(block.system, kernel, own, is_sink=is_sink)
        return other

    def ContextsIn(self, context: Context) -> dict[System, Context]:
        """Returns the Contexts of the diagram's systems and of the inserted blocks."""
        return {**ContextsIn(self.system, context), **self._added}

    def _WithKernels(self, kernels: Mapping[int, Kernel]) -> "Evaluator | None":
        """Returns an evaluator with other kernels of some blocks, by their indices.

        Returns None if their numbers do not fit into the program.
        """
        in_order = [kernels.get(i, x) for i, x in enumerate(self.program.kernels)]
        program = self.program.With(in_order)
        if program is None:
            return None
        other = copy.copy(self)
        other.program = program
        if not self._as_machine_code:
            other.function = program.Evaluate
        return other

    def _Extended(self, system: System, kernel: Kernel) -> Kernel:
        """Returns a kernel whose delays may be 0, if they have to."""
        has_zero = any(delay.time == 0 for delay in kernel.delays)
        if self._has_zero_delays or has_zero:
            return PassAtZero(system, kernel)
        return kernel

    def _SetProgram(self, program: Program, kept: "Sequence[Evaluator]") -> None:
        """Sets the program, and its function, interpreted or compiled."""
        self.program = program
        self.function: Callable[..., Any] = program.Evaluate
        if not self._as_machine_code:
            return
        for other in kept:
            if program.HasCodeOf(other.program):
                self.function = other.function
                return
        known = None if self._readers else KnownFunction(program)
        if known is not None:
            self.function = known
            return
        code = MakeCode(program.Trace())
        self.function = Evaluate(Library(Kept("evaluate", code), "evaluate"))
        if not self._readers:
            Remember(program, self.function)

    def _ReadLimits(self) -> "dict[int, JointLimits]":
        """Returns the limits of the plants that are not left out."""
        found = {}
        for i, block in enumerate(self.blocks):
            if i in self._left_out or not IsPlant(block.system):
                continue
            from teleop_drake.loops.engine.plant_limits import LimitsOf

            limits = LimitsOf(block.system)
            if limits is not None:
                found[i] = limits
        return found

    def _HasKnownEvents(self, i: int) -> bool:
        """Returns whether the events of a block were found as its functions were."""
        return i in self._readers and not self._readers[i].is_symbolic

    def _ReadKernels(
        self, contexts: Mapping[System, Context]
    ) -> tuple[dict[int, Kernel], dict[int, UnsupportedSystem]]:
        """Returns the kernels of the blocks, or why one without effect has none."""
        kernels = {}
        obstacles = {}
        for i, block in enumerate(self.blocks):
            context = contexts[block.system]
            try:
                if IsReadable(block.system, context):
                    from teleop_drake.loops.engine.leaf_tracing import LeafReader

                    reader = LeafReader(block.system)
                    kernels[i] = ReadLeaf(reader, context)
                    self._readers[i] = reader
                else:
                    kernels[i] = KernelOf(block.system, context)
            except UnsupportedSystem as error:
                if not (IsOfDrake(block.system) or IsSilent(block.system, context)):
                    raise
                obstacles[i] = error
        if any(x.shown is None for kernel in kernels.values() for x in kernel.delays):
            self._CheckSources()
        return kernels, obstacles

    def _CheckSources(self) -> None:
        """Refuses users' functions of time that may jump before a delay.

        Drake's Simulator searches their jumps, which a delay has to deliver.
        """
        for reader in self._readers.values():
            if reader.may_jump:
                reason = "it is a function of time that may jump, and there is a delay"
                raise UnreadableLeaf(reader.system, reason)

    def CheckLimits(self, times: Array, rows: Array) -> None:
        """Refuses a run in which a joint of a discrete plant comes near to its limit.

        Args:
            times: The times of the rows, s (N).
            rows: The signals y in the rows (N, num_y).

        Raises:
            NearLimit: If one does.
        """
        for i, limits in self.limits.items():
            place = self.program.signals[Source(i, "state")]
            limits.Check(self.blocks[i].path, times, rows[:, place])

    def Evaluate(
        self, context: Context, delayed: Array | None = None
    ) -> tuple[Array, Array]:
        """Returns the signals and the time derivatives in a Context.

        Args:
            context: The Context of the diagram.
            delayed: Signals y, from which the outputs of the delays are copied. None:
                their initial values.

        Returns:
            y and dx; see `program`.
        """
        x, m, y = self.ReadContext(context)
        if delayed is not None:
            for _, _, part in self.program.delays:
                y[part] = delayed[part]
        dx = np.zeros(len(x))
        self.function(context.get_time(), x, m, self.program.p, y, dx, ALL)
        return y, dx

    def ReadContext(self, context: Context) -> tuple[Array, Array, Array]:
        """Returns the states and the given signals of a Context.

        Returns:
            x, m, and y with the values of inputs that are not connected and with the
            initial outputs of delays. The other signals are 0.
        """
        program = self.program
        contexts = self.ContextsIn(context)
        x = context.get_continuous_state_vector().CopyToVector()
        m = [
            DiscreteState(contexts[block.system])[: part.stop - part.start]
            for block, part in zip(self.blocks, program.modes, strict=True)
        ]
        y = np.zeros(program.sizes[0])
        for (i, name), part in program.fed.items():
            block = self.blocks[i]
            y[part] = _FedValue(block.system, name, contexts[block.system])
        for delay, _, part in program.delays:
            y[part] = delay.initial_value
        return x, np.concatenate(m), y


def _FedValue(system: System, name: str, context: Context) -> Array:
    """Returns the value of an input that is not connected inside of the diagram.

    Raises:
        UnsupportedSystem: If the input has no value and is not optional.
    """
    port = system.GetInputPort(name)
    if port.HasValue(context) and port.get_data_type() == PortDataType.kVectorValued:
        return port.Eval(context)
    # All inputs of a plant are optional: no actuation, no applied force.
    optional = getattr(system, "optional_inputs", ())
    if IsPlant(system) or name in optional:
        return np.zeros(port.size())
    raise UnsupportedSystem(system, f"its input {name} is not connected")
