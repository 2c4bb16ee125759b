"""The kinds of channels that a scenario can name."""

from teleop_drake.model.channels.base import ChannelConfig
from teleop_drake.model.channels.discrete import DiscreteChannelConfig
from teleop_drake.model.channels.named_networks import (
    GeoSatelliteChannelConfig,
    LeoSatelliteChannelConfig,
    LteChannelConfig,
    WifiChannelConfig,
)
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.channels.sampled import SampledChannelConfig
from teleop_drake.model.channels.transport import TransportChannelConfig
from teleop_drake.model.channels.variable import VariableChannelConfig
from teleop_drake.model.kinds import KindTable

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
