"""The program of a diagram: what its blocks compute, in the order of computation.

A program fills in the rate dx of the continuous state and the outputs y of the blocks,
all of them or only those that the rate and the delays depend on. It takes the time t,
the continuous and the discrete state x and m, and the parameters p, which are floats.
What no kernel delivers, such as what comes out of a delay or what a diagram is fed with
from outside, is in y beforehand.

Its steps are executed on arrays of floats or, to make machine code of them, on arrays
of the Numbers of a graph.
"""

import itertools
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.engine.flatten import (
    AlgebraicLoop,
    Block,
    Source,
    UnsupportedSystem,
)
from teleop_drake.jit.packing import Parameters
from teleop_drake.jit.scalar_code import RATE, Arrays, ScalarProgram, TraceProgram
from teleop_drake.jit.symbols import Untraceable
from teleop_drake.kernel import Delay, Kernel, KernelBlock, Name, Term, Transition
from teleop_drake.kernel.kernel import Law
from teleop_drake.kernel.terms import TermReader, ValueIn

# The rate of a block's state is found among its outputs under this name.
_RATE = "rate"


class Program:
    """What the blocks of a diagram compute.

    Args:
        blocks: Of the diagram.
        kernels: One for each block.

    Attributes:
        kernels: The same.
        p: The parameters that are floats.
        signals: Where in y an output is.
        fed: Where in y an input is that is not connected: (block, port).
        delays: Where in y a delay has its signal and its output.
        transitions: Where in y a transition has its guard (None: periodic) and the new
            mode, and where in m the mode is.
        states: Where in x the state of a block is, by the block.
        modes: Where in m that of its discrete states is.
        sizes: Of y, x and m.

    Raises:
        UnsupportedSystem: If a kernel takes what there is not.
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
        # What is to be computed, and the functions that do it, in their order.
        self._terms: dict[Source, Term] = {}
        self._values: dict[Source, ValueIn] = {}
        self._under_way: list[Source] = []
        # The inputs that something is computed from: (block, port).
        self._taken: set[tuple[int, str]] = set()
        for i, kernel in enumerate(kernels):
            self._Declare(i, kernel)
        for i in range(len(kernels)):
            self.Add(Source(i, _RATE))
        self.delays: list[tuple[Delay, slice, slice]] = [
            (delay, self.Slot(i, delay.signal), self.signals[Source(i, delay.output)])
            for i, kernel in enumerate(kernels)
            for delay in kernel.delays
        ]
        self._needed = list(self._values)
        for output in self._terms:
            self.Add(output)
        self._others = list(self._values)[len(self._needed) :]
        for i, block in enumerate(blocks):
            self._CheckInputs(i, block)
        self.sizes = self._num_y, self.states[-1].stop, self.modes[-1].stop

    @property
    def structure(self) -> list[Any]:
        """All but the floats and the functions.

        Programs of one structure may have their floats exchanged.
        """
        return [
            [(block.path, block.inputs) for block in self._blocks],
            [
                (output, term[1:] if _IsCall(term) else term)
                for output, term in self._terms.items()
            ],
            self.layouts,
            self.fed,
            [places for _, *places in self.delays],
            [self.states, self.modes, self.sizes],
        ]

    @property
    def laws(self) -> list[Any]:
        """The functions that are called."""
        return [term[0] for term in self._terms.values() if _IsCall(term)]

    def HasCodeOf(self, other: "Program") -> bool:
        """Returns whether another program differs in its numbers alone."""
        return self.laws == other.laws and self.structure == other.structure

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
        """Fills in dx and the part of y that is needed for RATE, or all of y."""
        arrays = Arrays(t, x, m, p, y, dx)
        self._Execute(self._needed, arrays)
        if wanted != RATE:
            self._Execute(self._others, arrays)

    def Trace(self) -> ScalarProgram:
        """Returns the operations of Evaluate().

        Raises:
            UnsupportedSystem: If a function does what a graph of operations cannot,
                such as a loop until something has converged.
        """
        parts = [partial(self._Execute, x) for x in (self._needed, self._others)]
        return TraceProgram(parts, self.sizes, len(self.p))

    def _Execute(self, outputs: Iterable[Source], arrays: Arrays) -> None:
        """Computes outputs, and rates, and puts them where they belong."""
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

    def _Declare(self, i: int, kernel: Kernel) -> None:
        """Makes room for all that a block computes."""
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
        modes = self.modes[i]
        for name, transition in kernel.transitions.items():
            guard = None
            if transition.guard is not None:
                guard = self._Compute(
                    Source(i, f"guard of {name}"), transition.guard, 1
                )
            source = Source(i, f"mode after {name}")
            mode = self._Compute(source, transition.mode, modes.stop - modes.start)
            self.transitions.append((transition, guard, mode, modes))

    def _Compute(self, output: Source, term: Term, size: int) -> slice:
        """Makes room in y for the value of a term; returns where."""
        self._terms[output] = term
        self.signals[output] = self._NewSignal(size)
        return self.signals[output]

    def _NewSignal(self, size: int) -> slice:
        self._num_y += size
        return slice(self._num_y - size, self._num_y)

    def _CheckInputs(self, i: int, block: Block) -> None:
        """Raises UnsupportedSystem if a block is connected to what it does not take."""
        if isinstance(block.system, KernelBlock):
            return  # Its callbacks take nothing else either.
        for name in block.inputs:
            if name not in self.kernels[i].unused and (i, name) not in self._taken:
                raise UnsupportedSystem(
                    block.system, f"its kernel takes nothing from the input {name}"
                )

    def Add(self, output: Source) -> None:
        """Adds what computes an output, after what it depends on."""
        if output in self._values or output not in self._terms:
            return
        i, name = output
        if output in self._under_way:
            raise AlgebraicLoop(self._blocks[i].system, f"{name} depends on itself")
        self._under_way.append(output)
        value = _Reader(self, i).Read(self._terms[output])
        self._under_way.pop()
        self._values[output] = value

    def Slot(self, i: int, name: str) -> slice:
        """Returns where in y a port of a block is, after what fills it in."""
        block = self._blocks[i]
        self._taken.add((i, name))
        source = block.inputs.get(name, Source(i, name))
        if source in self.signals:
            self.Add(source)
            return self.signals[source]
        if name in block.inputs:
            raise UnsupportedSystem(
                self._blocks[source.block].system,
                f"its kernel has no output {source.port}",
            )
        if not block.system.HasInputPort(name):
            raise UnsupportedSystem(block.system, f"its kernel takes {name!r}")
        if source not in self.fed:
            size = (
                self.kernels[i].sizes.get(name)
                or block.system.GetInputPort(name).size()
            )
            self.fed[source] = self._NewSignal(size)
        return self.fed[source]


class _Reader(TermReader):
    """Translates the terms of a block into functions of the arrays of a program."""

    def __init__(self, program: Program, i: int):
        self._program = program
        self._i = i

    def Call(self, law: Law, arguments: Sequence[Name | int]) -> ValueIn:
        values = [self.Read(argument) for argument in arguments]
        return lambda arrays: arrays.follow(law)(*[value(arrays) for value in values])

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
        if name == _RATE and program.kernels[i].rate is not None:
            program.Add(Source(i, _RATE))
            return lambda arrays: arrays.dx[state]
        slot = program.Slot(i, name)
        return lambda arrays: arrays.y[slot]


def _IsCall(term: Term) -> bool:
    return isinstance(term, tuple) and callable(term[0])


def _NumModes(block: Block, kernel: Kernel) -> int:
    """Returns the size of a block's mode; a delay remembers things for Drake alone."""
    if kernel.delays:
        return 0
    groups = block.system.AllocateDiscreteVariables().get_data()
    return sum(group.size() for group in groups)


def _Slices(sizes: Iterable[int]) -> list[slice]:
    """Returns the parts of a vector that stand one after another."""
    ends = [0, *itertools.accumulate(sizes)]
    return list(itertools.starmap(slice, itertools.pairwise(ends)))
