"""A channel of packets with jitter, loss and reordering, and its receiver."""

from collections.abc import Sequence

from pydrake.systems.framework import Context

from teleop_drake.loops.delays.base import ChannelBlock
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Receiver
from teleop_drake.loops.delays.packet_statistics import (
    ComputePacketStatistics,
    PacketStatistics,
)


class NetworkDelay(ChannelBlock):
    """Delays a vector signal in packets which a network delays, loses and reorders.

    Packet k carries signal(k h), h = sample period of the network, and arrives at
    network.Arrival(k) unless it is lost. With k the newest packet shown before t

        delayed_signal(t) = signal(k h)                          newest, playout
                          = signal(k h) + slope (t - arrival)    extrapolate

    The first packet is sent at t = 0, or at the first multiple of h in a run that
    begins later. Before t = 0 nothing is sent.

    See Receiver for the policies. With a constant delay and no loss, the policy
    `newest` gives the output of SampledDelay.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    State and treatment of jumps: those of PacketLine. The random numbers are not part
    of the state, because they are functions of the packet's number.

    Initial value: `initial_value` is delivered until the first packet is shown.

    Direct feedthrough: none, not even without delay, because the signal is sampled.

    It neither limits the rate of packets nor queues them. It extrapolates for as long
    as no newer packet arrives.

    Args:
        network: The network, which determines when each packet arrives.
        size: Width of the signal, >= 1.
        initial_value: The output before the first packet is shown (size); zeros if
            None.
        receiver: The policy of the receiver; None: it holds the newest packet.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        network: PacketNetwork,
        size: int,
        initial_value: Sequence[float] | None = None,
        *,
        receiver: Receiver | None = None,
    ):
        receiver = receiver or Receiver()
        ChannelBlock.__init__(
            self, delay=network.profile.delay, size=size, initial_value=initial_value
        )
        receiver.Check()
        self._network = network
        self._receiver = receiver
        self.DeclareDelay(
            period=network.sample_period,
            instants=network.Instants(),
            shown=lambda k: network.Shown(k, receiver),
            extrapolates=receiver.policy == "extrapolate",
            end=network.profile.duration,
        )

    def Statistics(self, context: Context) -> PacketStatistics:
        """Returns the statistics of the packets sent before the time of a Context."""
        return ComputePacketStatistics(
            self._network, self._receiver, context.get_time()
        )
