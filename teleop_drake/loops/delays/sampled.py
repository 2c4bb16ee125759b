"""Packets at a fixed rate, each held until the next one."""

import math
from collections.abc import Callable, Sequence

from pydrake.systems.framework import LeafSystem

from teleop_drake.loops.delays.base import ChannelBlock
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import (
    CheckNumber,
    Refuse,
)
from teleop_drake.loops.kernel.events import DeclareTicks, Ticks
from teleop_drake.loops.kernel.linear_part import LinearPart, Sampling
from teleop_drake.loops.numerics.instants import TIE


class SampledDelay(ChannelBlock):
    """Delays a vector signal that is sent in packets and held between them.

        delayed_signal(t) = signal(k h)    for k h + delay < t <= (k + 1) h + delay

    with the sample period h. The delay seen by the signal therefore sweeps from
    `delay` to `delay + h`; its mean is (n + 1/2) h for delay = n h. The delay need
    not be a multiple of the sample period.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    State and treatment of jumps: those of PacketLine. A step also ends at each delivery
    of a packet.

    Initial value: `initial_value` is delivered until the first packet arrives. It is
    sent at t = 0, or at the first multiple of h in a run that begins later; before
    t = 0 nothing is sent.

    Direct feedthrough: none, unless delay is 0. Then the block is a pass-through
    with neither state nor events, which does not sample the signal.

    It does not interpolate, lose, reorder or jitter packets.

    Args:
        delay: Delay of a packet in s, >= 0.
        sample_period: h in s, > 0, at most the delay (unless the delay is 0).
        size: Width of the signal, >= 1.
        initial_value: The output before the first packet arrives (size); zeros if None.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        delay: float,
        sample_period: float,
        size: int,
        initial_value: Sequence[float] | None = None,
    ):
        ChannelBlock.__init__(self, delay=delay, size=size, initial_value=initial_value)
        CheckNumber("sample_period", sample_period, "s", above=0)
        CheckAtMostDelay("sample_period", sample_period, delay)
        self._sampling = Sampling(sample_period, delay)
        if delay == 0:
            self.DeclarePassThrough()
            return
        self.DeclareDelay(period=sample_period, shown=ShownAfter(delay, sample_period))
        DeclareDeliveries(self, delay, sample_period)

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns the sampling as a linear part."""
        if self._sampling.delay == 0:
            return LinearPart()
        return LinearPart(sampling=self._sampling)


def _Split(delay: float, sample_period: float) -> tuple[int, float]:
    """Returns a delay in s as a number of sample periods, and the rest in s."""
    # With the margin, 0.1 / 0.01 is ten whole periods in spite of rounding.
    num_periods = math.floor(delay / sample_period + TIE)
    rest = delay - num_periods * sample_period
    return num_periods, rest if rest > TIE * sample_period else 0.0


def ShownAfter(delay: float, sample_period: float) -> Callable[[int], float]:
    """Returns a function that returns when packet k, k = 0, 1, ..., is shown, s."""
    num_periods, rest = _Split(delay, sample_period)
    # Rounded as Drake rounds the times of periodic events.
    return lambda k: rest + (k + num_periods) * sample_period


def DeclareDeliveries(block: LeafSystem, delay: float, sample_period: float) -> None:
    """Declares that a step ends whenever a packet of a block is shown."""
    _, rest = _Split(delay, sample_period)
    DeclareTicks(block, Ticks(sample_period, rest), None)


def CheckAtMostDelay(path: str, sample_period: float, delay: float) -> None:
    """Refuses a sample period that is longer than a delay other than 0, both in s."""
    if 0 < delay < sample_period:
        Refuse(path, sample_period, f"at most the delay, {delay:g} (s)")
