"""Packets in Drake: samples of a signal under way, made of a Delay of a kernel."""

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from teleop_drake.integrator.problem import TIE
from teleop_drake.kernel.callbacks import Weakly
from teleop_drake.kernel.kernel import Delay, Packet
from teleop_drake.kernel.ticks import DeclareTicks, Ticks


def PacketsUntil(delay: Delay, end: float) -> list[Packet]:
    """Returns the packets that are shown until a time in s, by ascending `shown`."""
    assert delay.shown is not None
    packets: list[Packet] = []
    for k in range(math.floor(end / delay.period) + 1):
        shown = delay.shown(k)
        if shown > end:
            # Lost, or never seen; if it is seen by nobody it overtakes nobody.
            continue
        while packets and packets[-1].shown >= shown:
            packets.pop()
        previous = packets[-1].sent if delay.extrapolates and packets else -math.inf
        packets.append(Packet(shown=shown, sent=k * delay.period, previous=previous))
    return packets


@dataclass(frozen=True)
class _Sent:
    """What arrives, and the slope (per s) with which the signal goes on from it."""

    stamp: float
    value: tuple[float, ...]
    slope: tuple[float, ...] | None = None


@dataclass(frozen=True)
class _Packets:
    """The packet that is shown and those under way, in the order of both their time
    stamps and the times at which they will be shown.

    One that a newer packet overtakes will never be shown and is left out. `next` is the
    number of the next one to be sent. Immutable, so that a copy of the state is the
    object itself.
    """

    next: int
    times: tuple[float, ...]
    packets: tuple[_Sent, ...]

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Packets":
        return self

    def Send(self, k: int, packet: _Sent, time: float, *, is_line: bool) -> "_Packets":
        """Adds packet k which will be shown at a time, or never."""
        if time == math.inf:
            return replace(self, next=k + 1)
        keep = max(bisect_left(self.times, time), 1)
        previous = self.packets[keep - 1]
        if is_line and previous.stamp > -math.inf:
            gap = packet.stamp - previous.stamp
            packet = _Sent(
                packet.stamp,
                packet.value,
                tuple(
                    (b - a) / gap
                    for a, b in zip(previous.value, packet.value, strict=True)
                ),
            )
        return _Packets(
            k + 1, (*self.times[:keep], time), (*self.packets[:keep], packet)
        )

    def Deliver(self, time: float) -> "_Packets":
        """Drops what is older than what is shown once all is done at a time."""
        first = bisect_right(self.times, time) - 1
        return _Packets(self.next, self.times[first:], self.packets[first:])


class PacketLine:
    """Keeps the packets of a block under way and shows them later.

    Its state is the packet shown and those under way (one abstract value).

    Packets are taken in an unrestricted update, with what was there before other
    updates at the same instant; see ticks. They are shown at times of their own, which
    no event of Drake marks: a step should end at NextJumpTime(), as simulate() makes
    it, or the integrator has to find the jump by refusing steps. At the very instant
    the output keeps the value before the jump until the unrestricted update at the end
    of that step, so blocks that record jumps see both sides.

    Attributes:
        tickets: What the output depends on.
        longest_step: Infinity: what is shown in a step was known before or ends it.

    Args:
        block: The block, which has declared its inputs.
        delay: What it delays.
    """

    longest_step = math.inf

    def __init__(self, block: LeafSystem, delay: Delay):
        self._delay = delay
        self._signal = block.GetInputPort(delay.signal)
        nothing = _Sent(-math.inf, tuple(map(float, delay.initial_value)))
        packets = AbstractValue.Make(_Packets(0, (-math.inf,), (nothing,)))
        self._packets = block.DeclareAbstractState(packets)
        self.tickets = {
            block.time_ticket(),
            block.abstract_state_ticket(self._packets),
        }
        self._tie = TIE * delay.period
        DeclareTicks(block, Ticks(delay.period), self._Send)
        block.DeclarePerStepUnrestrictedUpdateEvent(Weakly(self._Deliver))

    def NextJumpTime(self, context: Context) -> float:
        """Returns when the next packet will be shown (s), infinity if none is known."""
        packets = self._PacketsIn(context)
        jump = packets.times[1] if len(packets.times) > 1 else math.inf
        # One that is sent during the next step may arrive within it.
        if packets.next * self._delay.period > self._delay.end:
            return jump
        return min(jump, self._Shown(packets.next))

    def Eval(self, context: Context) -> NDArray[np.float64]:
        """Returns what is shown."""
        packets, time = self._PacketsIn(context), context.get_time()
        # What arrives now is shown once the step has ended here.
        i = max(bisect_left(packets.times, time - self._tie) - 1, 0)
        packet = packets.packets[i]
        value = np.array(packet.value)
        if packet.slope is not None:
            value += np.array(packet.slope) * (time - packets.times[i])
        return value

    def _PacketsIn(self, context: Context) -> _Packets:
        packets: _Packets = context.get_abstract_state(self._packets).get_value()
        return packets

    def _Shown(self, k: int) -> float:
        assert self._delay.shown is not None
        return self._delay.shown(k)

    def _Send(self, context: Context, state: State) -> None:
        k = round(context.get_time() / self._delay.period)
        value = tuple(self._signal.Eval(context).tolist())
        packets = self._PacketsIn(context).Send(
            k,
            _Sent(k * self._delay.period, value),
            self._Shown(k),
            is_line=self._delay.extrapolates,
        )
        state.get_mutable_abstract_state(self._packets).set_value(packets)

    def _Deliver(self, context: Context, state: State) -> EventStatus:
        # What is sent now may be delivered now.
        packets = state.get_abstract_state(self._packets).get_value()
        now = context.get_time() + self._tie
        if len(packets.times) == 1 or packets.times[1] > now:
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(self._packets).set_value(packets.Deliver(now))
        return EventStatus.Succeeded()
