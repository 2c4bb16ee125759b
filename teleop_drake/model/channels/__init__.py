"""The communication between the stations: a file for each kind of channel."""

from teleop_drake.model.channels.base import ChannelConfig, ConstantDelay

__all__ = ["ChannelConfig", "ConstantDelay"]
