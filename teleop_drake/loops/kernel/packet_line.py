"""Packets in Drake: delayed samples of a signal, made from a Delay of a kernel."""

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.kernel.delay_line import SentSignal
from teleop_drake.loops.kernel.events import DeclareTicks, ListedTicks, Ticks, Weakly
from teleop_drake.loops.kernel.kernel import Delay, Packet
from teleop_drake.loops.numerics.instants import same_within
from teleop_drake.loops.numerics.sample_history import SampleHistory


def PacketsBetween(delay: Delay, begin: float, end: float) -> list[Packet]:
    """Returns the packets that a run sends between two times in s, by their `shown`.

    Those that are lost, or overtaken by another one of them, are left out. A run that
    begins after time 0 has not sent the earlier packets, so no packet replaces them.
    """
    assert delay.shown is not None
    packets: list[Packet] = []
    ticks = TicksOf(delay)
    for k in itertools.count(ticks.From(begin)):
        sent = ticks.TimeOf(k)
        if sent > end:
            break
        shown = delay.shown(k)
        if shown == math.inf:  # A lost packet replaces no other one.
            continue
        # A packet that arrives no later than older ones replaces them.
        while packets and packets[-1].shown >= shown:
            packets.pop()
        previous = -math.inf
        if delay.extrapolates and packets:
            previous = packets[-1].sent
        packets.append(Packet(shown, sent, previous))
    return packets


def TicksOf(delay: Delay) -> Ticks | ListedTicks:
    """Returns the instants when the packets of a delay are taken."""
    return ListedTicks(delay.instants) if delay.instants else Ticks(delay.period)


class _Sent(NamedTuple):
    """A packet under way.

    Attributes:
        shown: The time when it is shown, s.
        sent: The time when it was sent, s; -infinity for the initial value.
        value: Its value.
        earlier: Time and value of the earlier packet through which the signal continues
            along a line; None: the value is held.
    """

    shown: float
    sent: float
    value: Any
    earlier: tuple[float, Array] | None = None


class _Packets(NamedTuple):
    """The packet that is shown, followed by the packets that were sent later.

    `next` is the number of the next packet to be sent. A packet that is lost is left
    out. The object is immutable, so that a copy of the state shares it.
    """

    next: int
    packets: tuple[_Sent, ...]

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Packets":
        return self

    def NewestBefore(self, time: float) -> _Sent:
        """Returns the newest packet that is shown before a time in s."""
        shown = (x for x in reversed(self.packets) if x.shown < time)
        return next(shown, self.packets[0])


class PacketLine:
    """Stores the packets of a block and shows each after its delay.

    Its state is one abstract value: the packet that is shown and those under way.

    A packet is taken in an unrestricted update and has the signal's value before all
    other updates of that instant; see events. No event of Drake marks the times when
    packets are shown. A step should therefore end at NextJumpTime(), as it does in
    simulate(). Otherwise the integrator has to find the jump by rejecting steps. At the
    very instant the output has the value before the jump until the unrestricted update
    at the end of that step, so blocks that record jumps see both sides.

    Attributes:
        signal: The input port.
        tickets: The prerequisites of the output.
        is_constant: Whether the delay does not vary in a run: never.

    Args:
        block: The block, which has declared its inputs.
        delay: The delay in the block's kernel.
        parameter: Not used: packets have no constant delay.
    """

    is_constant = False

    def __init__(self, block: LeafSystem, delay: Delay, parameter: str):
        assert delay.shown is not None
        self._delay = delay
        self._shown = delay.shown
        self._ticks = TicksOf(delay)
        self.signal = block.GetInputPort(delay.signal)
        self._nothing = _Sent(
            shown=-math.inf,
            sent=-math.inf,
            value=self.InitialValue(),
        )
        packets = AbstractValue.Make(_Packets(0, (self._nothing,)))
        self._packets = block.DeclareAbstractState(packets)
        self.tickets = {
            block.time_ticket(),
            block.abstract_state_ticket(self._packets),
        }
        DeclareTicks(block, self._ticks, self._Send)
        block.DeclarePerStepUnrestrictedUpdateEvent(Weakly(self._Deliver))

    def IsUnderWay(self, context: Context) -> bool:
        """Returns whether a packet has been sent."""
        return self._PacketsIn(context).next > 0

    def LongestStep(self, context: Context) -> float:
        """Returns infinity: packets do not limit a step that ends at NextJumpTime()."""
        return math.inf

    def NextJumpTime(self, context: Context) -> float:
        """Returns when the next packet will be shown (s), infinity if none is known."""
        number, packets = self._PacketsIn(context)
        jump = min((x.shown for x in packets[1:]), default=math.inf)
        # A run that begins after time 0 has not sent the earlier packets.
        number = max(number, self._ticks.From(context.get_time()))
        # The next packet may be sent and also arrive during the next step.
        if self._ticks.TimeOf(number) > self._delay.end:
            return jump
        return min(jump, self._shown(number))

    def BeginStep(self, context: Context) -> None:
        """Does nothing: no jump changes a packet."""

    def InitialValue(self) -> Any:
        """Returns the value that is shown before the first packet."""
        return np.array(self._delay.initial_value, float)

    def Take(self, context: Context) -> Any:
        """Returns a copy of the signal, the value of a packet."""
        return self.signal.Eval(context).copy()

    def Shown(self, context: Context) -> "_Sent":
        """Returns the packet that is shown."""
        time = context.get_time()
        # A packet that arrives now is shown only after the step has ended here.
        return self._PacketsIn(context).NewestBefore(time - same_within(time))

    def Eval(self, context: Context) -> Array:
        """Returns the value that is shown."""
        time = context.get_time()
        packet = self.Shown(context)
        value: Array = packet.value.copy()
        if packet.earlier is not None:
            sent, earlier = packet.earlier
            value += (value - earlier) / (packet.sent - sent) * (time - packet.shown)
        return value

    def Sent(self, context: Context) -> SentSignal:
        """Returns what has been sent until the time of a Context."""
        samples = {context.get_time(): self.signal.Eval(context)}
        for packet in self._PacketsIn(context).packets:
            samples[packet.sent] = packet.value
            if packet.earlier is not None:
                sent, value = packet.earlier
                samples[sent] = value
        samples.pop(-math.inf, None)
        times = sorted(samples)
        values = tuple(samples[time] for time in times)
        return SentSignal(SampleHistory(times=tuple(times), values=values), shift=0.0)

    def SetSent(
        self, context: Context, begin: float, signal: Callable[[Array], Array]
    ) -> None:
        """Sets what was sent before the time of a Context.

        Args:
            begin: The time from which on packets were sent, s.
            signal: Returns the signal (k, size) at times in s (k), before jumps.
        """
        time = context.get_time()
        end = time - same_within(time)
        sent = PacketsBetween(self._delay, begin, end)
        values = signal(np.array([x.sent for x in sent]))
        earlier = signal(np.array([x.previous for x in sent]))
        packets = [self._nothing]
        for i, packet in enumerate(sent):
            has_earlier = packet.previous > -math.inf
            new = _Sent(
                shown=packet.shown,
                sent=packet.sent,
                value=values[i],
                earlier=(packet.previous, earlier[i]) if has_earlier else None,
            )
            if packet.shown < end:
                packets.clear()
            packets.append(new)
        number = self._ticks.From(time)
        context.SetAbstractState(self._packets, _Packets(number, tuple(packets)))

    def _PacketsIn(self, context: Context) -> _Packets:
        return context.get_abstract_state(self._packets).get_value()

    def _Send(self, context: Context, state: State) -> None:
        """Takes the packet of this instant, and adds it to those under way."""
        k = self._ticks.At(context.get_time())
        assert k is not None
        packets = self._PacketsIn(context)
        packet = _Sent(
            shown=self._shown(k),
            sent=self._ticks.TimeOf(k),
            value=self.Take(context),
        )
        previous = packets.NewestBefore(packet.shown)
        if self._delay.extrapolates and previous.sent > -math.inf:
            packet = packet._replace(earlier=(previous.sent, previous.value))
        new = [packet] if packet.shown < math.inf else []
        packets = _Packets(k + 1, (*packets.packets, *new))
        state.get_mutable_abstract_state(self._packets).set_value(packets)

    def _Deliver(self, context: Context, state: State) -> EventStatus:
        """Removes the packets that are older than the one shown from now on."""
        # A packet that is sent now may be delivered now.
        number, packets = state.get_abstract_state(self._packets).get_value()
        time = context.get_time()
        now = time + same_within(time)
        # The index of the newest packet whose time has come.
        first = max(i for i, x in enumerate(packets) if x.shown <= now)
        if first == 0:
            return EventStatus.DidNothing()
        left = _Packets(number, packets[first:])
        state.get_mutable_abstract_state(self._packets).set_value(left)
        return EventStatus.Succeeded()
