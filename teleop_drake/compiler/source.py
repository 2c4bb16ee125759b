"""The source of one function that computes what all blocks of a diagram do.

    def evaluate(t, x, m, p, y, dx, everything): ...

fills in the rate dx of the continuous state and the outputs y of the blocks, all of
them or only those that the rate depends on. It takes the time t, the continuous and
the discrete state x and m, and the parameters p. What no kernel delivers, such as what
a diagram is fed with from outside, is in y beforehand.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from teleop_drake.compiler.flatten import Block, Source
from teleop_drake.compiler.unsupported import UnsupportedSystem
from teleop_drake.kernel import Kernel, Term, names_in

# The rate of a block's state is found among its outputs under this name.
_RATE = "rate"


def put(target: Any, first: int, size: int, value: Any) -> None:
    """Copies a vector of a known size into a part of another one.

    Args:
        target: What to copy to.
        first: Where its part begins.
        size: Of the part, and of the vector.
        value: The vector.
    """
    if len(value) != size:
        raise ValueError("a function returned a vector of another size")
    for i in range(size):
        target[first + i] = value[i]


class Program:
    """The function `evaluate` of a diagram as source, and what it is run with.

    Args:
        blocks: Of the diagram.
        kernels: One for each block.

    Attributes:
        text: The source. It depends on the structure of the diagram alone.
        functions: What the source calls f0, f1, ... after `put`.
        parameters: p.
        signals: Where in y an output is.
        fed: Where in y an input is that is not connected: (block, port).
        states: Where in x the state of a block is, by the block.
        modes: Where in m that of its discrete states is.
        sizes: Of y, x and m.

    Raises:
        UnsupportedSystem: If a kernel takes what there is not.
    """

    def __init__(self, blocks: Sequence[Block], kernels: Sequence[Kernel]):
        self._blocks, self._kernels = blocks, kernels
        self.functions: list[Callable[..., Any]] = []
        self.parameters: list[Any] = []
        self.signals: dict[Source, slice] = {}
        self.fed: dict[Source, slice] = {}
        self._parameter_places: dict[tuple[int, str], int] = {}
        self.states, x = _slices([_NumStates(block) for block in blocks])
        self.modes, m = _slices([_NumModes(block) for block in blocks])
        self._y = 0
        for i, block in enumerate(blocks):
            self._CheckInputs(i, block)
            for name in kernels[i].outputs:
                size = kernels[i].sizes.get(name)
                if size is None:
                    size = block.system.GetOutputPort(name).size()
                self.signals[Source(i, name)] = self._NewSignal(size)
        self._lines: list[str] = []
        self._under_way: list[Source] = []
        self._done: set[Source] = set()
        for i, kernel in enumerate(kernels):
            if kernel.rate is not None:
                self._Write(Source(i, _RATE))
            elif blocks[i].system.num_continuous_states() > 0:
                raise UnsupportedSystem(blocks[i].system, "its kernel has no rate")
        rates, self._lines = self._lines, ["    if not everything:", "        return"]
        for output in self.signals:
            self._Write(output)
        self.text = "\n".join([_HEAD, *rates, *self._lines, ""])
        self.sizes = self._y, x, m

    @property
    def names(self) -> dict[str, Callable[..., Any]]:
        """The functions by the names that the source has for them."""
        return {"put": put} | {f"f{i}": f for i, f in enumerate(self.functions)}

    def _NewSignal(self, size: int) -> slice:
        self._y += size
        return slice(self._y - size, self._y)

    def _CheckInputs(self, i: int, block: Block) -> None:
        """Raises UnsupportedSystem if a block is connected to what it does not take."""
        kernel = self._kernels[i]
        taken = {name for term in _Terms(kernel) for name in names_in(term)} | set(
            kernel.watched
        )
        for name in block.inputs:
            if name not in taken:
                raise UnsupportedSystem(
                    block.system, f"its kernel takes nothing from the input {name}"
                )

    def _Write(self, output: Source) -> None:
        """Adds the lines that fill in an output, after those that it depends on."""
        if output in self._done:
            return
        kernel, system = self._kernels[output.block], self._blocks[output.block].system
        if output in self._under_way:
            raise UnsupportedSystem(system, f"{output.port} depends on itself")
        if output.port == _RATE:
            array, part, term = "dx", self.states[output.block], kernel.rate
        else:
            array, part = "y", self.signals[output]
            term = kernel.outputs[output.port]
        assert term is not None
        self._under_way.append(output)
        expressions = self._Expressions(output.block, term)
        self._under_way.pop()
        self._done.add(output)
        self._lines.append(f"    # {self._blocks[output.block].path}: {output.port}")
        first = part.start
        for expression, size in expressions:
            if size is None:
                size = part.stop - first
            self._lines.append(f"    put({array}, {first}, {size}, {expression})")
            first += size
        if first != part.stop:
            raise UnsupportedSystem(
                system,
                f"its kernel's {output.port} has {first - part.start} elements "
                f"instead of {part.stop - part.start}",
            )

    def _Expressions(self, i: int, term: Term) -> list[tuple[str, int | None]]:
        """Returns what a term is in the source, and sizes where they are known."""
        if isinstance(term, str):
            term = [term]
        if isinstance(term, list):
            return [self._Named(i, name) for name in term]
        function, *names = term
        assert callable(function), function
        if function not in self.functions:
            self.functions.append(function)
        arguments = (
            self._Named(i, name)[0] if isinstance(name, str) else repr(name)
            for name in names
        )
        place = self.functions.index(function)
        return [(f"f{place}({', '.join(arguments)})", None)]

    def _Named(self, i: int, name: str) -> tuple[str, int | None]:
        """Returns what a name of a block's kernel is in the source, and its size."""
        block, kernel = self._blocks[i], self._kernels[i]
        if name == "time":
            return "t", None
        if name == "state":
            return _Part("x", self.states[i])
        if name == "mode":
            return _Part("m", self.modes[i])
        if name in kernel.parameters:
            return self._Parameter(i, name)
        if name == _RATE and kernel.rate is not None:
            self._Write(Source(i, _RATE))
            return _Part("dx", self.states[i])
        if name in kernel.outputs:
            self._Write(Source(i, name))
            return _Part("y", self.signals[Source(i, name)])
        if name in block.inputs:
            source = block.inputs[name]
            if source not in self.signals:
                raise UnsupportedSystem(
                    self._blocks[source.block].system,
                    f"its kernel has no output {source.port}",
                )
            self._Write(source)
            return _Part("y", self.signals[source])
        if not block.system.HasInputPort(name):
            raise UnsupportedSystem(block.system, f"its kernel takes {name!r}")
        fed = Source(i, name)
        if fed not in self.fed:
            size = kernel.sizes.get(name) or block.system.GetInputPort(name).size()
            self.fed[fed] = self._NewSignal(size)
        return _Part("y", self.fed[fed])

    def _Parameter(self, i: int, name: str) -> tuple[str, int | None]:
        value = _AsArrays(self._kernels[i].parameters[name])
        if (i, name) not in self._parameter_places:
            self._parameter_places[i, name] = len(self.parameters)
            self.parameters.append(value)
        size = value.size if isinstance(value, np.ndarray) else None
        return f"p[{self._parameter_places[i, name]}]", size


_HEAD = "def evaluate(t, x, m, p, y, dx, everything):"


def _Part(array: str, part: slice) -> tuple[str, int]:
    return f"{array}[{part.start}:{part.stop}]", part.stop - part.start


def _Terms(kernel: Kernel) -> list[Term]:
    rates = [] if kernel.rate is None else [kernel.rate]
    return [*kernel.outputs.values(), *rates]


def _NumStates(block: Block) -> int:
    return block.system.num_continuous_states()


def _NumModes(block: Block) -> int:
    context = block.system.AllocateContext()
    return sum(
        context.get_discrete_state(i).size()
        for i in range(context.num_discrete_state_groups())
    )


def _slices(sizes: Sequence[int]) -> tuple[list[slice], int]:
    """Returns the parts of a vector, one after another, and its size."""
    ends = [int(end) for end in np.cumsum(sizes)]
    return [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)], sum(
        sizes
    )


def _AsArrays(value: Any) -> Any:
    """Returns a parameter as compiled code takes it."""
    if isinstance(value, tuple):
        return (
            type(value)(*map(_AsArrays, value))
            if hasattr(value, "_fields")
            else (tuple(map(_AsArrays, value)))
        )
    if np.ndim(value) == 0:
        return float(value)
    kind = np.int64 if np.asarray(value).dtype.kind in "iub" else np.float64
    return np.array(value, kind)
