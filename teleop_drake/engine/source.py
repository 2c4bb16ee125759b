"""The source of one function that computes what all blocks of a diagram do.

    def evaluate(t, x, m, p, q, y, dx, everything): ...

fills in the rate dx of the continuous state and the outputs y of the blocks, all of
them or only those that the rate and the delays depend on. It takes the time t, the
continuous and the discrete state x and m, and the parameters p and q. What no kernel
delivers, such as what comes out of a delay or what a diagram is fed with from outside,
is in y beforehand.
"""

import copy
import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.arrays import Array, Indices
from teleop_drake.engine.flatten import (
    AlgebraicLoop,
    Block,
    Source,
    UnsupportedSystem,
)
from teleop_drake.kernel import Delay, Kernel, KernelBlock, Name, Term, Transition
from teleop_drake.kernel.kernel import Law, Part
from teleop_drake.kernel.terms import TermReader

# The rate of a block's state is found among its outputs under this name.
_RATE = "rate"

# Expressions of vectors one after another, each with its size, or None.
_Texts = list[tuple[str, int | None]]


def put(target: Any, value: Any) -> None:
    """Copies a vector to where another one of its size is."""
    if len(value) != len(target):
        raise ValueError("a function returned a vector of another size")
    for i in range(len(target)):
        target[i] = value[i]


class Parameters:
    """Packs parameters, and says how the generated source unpacks them.

    Equal arrays in one field of a kind of named tuple are one array: what several
    blocks compute from the same plant is computed once.

    Attributes:
        types: The named tuples among them, as T0, T1, ... in the source.
    """

    def __init__(self) -> None:
        self.types: list[Callable[..., Any]] = []
        self._shared: dict[Any, str] = {}
        self._numbers: list[float] = []
        self._integers: list[int] = []

    def Add(self, value: Any) -> str:
        """Adds a parameter and returns what it is in the source.

        Args:
            value: A number, an array, or a (named) tuple of them.
        """
        kind = type(value)
        if hasattr(value, "_fields"):
            parts = [self._AddField(kind, i, part) for i, part in enumerate(value)]
            return f"T{_IndexOf(kind, self.types)}({', '.join(parts)})"
        if isinstance(value, tuple):
            return f"({', '.join(map(self.Add, value))},)"
        array = np.asarray(value)
        is_whole = array.dtype.kind in "iub"
        name = "q" if is_whole else "p"
        store: list[Any] = self._integers if is_whole else self._numbers
        first = len(store)
        store.extend(array.ravel().tolist())
        if array.ndim == 0:
            return f"{name}[{first}]"
        text = f"{name}[{first}:{len(store)}]"
        return text if array.ndim == 1 else f"{text}.reshape({array.shape})"

    def _AddField(self, kind: type, place: int, value: Any) -> str:
        if not isinstance(value, np.ndarray):
            return self.Add(value)
        key = kind, place, value.shape, value.dtype, value.tobytes()
        if key not in self._shared:
            self._shared[key] = self.Add(value)
        return self._shared[key]

    def as_arrays(self) -> tuple[Array, Indices]:
        """Returns the arrays p and q of the source."""
        return np.array(self._numbers, np.float64), np.array(self._integers, np.int64)


def _IndexOf(item: Any, items: list[Any]) -> int:
    """Returns the index of an item in a list, to which it is added if need be."""
    if item not in items:
        items.append(item)
    return items.index(item)


class Program:
    """The function `evaluate` of a diagram as source, and what it is run with.

    Args:
        blocks: Of the diagram.
        kernels: One for each block.

    Attributes:
        kernels: The same.
        text: The source. It depends on the structure of the diagram alone.
        functions: What the source calls, as f0, f1, ...
        names: The same and helpers, by their names there.
        parameters: p and q.
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
        self._parameters = Parameters()
        self._parameter_texts: dict[tuple[int, str], str] = {}
        self.functions: list[Law] = []
        # What fills in a part of y or dx.
        self._terms: dict[Source, Term] = {}
        self.signals: dict[Source, slice] = {}
        self.fed: dict[Source, slice] = {}
        self.states = _Slices(block.system.num_continuous_states() for block in blocks)
        self.modes = _Slices(_NumModes(block.system) for block in blocks)
        self._num_y = 0
        self._lines: list[str] = []
        self._under_way: list[Source] = []
        self._done: set[Source] = set()
        self._readers = [
            _Reader(self, i, blocks[i].system, kernel)
            for i, kernel in enumerate(kernels)
        ]
        for i, kernel in enumerate(kernels):
            self._Declare(i, kernel)
        for i in range(len(kernels)):
            self.Write(Source(i, _RATE))
        self.delays: list[tuple[Delay, slice, slice]] = [
            (delay, self.Slot(i, delay.signal), self.signals[Source(i, delay.output)])
            for i, kernel in enumerate(kernels)
            for delay in kernel.delays
        ]
        self._lines += ["    if not everything:", "        return"]
        for output in self._terms:
            self.Write(output)
        for i in range(len(blocks)):
            self._CheckInputs(i)
        self.transitions: list[tuple[Transition, slice | None, slice, slice]] = [
            (
                transition,
                self.signals.get(Source(i, _Guard(name))),
                self.signals[Source(i, _Mode(name))],
                self.modes[i],
            )
            for i, kernel in enumerate(kernels)
            for name, transition in kernel.transitions.items()
        ]
        self.text = "\n".join([_HEAD, *self._lines, ""])
        self.names: dict[str, Callable[..., Any]] = {
            "put": put,
            **{f"T{i}": kind for i, kind in enumerate(self._parameters.types)},
            **{f"f{i}": function for i, function in enumerate(self.functions)},
        }
        self.parameters = self._parameters.as_arrays()
        self.sizes = self._num_y, self.states[-1].stop, self.modes[-1].stop

    def With(self, kernels: Sequence[Kernel]) -> "Program | None":
        """Returns the program of kernels with other parameters and delays.

        Args:
            kernels: Otherwise the same; None is returned if the source would not be.
        """
        program = copy.copy(self)
        program.kernels = kernels
        parameters = Parameters()
        for (i, name), text in self._parameter_texts.items():
            if parameters.Add(kernels[i].parameters[name]) != text:
                return None
        program.parameters = parameters.as_arrays()
        delays = [delay for kernel in kernels for delay in kernel.delays]
        program.delays = [
            (delay, signal, output)
            for delay, (_, signal, output) in zip(delays, self.delays, strict=True)
        ]
        has_types = parameters.types == self._parameters.types
        return program if has_types and program.HasTextOf(self) else None

    def HasTextOf(self, other: "Program") -> bool:
        """Returns whether another program differs in its numbers and functions alone.

        Its integers are no numbers in this sense: they decide which code there is.
        """
        return (
            self.text == other.text
            and self.sizes == other.sizes
            and len(self.parameters[0]) == len(other.parameters[0])
            and np.array_equal(self.parameters[1], other.parameters[1])
        )

    def HasCodeOf(self, other: "Program") -> bool:
        """Returns whether another program differs in its numbers alone."""
        return self.names == other.names and self.HasTextOf(other)

    def OwnerOf(self, function: Callable[..., Any]) -> System | None:
        """Returns the first block whose kernel has a function."""
        for output, term in self._terms.items():
            if isinstance(term, tuple) and function in term:
                return self._blocks[output.block].system
        return None

    def _Declare(self, i: int, kernel: Kernel) -> None:
        """Makes room for all that a block computes."""
        system = self._blocks[i].system
        if kernel.rate is not None:
            self._terms[Source(i, _RATE)] = kernel.rate
        elif system.num_continuous_states() > 0:
            raise UnsupportedSystem(system, "its kernel has no rate")
        for name, term in kernel.outputs.items():
            self._terms[Source(i, name)] = term
            size = kernel.sizes.get(name)
            if size is None:
                size = system.GetOutputPort(name).size()
            self.signals[Source(i, name)] = self._NewSignal(size)
        for delay in kernel.delays:
            size = len(delay.initial_value)
            self.signals[Source(i, delay.output)] = self._NewSignal(size)
        num_modes = self.modes[i].stop - self.modes[i].start
        for name, transition in kernel.transitions.items():
            if transition.guard is not None:
                guard = Source(i, _Guard(name))
                self._terms[guard] = transition.guard
                self.signals[guard] = self._NewSignal(1)
            mode = Source(i, _Mode(name))
            self._terms[mode] = transition.mode
            self.signals[mode] = self._NewSignal(num_modes)

    def _NewSignal(self, size: int) -> slice:
        self._num_y += size
        return slice(self._num_y - size, self._num_y)

    def ParameterText(self, i: int, name: str, value: Any) -> str:
        """Returns what a parameter of a block is in the source."""
        if (i, name) not in self._parameter_texts:
            self._parameter_texts[i, name] = self._parameters.Add(value)
        return self._parameter_texts[i, name]

    def _CheckInputs(self, i: int) -> None:
        """Raises UnsupportedSystem if a block is connected to what it does not take."""
        block = self._blocks[i]
        if isinstance(block.system, KernelBlock):
            return  # Its callbacks take nothing else either.
        kernel = self.kernels[i]
        taken = {*kernel.unused, *(delay.signal for delay in kernel.delays)}
        for name in block.inputs:
            if name not in taken | self._readers[i].names:
                raise UnsupportedSystem(
                    block.system, f"its kernel takes nothing from the input {name}"
                )

    def Write(self, output: Source) -> None:
        """Adds the lines that fill in an output, after those that it depends on."""
        if output in self._done or output not in self._terms:
            return
        block = self._blocks[output.block]
        if output in self._under_way:
            raise AlgebraicLoop(block.system, f"{output.port} depends on itself")
        self._under_way.append(output)
        expressions = self._readers[output.block].Read(self._terms[output])
        self._under_way.pop()
        self._done.add(output)
        self._lines.append(f"    # {block.path}: {output.port}")
        array = "y"
        part = self.signals.get(output)
        if part is None:
            array = "dx"
            part = self.states[output.block]
        first = part.start
        for expression, size in expressions:
            last = part.stop if size is None else first + size
            self._lines.append(f"    put({array}[{first}:{last}], {expression})")
            first = last
        if first != part.stop:
            raise UnsupportedSystem(
                block.system,
                f"its kernel's {output.port} has {first - part.start} elements "
                f"instead of {part.stop - part.start}",
            )

    def Slot(self, i: int, name: str) -> slice:
        """Returns where in y a port of a block is, after what fills it in."""
        block = self._blocks[i]
        kernel = self.kernels[i]
        source = block.inputs.get(name, Source(i, name))
        if source in self.signals:
            self.Write(source)
            return self.signals[source]
        if name in block.inputs:
            raise UnsupportedSystem(
                self._blocks[source.block].system,
                f"its kernel has no output {source.port}",
            )
        if not block.system.HasInputPort(name):
            raise UnsupportedSystem(block.system, f"its kernel takes {name!r}")
        if source not in self.fed:
            size = kernel.sizes.get(name) or block.system.GetInputPort(name).size()
            self.fed[source] = self._NewSignal(size)
        return self.fed[source]


class _Reader(TermReader[_Texts]):
    """Writes the terms of a block as expressions, each with its size if it is known."""

    def __init__(self, program: Program, i: int, system: System, kernel: Kernel):
        super().__init__(kernel)
        self._program = program
        self._i = i
        self._system = system

    def Number(self, number: int) -> _Texts:
        return [(repr(number), None)]

    def Joined(self, parts: list[_Texts]) -> _Texts:
        return [text for part in parts for text in part]

    def Part(self, whole: _Texts, part: Part) -> _Texts:
        ((text, size),) = whole
        _, begin, end = part
        if size is None or not 0 <= begin <= end <= size:
            raise UnsupportedSystem(self._system, f"its kernel takes the part {part}")
        return [(f"{text}[{begin}:{end}]", end - begin)]

    def Call(self, law: Law, arguments: Sequence[Name | int]) -> _Texts:
        texts = ", ".join(text for x in arguments for text, _ in self.Read(x))
        return [(f"f{_IndexOf(law, self._program.functions)}({texts})", None)]

    def Word(self, word: str) -> _Texts:
        if word == "time":
            return [("t", None)]
        if word == "state":
            return _Elements("x", self._program.states[self._i])
        return _Elements("m", self._program.modes[self._i])

    def Parameter(self, name: str, value: Any) -> _Texts:
        size = None if isinstance(value, tuple) else np.size(value)
        return [(self._program.ParameterText(self._i, name, value), size)]

    def Rate(self, term: Term) -> _Texts:
        self._program.Write(Source(self._i, _RATE))
        return _Elements("dx", self._program.states[self._i])

    def Port(self, name: str) -> _Texts:
        return _Elements("y", self._program.Slot(self._i, name))


_HEAD = "def evaluate(t, x, m, p, q, y, dx, everything):"


def _Guard(transition: str) -> str:
    return f"guard of {transition}"


def _Mode(transition: str) -> str:
    return f"mode after {transition}"


def _NumModes(system: System) -> int:
    values = system.AllocateDiscreteVariables()
    return sum(values.get_vector(i).size() for i in range(values.num_groups()))


def _Elements(array: str, part: slice) -> _Texts:
    return [(f"{array}[{part.start}:{part.stop}]", part.stop - part.start)]


def _Slices(sizes: Iterable[int]) -> list[slice]:
    """Returns the parts of a vector that stand one after another."""
    ends = [0, *itertools.accumulate(sizes)]
    return list(itertools.starmap(slice, itertools.pairwise(ends)))
