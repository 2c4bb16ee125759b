"""The program of a diagram: the terms of all its blocks, sorted by dependence.

A program is a function `evaluate(t, x, m, p, y, dx, wanted)` that writes two arrays:

* dx, the rate of the continuous state;
* y, the signals: the outputs of the blocks, and further results such as guards and new
  modes. According to `wanted`, it computes all of them, or only those on which the rate
  and the inputs of delays depend.

It takes the time t in s, the continuous state x, the discrete state m, and the floats p
among the parameters. Some elements of y are not computed but set by the caller: the
outputs of delays, and the inputs that are not connected inside of the diagram.

The terms are evaluated on arrays of floats. For compilation they are evaluated on
arrays of symbolic Numbers, which record the operations (jit).
"""

import copy
import itertools
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from teleop_drake.loops.engine.flatten import (
    AlgebraicLoop,
    Block,
    Source,
    UnsupportedSystem,
)
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.jit.packing import Layout, Parameters, repack
from teleop_drake.loops.jit.scalar_code import RATE, Arrays, ScalarProgram, TraceProgram
from teleop_drake.loops.jit.symbols import Untraceable
from teleop_drake.loops.kernel import Delay, Kernel, KernelBlock, Name, Term, Transition
from teleop_drake.loops.kernel.kernel import Law
from teleop_drake.loops.kernel.terms import WORDS, TermReader, ValueIn

# The name of a block's rate among its outputs; no port is named by such a phrase.
_RATE = "rate of the state"


class Program:
    """The sorted terms of a diagram, and the places of their values in its arrays.

    Args:
        blocks: The blocks of the diagram.
        kernels: The kernel of each block.

    Attributes:
        kernels: The kernel of each block.
        layouts: The places in p of each block's parameters, keyed by their names.
        p: The parameters that are floats.
        signals: The slice of y of each output, guard and new mode. The `port` of a
            guard or of a new mode is a phrase with the transition's name.
        fed: The slice of y of each input that is not connected, keyed by
            Source(block, input port).
        delays: Each delay, with the slices of y of its input signal and its output.
        controls: The slice of y of the signal that is the time of each delay; None: its
            time is no signal.
        transitions: Each transition, with the slices of y of its guard (None: periodic)
            and of its new mode, and the slice of m of the block's mode.
        states: The slice of x of each block's continuous state.
        modes: The slice of m of each block's discrete states.
        sizes: The lengths of y, x and m.

    Raises:
        UnsupportedSystem: If a term has an unknown name, if a kernel lacks a rate or an
            output that another block takes, or if a connected input is in no term.
        AlgebraicLoop: If a signal depends on itself.
    """

    def __init__(self, blocks: Sequence[Block], kernels: Sequence[Kernel]):
        self._blocks = blocks
        self.kernels = kernels
        parameters = Parameters()
        self.layouts = [
            {name: parameters.Add(value) for name, value in kernel.parameters.items()}
            for kernel in kernels
        ]
        self.p = np.array(parameters.numbers, np.float64)
        self.signals: dict[Source, slice] = {}
        self.fed: dict[Source, slice] = {}
        self.transitions: list[tuple[Transition, slice | None, slice, slice]] = []
        self.states = _Slices(block.system.num_continuous_states() for block in blocks)
        self.modes = _Slices(map(_NumModes, blocks, kernels))
        self._num_y = 0
        # The terms, and the functions that evaluate them in the order of computation.
        self._terms: dict[Source, Term] = {}
        self._values: dict[Source, ValueIn] = {}
        # The outputs whose terms are being read, each an argument of the one before.
        self._under_way: list[Source] = []
        # The name of the signal that is the time of a delay, by the delay's output.
        self._steered: dict[Source, str] = {}
        # The names that terms and delays of each block use: (block, port).
        self._taken: set[tuple[int, str]] = set()
        for i, kernel in enumerate(kernels):
            self._Declare(i, kernel)
        # First the rates, the inputs of delays, and all outputs on which they depend.
        for i in range(len(kernels)):
            self.Add(Source(i, _RATE))
        self.delays: list[tuple[Delay, slice, slice]] = [
            (delay, self.Slot(i, delay.signal), self.signals[Source(i, delay.output)])
            for i, kernel in enumerate(kernels)
            for delay in kernel.delays
        ]
        self.controls: list[slice | None] = [
            self.Slot(i, delay.time) if isinstance(delay.time, str) else None
            for i, kernel in enumerate(kernels)
            for delay in kernel.delays
        ]
        self._needed = list(self._values)
        # Then all other outputs, guards and new modes.
        for output in self._terms:
            self.Add(output)
        self._others = list(self._values)[len(self._needed) :]
        for i, block in enumerate(blocks):
            self._CheckInputs(i, block)
        self.sizes = self._num_y, self.states[-1].stop, self.modes[-1].stop

    @property
    def structure(self) -> list[Any]:
        """A description of the program without its floats and functions."""
        return [
            [(block.path, block.inputs) for block in self._blocks],
            [
                (output, term[1:] if _IsCall(term) else term)
                for output, term in self._terms.items()
            ],
            self.layouts,
            self.fed,
            [places for _, *places in self.delays],
            self.controls,
            [self.states, self.modes, self.sizes],
        ]

    @property
    def laws(self) -> list[Any]:
        """The functions that the terms call, in the order of the terms."""
        return [term[0] for term in self._terms.values() if _IsCall(term)]

    def HasCodeOf(self, other: "Program") -> bool:
        """Returns whether another program has the same code; its floats may differ."""
        return self.laws == other.laws and self.structure == other.structure

    def With(self, kernels: Sequence[Kernel]) -> "Program | None":
        """Returns this program with the numbers of other kernels of its blocks.

        Returns:
            The program, which has the same code; None if the kernels have other terms,
            or numbers that differ in a place of p that they share.
        """
        pairs = list(zip(self.kernels, kernels, strict=True))
        if not all(a is b or _HasTermsOf(a, b) for a, b in pairs):
            return None
        layouts: list[Layout] = []
        values: list[Any] = []
        for own, kernel in zip(self.layouts, kernels, strict=True):
            layouts += own.values()
            values += [kernel.parameters[name] for name in own]
        p = repack(layouts, values, len(self.p))
        if p is None:
            return None
        other = copy.copy(self)
        other.kernels = kernels
        other.p = p
        delays = [delay for kernel in kernels for delay in kernel.delays]
        steps = [x for kernel in kernels for x in kernel.transitions.values()]
        other.delays = [
            (delay, signal, output)
            for delay, (_, signal, output) in zip(delays, self.delays, strict=True)
        ]
        other.transitions = [
            (step, guard, source, target)
            for step, (_, guard, source, target) in zip(
                steps, self.transitions, strict=True
            )
        ]
        return other

    def WithBlocks(self, blocks: Sequence[Block]) -> "Program":
        """Returns this program, to be executed as machine code only, for other blocks.

        Args:
            blocks: The same blocks of the same diagram; empty: none, so that a program
                that is kept holds no system.
        """
        other = copy.copy(self)
        other._blocks = blocks
        other._values = {}  # They refer to the program that has made them.
        return other

    def Evaluate(
        self,
        t: float,
        x: Array,
        m: Array,
        p: Array,
        y: Array,
        dx: Array,
        wanted: int,
    ) -> None:
        """Computes dx and y.

        Args:
            wanted: RATE: of y, only the signals on which dx and the inputs of delays
                depend. ALL, SIGNALS: all signals.
        """
        arrays = Arrays(t, x, m, p, y, dx)
        self._Execute(self._needed, arrays)
        if wanted != RATE:
            self._Execute(self._others, arrays)

    def Trace(self) -> ScalarProgram:
        """Returns the operations of Evaluate() as a graph.

        Raises:
            UnsupportedSystem: If a function cannot be a graph of operations, for
                example because it has a loop that ends when a value has converged.
        """
        parts = [partial(self._Execute, x) for x in (self._needed, self._others)]
        return TraceProgram(parts, self.sizes, len(self.p))

    def _Execute(self, outputs: Iterable[Source], arrays: Arrays) -> None:
        """Computes outputs in the given order, and writes them into y or dx."""
        for output in outputs:
            system = self._blocks[output.block].system
            target = arrays.dx[self.states[output.block]]
            if output in self.signals:
                target = arrays.y[self.signals[output]]
            try:
                value = self._values[output](arrays)
                if np.size(value) != len(target):
                    raise UnsupportedSystem(
                        system,
                        f"its kernel's {output.port} has {np.size(value)} elements "
                        f"instead of {len(target)}",
                    )
                target[...] = value
            except Untraceable as error:
                raise UnsupportedSystem(system, str(error)) from error

    def SignalOf(self, i: int, kind: str, transition: str) -> slice:
        """Returns the slice of y of the `guard` or new `mode` of block i's transition.

        Args:
            transition: The name of the transition in the kernel.
        """
        return self.signals[_Changed(i, kind, transition)]

    def _Declare(self, i: int, kernel: Kernel) -> None:
        """Registers the terms of a block, and reserves space in y for their values."""
        system = self._blocks[i].system
        if kernel.rate is not None:
            self._terms[Source(i, _RATE)] = kernel.rate
        elif system.num_continuous_states() > 0:
            raise UnsupportedSystem(system, "its kernel has no rate")
        for name, term in kernel.outputs.items():
            size = kernel.sizes.get(name)
            if size is None:
                size = system.GetOutputPort(name).size()
            self._Compute(Source(i, name), term, size)
        for delay in kernel.delays:
            output = Source(i, delay.output)
            self.signals[output] = self._NewSignal(len(delay.initial_value))
            if isinstance(delay.time, str):
                self._steered[output] = delay.time
        modes = self.modes[i]
        for name, transition in kernel.transitions.items():
            guard = None
            if transition.guard is not None:
                guard = self._Compute(_Changed(i, "guard", name), transition.guard, 1)
            source = _Changed(i, "mode", name)
            size = modes.stop - modes.start
            if transition.mode is None:
                self.signals[source] = mode = self._NewSignal(size)
            else:
                mode = self._Compute(source, transition.mode, size)
            self.transitions.append((transition, guard, mode, modes))

    def _Compute(self, output: Source, term: Term, size: int) -> slice:
        """Registers a term, and reserves space in y; returns the slice."""
        self._terms[output] = term
        self.signals[output] = self._NewSignal(size)
        return self.signals[output]

    def _NewSignal(self, size: int) -> slice:
        self._num_y += size
        return slice(self._num_y - size, self._num_y)

    def _CheckInputs(self, i: int, block: Block) -> None:
        """Raises UnsupportedSystem if a block's connected input is in no term."""
        if isinstance(block.system, KernelBlock):
            return  # Drake's callbacks have the same terms.
        for name in block.inputs:
            if name not in self.kernels[i].unused and (i, name) not in self._taken:
                reason = f"its kernel takes nothing from the input {name}"
                if name in (*WORDS, "rate", *self.kernels[i].parameters):
                    reason += f', which in a term is ("input", "{name}")'
                raise UnsupportedSystem(block.system, reason)

    def Add(self, output: Source) -> None:
        """Adds an output to the order of computation, after its arguments."""
        is_steered = output in self._steered
        if output in self._values or not (output in self._terms or is_steered):
            return
        i, name = output
        if output in self._under_way:
            raise AlgebraicLoop(self._blocks[i].system, f"{name} depends on itself")
        self._under_way.append(output)
        if is_steered:
            # The caller sets it, but its time must not depend on it.
            self.Slot(i, self._steered[output])
        else:
            self._values[output] = _Reader(self, i).Read(self._terms[output])
        self._under_way.pop()

    def Slot(self, i: int, name: str) -> slice:
        """Returns the slice of y of a block's input or, else, of its own output.

        If a term computes the value, it is added to the order of computation.
        """
        system = self._blocks[i].system
        source = Source(i, name)
        if system.HasInputPort(name):
            return self.InputSlot(i, name)
        if source not in self.signals:
            raise UnsupportedSystem(system, f"its kernel takes {name!r}")
        self.Add(source)
        return self.signals[source]

    def InputSlot(self, i: int, name: str) -> slice:
        """Returns the slice of y of a block's input; see Slot()."""
        block = self._blocks[i]
        self._taken.add((i, name))
        source = block.inputs.get(name)
        if source is None:
            return self._FedSlot(i, name)
        if source not in self.signals:
            raise UnsupportedSystem(
                self._blocks[source.block].system,
                f"its kernel has no output {source.port}",
            )
        self.Add(source)
        return self.signals[source]

    def _FedSlot(self, i: int, name: str) -> slice:
        """Returns the slice of y of an input that is not connected."""
        system = self._blocks[i].system
        if not system.HasInputPort(name):
            raise UnsupportedSystem(system, f"its kernel takes the input {name!r}")
        source = Source(i, name)
        if source not in self.fed:
            size = self.kernels[i].sizes.get(name) or system.GetInputPort(name).size()
            self.fed[source] = self._NewSignal(size)
        return self.fed[source]


class _Reader(TermReader):
    """Translates the terms of one block into functions of a program's Arrays."""

    def __init__(self, program: Program, i: int):
        self._program = program
        self._i = i

    def Call(self, law: Law, arguments: Sequence[Name | int]) -> ValueIn:
        values = [self.Read(argument) for argument in arguments]
        return lambda arrays: arrays.follow(law)(*[value(arrays) for value in values])

    def Input(self, name: str) -> ValueIn:
        slot = self._program.InputSlot(self._i, name)
        return lambda arrays: arrays.y[slot]

    def Named(self, name: str) -> ValueIn:
        program = self._program
        i = self._i
        state = program.states[i]
        mode = program.modes[i]
        if name == "time":
            return lambda arrays: arrays.t
        if name == "state":
            return lambda arrays: arrays.x[state]
        if name == "mode":
            return lambda arrays: arrays.m[mode]
        if name in program.layouts[i]:
            layout = program.layouts[i][name]
            return lambda arrays: layout.In(arrays.p)
        if name == "rate" and program.kernels[i].rate is not None:
            program.Add(Source(i, _RATE))
            return lambda arrays: arrays.dx[state]
        slot = program.Slot(i, name)
        return lambda arrays: arrays.y[slot]


def _Changed(i: int, kind: str, transition: str) -> Source:
    """Returns the key of the `guard` or the new `mode` of block i's transition."""
    return Source(i, f"{kind} of {transition}")


def _HasTermsOf(one: Kernel, other: Kernel) -> bool:
    """Returns whether two kernels of a block differ only in numbers and delays."""
    return _TermsOf(one) == _TermsOf(other)


def _TermsOf(kernel: Kernel) -> tuple[Any, ...]:
    """Returns what a program's code takes from a kernel, besides its parameters."""
    return (
        *(kernel.outputs, kernel.rate, kernel.sizes, kernel.parameters.keys()),
        [(name, x.guard, x.mode) for name, x in kernel.transitions.items()],
        [(x.signal, x.output, len(x.initial_value)) for x in kernel.delays],
    )


def _IsCall(term: Term) -> bool:
    return isinstance(term, tuple) and callable(term[0])


def _NumModes(block: Block, kernel: Kernel) -> int:
    """Returns the size of a block's mode in a program.

    A block with delays has none: its discrete states are samples for Drake's Simulator.
    """
    if kernel.delays:
        return 0
    groups = block.system.AllocateDiscreteVariables().get_data()
    return sum(group.size() for group in groups)


def _Slices(sizes: Iterable[int]) -> list[slice]:
    """Returns the slices of a vector's consecutive parts."""
    ends = [0, *itertools.accumulate(sizes)]
    return list(itertools.starmap(slice, itertools.pairwise(ends)))
