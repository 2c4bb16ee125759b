"""Packets with fates of their own: jitter, loss, reordering, and a receiver."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    EventStatus,
    LeafSystem,
    State,
)

from teleop_drake.channels.base import CheckChannel, ConstantDelay
from teleop_drake.channels.packet_network import Jitter, Loss, PacketNetwork
from teleop_drake.channels.packet_statistics import (
    ComputePacketStatistics,
    PacketStatistics,
)
from teleop_drake.channels.receiver import CheckReceiver, Receiver
from teleop_drake.channels.sampled import CheckSamplePeriod
from teleop_drake.channels.varying_delay import VaryingDelayConfig
from teleop_drake.integrator.problem import TIE
from teleop_drake.kernel import Delay, Kernel, Packet
from teleop_drake.kernel.ticks import DeclareTicks, Ticks
from teleop_drake.validation import (
    REQUIRED,
    CheckNumber,
    Refuse,
    ScenarioError,
    Within,
)


@dataclass(frozen=True)
class _Packet:
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
    packets: tuple[_Packet, ...]

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Packets":
        return self

    def Send(
        self, k: int, packet: _Packet, time: float, *, is_line: bool
    ) -> "_Packets":
        """Adds packet k which will be shown at a time, or never."""
        if time == math.inf:
            return replace(self, next=k + 1)
        keep = max(bisect_left(self.times, time), 1)
        previous = self.packets[keep - 1]
        if is_line and previous.stamp > -math.inf:
            gap = packet.stamp - previous.stamp
            packet = _Packet(
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


class NetworkDelay(LeafSystem):
    """Delays a vector signal in packets which a network delays, loses and reorders.

    Packet k carries signal(k h), h = sample period of the network, and arrives at
    network.Arrival(k), if ever. With the newest packet k that has arrived before t

        delayed_signal(t) = signal(k h)                          newest, playout
                          = signal(k h) + slope (t - arrival)    extrapolate

    See Receiver for the policies. With a constant delay and no loss, `newest` is
    SampledDelay.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    State: the packet shown and those under way (one abstract value). The random
    numbers are no state: they are functions of the packet's number.

    Jumps: packets are sent in an unrestricted update, with what was there before other
    updates at the same instant; see ticks. They arrive at times of their own, which no
    event of Drake marks: a step should end at NextJumpTime(), as simulate() makes it,
    or the integrator has to find the jump by refusing steps. At the very instant the
    output keeps the value before the jump until the unrestricted update at the end of
    that step, so blocks that record jumps see both sides.

    Initial value: `initial_value` is delivered until the first packet is shown.

    Direct feedthrough: none, not even without delay: then the signal is sampled.

    It neither limits the rate nor queues packets, and extrapolates however long the
    next one takes.

    Args:
        network: What happens to the packets.
        receiver: What the receiver does with them; holds the newest one if None.
        size: Width of the signal, >= 1.
        initial_value: What is delivered at first (size); zeros if None.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        *,
        network: PacketNetwork,
        receiver: Receiver | None = None,
        size: int,
        initial_value: Sequence[float] | None = None,
    ):
        LeafSystem.__init__(self)
        CheckChannel(
            delay=network.profile.delay, size=size, initial_value=initial_value
        )
        self._network = network
        self._receiver = receiver or Receiver()
        CheckReceiver(self._receiver)
        initial = (
            [0.0] * size if initial_value is None else [float(x) for x in initial_value]
        )
        self._initial_value = initial
        self._signal = self.DeclareVectorInputPort("signal", size)
        self._packets = self.DeclareAbstractState(
            AbstractValue.Make(
                _Packets(0, (-math.inf,), (_Packet(-math.inf, tuple(initial)),))
            )
        )
        self.DeclareVectorOutputPort(
            "delayed_signal",
            size,
            self._CalcDelayedSignal,
            prerequisites_of_calc={
                self.time_ticket(),
                self.abstract_state_ticket(self._packets),
            },
        )
        self._tie = TIE * network.sample_period
        DeclareTicks(self, Ticks(network.sample_period), self._Send)
        self.DeclarePerStepUnrestrictedUpdateEvent(self._Deliver)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        return Kernel(
            delays=[
                Delay(
                    signal="signal",
                    output="delayed_signal",
                    initial_value=self._initial_value,
                    packets=self._PacketsUntil,
                )
            ]
        )

    def _PacketsUntil(self, end: float) -> list[Packet]:
        """Returns the packets that are shown until a time, as _Packets has them."""
        h, is_line = self._network.sample_period, self._receiver.policy == "extrapolate"
        packets: list[Packet] = []
        for k in range(math.floor(end / h) + 1):
            shown = self._network.Shown(k, self._receiver)
            if shown > end:
                # Lost, or never seen; if it is seen by nobody it overtakes nobody.
                continue
            while packets and packets[-1].shown >= shown:
                packets.pop()
            previous = packets[-1].sent if is_line and packets else -math.inf
            packets.append(Packet(shown=shown, sent=k * h, previous=previous))
        return packets

    def NextJumpTime(self, context: Context) -> float:
        """Returns when the next packet will be shown (s), infinity if none is known.

        A step that ends at this very time is not disturbed by the jump.

        Args:
            context: The Context of this block.
        """
        packets = context.get_abstract_state(self._packets).get_value()
        jump = packets.times[1] if len(packets.times) > 1 else math.inf
        # One that is sent during the next step may arrive within it.
        if packets.next * self._network.sample_period > self._network.profile.duration:
            return jump
        return min(jump, self._network.Shown(packets.next, self._receiver))

    def Statistics(self, context: Context) -> PacketStatistics:
        """Returns what has become of the packets sent before now.

        Args:
            context: The Context of this block.
        """
        return ComputePacketStatistics(
            self._network, self._receiver, context.get_time()
        )

    def _Send(self, context: Context, state: State) -> None:
        packets = context.get_abstract_state(self._packets).get_value()
        k = round(context.get_time() / self._network.sample_period)
        shown = self._network.Shown(k, self._receiver)
        sent = k * self._network.sample_period
        packet = _Packet(sent, tuple(self._signal.Eval(context).tolist()))
        is_line = self._receiver.policy == "extrapolate"
        state.get_mutable_abstract_state(self._packets).set_value(
            packets.Send(k, packet, shown, is_line=is_line)
        )

    def _Deliver(self, context: Context, state: State) -> EventStatus:
        # What is sent now may be delivered now.
        packets = state.get_abstract_state(self._packets).get_value()
        now = context.get_time() + self._tie
        if len(packets.times) == 1 or packets.times[1] > now:
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(self._packets).set_value(packets.Deliver(now))
        return EventStatus.Succeeded()

    def _CalcDelayedSignal(self, context: Context, output: BasicVector) -> None:
        packets = context.get_abstract_state(self._packets).get_value()
        time = context.get_time()
        # What arrives now is shown once the step has ended here.
        i = max(bisect_left(packets.times, time - self._tie) - 1, 0)
        packet = packets.packets[i]
        if packet.slope is None:
            output.SetFromVector(packet.value)
        else:
            elapsed = time - packets.times[i]
            output.SetFromVector(
                [
                    x + slope * elapsed
                    for x, slope in zip(packet.value, packet.slope, strict=True)
                ]
            )


@dataclass(kw_only=True, eq=False)
class NetworkChannelConfig(VaryingDelayConfig):
    """Sends a packet each sample period through a network that has its ways with it."""

    kind = "network"
    draws_random_numbers: ClassVar[bool] = True
    has_packet_statistics: ClassVar[bool] = True

    # Time between packets, s, > 0.
    sample_period: float = REQUIRED
    # Whether entry k of the trace is that of packet k, whatever its time; a column of
    # times may be missing then.
    trace_is_numbered: bool = False
    jitter: Jitter = field(default_factory=Jitter)
    loss: Loss = field(default_factory=Loss)
    receiver: Receiver = field(default_factory=Receiver)

    def Check(self, path: str, duration: float) -> None:
        """Checks every field; reads the trace.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: How long the simulation lasts, s.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        super().Check(path, duration)
        CheckSamplePeriod(path, self.sample_period, self.delay)
        self.Network(duration, path=path)
        with Within(path):
            CheckReceiver(self.receiver)

    def Network(
        self, duration: float, *, stream: str = "", path: str = "channel"
    ) -> PacketNetwork:
        """Returns what happens to the packets.

        Args:
            duration: How long packets are sent, s.
            stream: Name of the random numbers.
            path: The channel's field in a scenario, for messages.

        Raises:
            ScenarioError: If a field is not allowed.
        """
        CheckNumber(f"{path}.sample_period", self.sample_period, "s", above=0)
        trace = self.MeasuredDelays(duration, path)
        profile = self.ProfileOf(trace, duration, path)
        with Within(path):
            return PacketNetwork(
                profile=profile,
                is_lost=None if trace is None else trace.IsLost,
                sample_period=self.sample_period,
                jitter=self.jitter,
                loss=self.loss,
                seed=self.seed,
                stream=stream,
            )

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> NetworkDelay:
        """Makes the block; see ChannelConfig.MakeChannel.

        Args:
            size: Width of the packets.
            initial_value: What arrives before the first packet does (size).
            duration: How long packets are sent, s.
            stream: Name of the random numbers; another one gives other numbers.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """
        return NetworkDelay(
            network=self.Network(duration, stream=stream),
            receiver=self.receiver,
            size=size,
            initial_value=initial_value,
        )

    def EntryPeriod(self) -> float | None:
        """Returns the sample period in s if the trace's entries are the packets."""
        return self.sample_period if self.trace_is_numbered else None

    def PacketPeriod(self) -> float:
        """Returns the sample period in s."""
        return self.sample_period

    def Arrivals(
        self, sent: ArrayLike, duration: float, stream: str = ""
    ) -> NDArray[np.float64]:
        """Returns when the packets sent nearest to given times arrive; lost: infinity.

        Args:
            sent: Times in s, 0 to `duration` (N,).
            duration: How long packets are sent, s.
            stream: Name of the random numbers, as in MakeChannel.

        Raises:
            ScenarioError: If a field is not allowed.
        """
        network = self.Network(duration, stream=stream)
        last = math.floor(duration / self.sample_period)
        numbers = np.round(np.asarray(sent, dtype=float) / self.sample_period)
        return np.array([network.Arrival(int(k)) for k in np.minimum(numbers, last)])

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the mean age of information behind the receiver.

        It is that of this network's own packets: their delays, losses, order and seed.

        Args:
            path: The channel's field in a scenario, which names the random numbers.
            duration: How long packets are sent, s.

        Raises:
            ScenarioError: If the receiver extrapolates, which is no delay, or no
                packet arrives.
        """
        if self.receiver.policy == "extrapolate":
            Refuse(
                f"{path}.receiver.policy",
                self.receiver.policy,
                "newest or playout, because what extrapolates is not a delay",
            )
        network = self.Network(duration, stream=path, path=path)
        age = ComputePacketStatistics(network, self.receiver, duration).age_mean
        if age is None:
            raise ScenarioError(
                f"{path}: must deliver a packet within the duration, {duration:g} s, "
                "and does not"
            )
        return ConstantDelay(
            delay=age,
            note=f"{path}: packets have delays of their own; the margins hold for a "
            f"constant delay, here the mean age of what is received, {age:.4g} s.",
        )
