"""What a task of the delay standard consists of, and delays that are wrong."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

# Of t in s, an exact number.
Signal = Callable[[Fraction], float]

STEP = Fraction(1, 100)
"""Step of a simulator whose step is fixed, s. Jumps fall between two steps."""

MILLISECOND = Fraction(1, 1000)
"""By how much a delay is too long in the fault `delay_error`, s."""

EXACT = 1e-6
"""Tube of signals that a fixed step represents exactly: of single precision."""


@dataclass
class Task:
    """A task: its answers at some instants.

    Attributes:
        instants: In s.
        signals: The right answers, by name.
        tubes: Half the width of each signal's tube.
        faults: By the name of a fault, the signals as they are with it. Signals that
            the fault leaves right are not there.
    """

    instants: list[Fraction]
    signals: dict[str, Signal]
    tubes: dict[str, float]
    faults: dict[str, dict[str, Signal]] = field(default_factory=dict)


def every(period: Fraction, end: Fraction, but: Sequence[Fraction] = ()) -> list:
    """Returns the multiples of a period until an end, without some of them."""
    count = math.floor(end / period)
    return [k * period for k in range(1, count + 1) if k * period not in but]


def ramp(t: Fraction) -> float:
    return float(t)


def step_at(instant: Fraction) -> Signal:
    return lambda t: float(t >= instant)


def echo(signal: Signal, T: Fraction, initial: float = 0.0) -> Signal:
    """Returns a signal a delay T later; before, the initial value."""
    return lambda t: signal(t - T) if t >= T else initial


def delay_faults(make: Callable[[Fraction], Signal], T: Fraction) -> dict[str, Signal]:
    """Returns a signal as it is with a wrong delay, by the fault."""
    return {
        "one_step_early": make(T - STEP),
        "one_step_late": make(T + STEP),
        "half_delay": make(T / 2),
        "double_delay": make(2 * T),
        "no_delay": make(Fraction(0)),
        "delay_error": make(T + MILLISECOND),
    }


def by_fault(faults: dict[str, dict[str, Signal]]) -> dict[str, dict[str, Signal]]:
    """Turns faults by signal into signals by fault."""
    result: dict[str, dict[str, Signal]] = {}
    for name, answers in faults.items():
        for fault, answer in answers.items():
            result.setdefault(fault, {})[name] = answer
    return result
