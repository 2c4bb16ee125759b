"""The description of a block's computation, from which it can be compiled.

A block offers a kernel with a method `Kernel()` of a few lines. It names pure
functions and what they take. The block's callbacks in Drake call the same functions;
those of a KernelBlock are made of the kernel.

    def Kernel(self) -> Kernel:
        return Kernel(
            parameters={"stiffness": self._stiffness},
            outputs={"force": (spring_force, "stiffness", "position")},
        )

A term says where a vector comes from:

    (function, "name", ..., 3)   what a function returns for what is named. An integer
                                 is handed over as it is; it belongs to the structure
                                 of the block, as sizes and indices do
    ["name", "name", ...]        one after another
    "name"                       the same
    ("name", 3, 5)               the elements from 3 to before 5, also in the place of
                                 a name

A name is that of an input port, of another output port (or `rate`), or of a parameter,
or `state`, `mode` or `time`: the continuous state, all discrete states one after
another, and the time in s.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

Law = Callable[..., Any]
Part = tuple[str, int, int]
Name = str | Part
Term = tuple[Law | Name | int, ...] | list[Name] | Name


@dataclass(frozen=True, kw_only=True)
class Transition:
    """A change of a block's mode, and with it of its equations.

    It happens as soon as the guard is not negative, at an instant that is located. In
    the new mode the guard must be negative. Without a guard it happens periodically.

    All transitions at one instant see what was there before any of them. Each changes
    the elements of the mode in which the new mode differs from that.

    Attributes:
        mode: The new mode, a term.
        guard: One number, continuous between jumps, a term; None: periodic.
        period: In s, > 0; infinity: once.
        offset: When a periodic transition happens first, s.
        is_discrete: Whether a periodic one is a discrete update of Drake, which comes
            after the unrestricted ones at an instant, and sees what they have made.
    """

    mode: Term
    guard: Term | None = None
    period: float = math.inf
    offset: float = 0.0
    is_discrete: bool = False


class Packet(NamedTuple):
    """A sample of a signal that is shown from some time on, until the next one is.

    Attributes:
        shown: When it is shown, s.
        sent: When it was taken, s, <= shown.
        previous: When the one was taken with which it makes a line that goes on from
            `shown`, s, < sent; -infinity: it is held.
    """

    shown: float
    sent: float
    previous: float = -math.inf


@dataclass(frozen=True, kw_only=True)
class Delay:
    """A signal that comes out of a block later.

    Attributes:
        signal: Name of the input port.
        output: Name of the output port.
        initial_value: What comes out at first.
        time: The delay T in s, > 0, or a function that returns T(t) at the time t in s
            when the signal comes out: continuous, of slope < 1. Not used with packets.
        shortest: Of T(t), s, > 0; no step of Drake's may be longer.
        nonsmooth_times: Where the slope of T(t) jumps, s.
        end: Until when T(t), or what becomes of packets, is known, s.
        max_sample_interval: Longest time between two samples in Drake, s; infinity: the
            steps are as they come. None: 0.01 s, or the shortest delay if that is less.
        period: Of the packets, in s; packet k is taken at k period, with what was there
            before the events at that instant.
        shown: Returns when packet k is shown, s, unless a newer one is by then;
            infinity: never. None: no packets, the signal itself comes out.
        extrapolates: Whether the signal goes on from a packet along the line through it
            and the one that it replaces; otherwise it is held.
    """

    signal: str
    output: str
    initial_value: Sequence[float]
    time: float | Callable[[float], float] = math.inf
    shortest: float = 0.0
    nonsmooth_times: Sequence[float] = ()
    end: float = math.inf
    max_sample_interval: float | None = None
    period: float = math.inf
    shown: Callable[[int], float] | None = None
    extrapolates: bool = False


@dataclass(frozen=True, kw_only=True)
class Kernel:
    """What a block computes.

    The functions take arrays of one dimension (the time is a number, a parameter is
    what it is) and return one. They have no loops that end when numbers have converged:
    what they do with numbers has to be a graph of operations.

    Attributes:
        outputs: What each output port delivers, a term. A port that is left out cannot
            be used in a compiled diagram. A name that is no port is a result for other
            terms, with its width in `sizes`.
        rate: The time derivatives of the continuous state, a term; None without state.
        parameters: Numbers, arrays, and named tuples of them, by name. Another value
            of the same kind compiles nothing anew. Those of `derived` are among them.
        derived: Parameters that follow from others, by name: a function, and the names
            of the parameters that it takes. They are computed once, not in each
            evaluation; `replace(kernel, parameters=...)` computes them anew.
        sizes: Width of the ports that are no vectors in Drake, and of other results.
        unused: Input ports that nothing of this depends on, such as a log's.
        transitions: Changes of the mode, by names of one's own.
        initial_mode: The mode at the start, a term without the mode; None: that of the
            block's default Context. Where a Context of Drake's has no accuracy, so that
            no event is located, this is the mode at any time.
        delays: What it delays.
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
        """Computes the parameters that follow from others."""
        parameters = dict(self.parameters)
        for name, (function, *arguments) in self.derived.items():
            assert callable(function)
            taken = [parameters[key] for key in arguments]  # type: ignore[index]
            parameters[name] = function(*taken)
        object.__setattr__(self, "parameters", parameters)


def times(a: Any, b: Any) -> Any:
    """Returns a times b, element by element."""
    return a * b
