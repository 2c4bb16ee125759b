"""The kinds of channels that a scenario can name."""

from teleop_drake.loops.delays.base import ChannelConfig
from teleop_drake.loops.delays.discrete import DiscreteChannelConfig
from teleop_drake.loops.delays.named_networks import (
    GeoSatelliteChannelConfig,
    LeoSatelliteChannelConfig,
    LteChannelConfig,
    WifiChannelConfig,
)
from teleop_drake.loops.delays.network import NetworkChannelConfig
from teleop_drake.loops.delays.sampled import SampledChannelConfig
from teleop_drake.loops.delays.transport import TransportChannelConfig
from teleop_drake.loops.delays.variable import VariableChannelConfig
from teleop_drake.loops.framework.kinds import KindTable

CHANNEL_KINDS = KindTable(
    ChannelConfig,
    (
        TransportChannelConfig,
        VariableChannelConfig,
        SampledChannelConfig,
        DiscreteChannelConfig,
        NetworkChannelConfig,
        WifiChannelConfig,
        LteChannelConfig,
        LeoSatelliteChannelConfig,
        GeoSatelliteChannelConfig,
    ),
    noun="channel",
)
"""Every kind of channel, the default first."""
