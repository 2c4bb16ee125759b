"""The description of a block's computation, from which it can be compiled.

A block describes its computation by a method `Kernel()` of a few lines. The kernel
names pure functions and their arguments. The block's callbacks in Drake call the same
functions; the callbacks of a KernelBlock are made from the kernel.

    def Kernel(self) -> Kernel:
        return Kernel(
            parameters={"stiffness": self._stiffness},
            outputs={"force": (spring_force, "stiffness", "position")},
        )

A term defines a vector:

    (function, "name", ..., 3)   the result of a function of the named values. An
                                 integer is passed unchanged; it belongs to the
                                 structure of the block, as sizes and indices do
    ["name", "name", ...]        the named vectors, one after another
    "name"                       the named vector
    ("input", "name")            the input port of that name, whatever else has the
                                 name; it can stand in the place of a name
    ("name", 3, 5)               the elements of the named vector from 3 to before 5;
                                 it can stand in the place of a name

A name stands for the first of the following that has this name: `time` (the time in s),
`state` (the continuous state), `mode` (all discrete states one after another), a
parameter, `rate` (if there is one), an input port, or an output (a port or an
intermediate result).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

Law = Callable[..., Any]
Input = tuple[Literal["input"], str]
Name = str | Input | tuple[str | Input, int, int]
Term = tuple[Law | Name | int, ...] | list[Name] | Name


@dataclass(frozen=True, kw_only=True)
class Transition:
    """A change of a block's mode, and with it of its equations.

    A transition with a guard happens as soon as the guard is at least 0; the instant is
    located. The guard must be negative in the new mode. A transition without a guard is
    periodic.

    All transitions at one instant are evaluated with the values before any of them.
    Each changes those elements of the mode in which its new mode differs from the old
    one.

    Attributes:
        mode: The term of the new mode. None: the caller of a compiled run writes it;
            not for a KernelBlock.
        guard: The term of the guard, one number that is continuous between jumps. None:
            the transition is periodic.
        period: In s, > 0; infinity: once.
        offset: When a periodic transition happens first, s.
        is_discrete: Whether a periodic transition is a discrete update of Drake. Drake
            executes it after the unrestricted updates of the same instant and with
            their results.
    """

    mode: Term | None
    guard: Term | None = None
    period: float = math.inf
    offset: float = 0.0
    is_discrete: bool = False


class Packet(NamedTuple):
    """A sample of a signal, which is the output until the next packet is shown.

    Attributes:
        shown: The time from which it is shown, s.
        sent: The time when it was taken, s, <= shown.
        previous: The time when an earlier packet was taken, s, < sent. The signal
            continues from `shown` along the line through both packets. -infinity: the
            sample is held.
    """

    shown: float
    sent: float
    previous: float = -math.inf


@dataclass(frozen=True, kw_only=True)
class Delay:
    """A delay between an input port and an output port of a block.

    Attributes:
        signal: Name of the input port.
        output: Name of the output port.
        initial_value: The output before the first sample arrives.
        time: The delay T in s, > 0, or a function that returns the delay T(t) in s of
            the output at the time t in s: continuous, of slope < 1. Not used with
            packets. A string names the input of the block, or its result, that is T in
            s or, with a `length`, the position of a conveyor.
        length: The length of a conveyor, > 0. Its position, the signal `time`, is also
            the last element of the delayed signal, and turns at events only. The output
            was sent the last time that the position was less by this length. 0: `time`
            is a time.
        longest: The longest delay T that is a signal, s.
        shortest: The minimum of T(t), s, > 0; no step of Drake's may be longer.
        nonsmooth_times: The times at which the slope of T(t) jumps, s.
        end: The time until which T(t), or the arrival of the packets, is known, s.
        max_sample_interval: Longest time between two samples in Drake, s; infinity: one
            sample for each step. None: 0.01 s, or the shortest delay if that is less.
        period: The period of the packets in s. Packet k = 0, 1, ... is taken at
            k period and has the signal's value before the events of that instant.
        shown: A function that returns the time in s from which packet k is shown, which
            is infinity if it is lost. The packet is not shown if a newer packet has
            been shown by then. None: there are no packets, and the signal itself is
            delayed.
        extrapolates: Whether the signal continues from a packet along the line through
            that packet and the one that it replaces. Otherwise the value is held.
    """

    signal: str
    output: str
    initial_value: Sequence[float]
    time: float | Callable[[float], float] | str = math.inf
    length: float = 0.0
    longest: float = math.inf
    shortest: float = 0.0
    nonsmooth_times: Sequence[float] = ()
    end: float = math.inf
    max_sample_interval: float | None = None
    period: float = math.inf
    instants: Sequence[float] = ()
    shown: Callable[[int], float] | None = None
    extrapolates: bool = False

    @property
    def is_constant(self) -> bool:
        """Whether the delay is a number, which does not vary in a run."""
        return not (callable(self.time) or isinstance(self.time, str) or self.shown)


@dataclass(frozen=True, kw_only=True)
class Kernel:
    """The description of a block's computation.

    The functions take arrays of one dimension and return such an array; the time is a
    number, and a parameter has the type of its value. A function must be a graph of
    operations on numbers: it has no loop that ends when a number has converged.

    Attributes:
        outputs: The term of each output port. A port that is left out cannot be used in
            a compiled diagram. A name that is not a port is a result for other terms,
            with its width in `sizes`.
        rate: The time derivatives of the continuous state, a term; None without state.
        parameters: Numbers, arrays, and named tuples of them, by name. Another value
            of the same type needs no new compilation. The derived parameters are
            included. In a user's LeafSystem, the index that DeclareNumericParameter()
            returns stands for the value in the Context.
        derived: Parameters that follow from others, by name: a function, and the names
            of the parameters that it takes. They are computed once, not in each
            evaluation; `replace(kernel, parameters=...)` computes them anew.
        sizes: Width of the ports that are not vectors in Drake, and of other results.
        unused: Input ports that no term depends on, for example the inputs of a log. A
            KernelBlock need not name them.
        transitions: Changes of the mode, keyed by freely chosen names.
        initial_mode: The term of the mode at the start, without the name `mode`. None:
            the mode of the block's default Context. If a Context of Drake has no
            accuracy, no event is located, and other terms use this value of the mode
            at all times.
        delays: The delays of the block.
    """

    outputs: Mapping[str, Term] = field(default_factory=dict)
    rate: Term | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    derived: Mapping[str, tuple[Law | str, ...]] = field(default_factory=dict)
    sizes: Mapping[str, int] = field(default_factory=dict)
    unused: tuple[str, ...] = ()
    transitions: Mapping[str, Transition] = field(default_factory=dict)
    initial_mode: Term | None = None
    delays: Sequence[Delay] = ()

    def __post_init__(self) -> None:
        """Computes the derived parameters."""
        parameters = dict(self.parameters)
        for name, (function, *arguments) in self.derived.items():
            assert callable(function)
            taken = [parameters[key] for key in arguments]  # type: ignore[index]
            parameters[name] = function(*taken)
        object.__setattr__(self, "parameters", parameters)


def times(a: Any, b: Any) -> Any:
    """Returns a times b, element by element."""
    return a * b
