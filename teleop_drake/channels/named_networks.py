"""Networks by name: kinds of channels with the delays and losses of a technology.

Each is the kind `network` with other defaults, all of which a scenario can change. The
jitter is a shifted gamma distribution, which fits delays on the Internet (A. Mukherjee,
Internetworking: Research and Experience 5, 1994), independent from packet to packet;
losses come in bursts (Gilbert and Elliott; see packet_network.Loss). Both are models:
a measured `trace` is the better description of one's own network.

A round trip of mean m and standard deviation s is taken for two equal and independent
ways, m / 2 and s / sqrt(2) each. What no source states is marked "assumed".
"""

from dataclasses import dataclass, field
from functools import partial

from teleop_drake.channels.network import NetworkChannelConfig
from teleop_drake.channels.packet_network import Jitter, Loss

_GAMMA = partial(Jitter, kind="gamma")
_BURST = partial(Loss, kind="burst")


@dataclass(kw_only=True, eq=False)
class WifiChannelConfig(NetworkChannelConfig):
    """One hop of a Wi-Fi at home or in an office, with a good signal.

    Source: the preset `wifi` of the network emulator str0m-netem 0.2 (docs.rs), 5 ms
    with 2 ms of jitter and about 1 % of loss in bursts.
    """

    kind = "wifi"
    delay: float = 0.005
    # Assumed.
    sample_period: float = 0.005
    # The minimum is assumed.
    jitter: Jitter = field(default_factory=partial(_GAMMA, std=0.002, minimum=0.001))
    # The length of the bursts is assumed.
    loss: Loss = field(
        default_factory=partial(_BURST, probability=0.01, burst_length=3.0)
    )


@dataclass(kw_only=True, eq=False)
class LteChannelConfig(NetworkChannelConfig):
    """A 4G connection with a good signal, from the mobile device to a server.

    Source: round trips of 54.5 ms on average with a standard deviation of 23.6 ms,
    measured by MONROE nodes (M. Trevisan, mobile-latency-emulator, github.com/marty90,
    profile_info.txt: Telia, 4G, good signal, no roaming).
    """

    kind = "lte"
    delay: float = 0.0272
    # Assumed.
    sample_period: float = 0.01
    # The minimum is assumed.
    jitter: Jitter = field(default_factory=partial(_GAMMA, std=0.0167, minimum=0.01))
    # Assumed.
    loss: Loss = field(
        default_factory=partial(_BURST, probability=0.005, burst_length=3.0)
    )


@dataclass(kw_only=True, eq=False)
class LeoSatelliteChannelConfig(NetworkChannelConfig):
    """A constellation of satellites in low orbit, as seen by a user at home.

    Source: round trips of 50 ms in the median, 40 to 60 ms between the quartiles, and
    20 ms at least (F. Michel et al., A first look at Starlink performance, IMC 2022).
    The quartiles of a normal distribution of round trips lie 20 ms apart if their
    standard deviation is 14.8 ms, which is 10.5 ms each way.
    """

    kind = "satellite_leo"
    delay: float = 0.026
    # Assumed.
    sample_period: float = 0.01
    jitter: Jitter = field(default_factory=partial(_GAMMA, std=0.0105, minimum=0.01))
    # Assumed; at a handover a tenth of a second may be lost.
    loss: Loss = field(
        default_factory=partial(_BURST, probability=0.01, burst_length=10.0)
    )


@dataclass(kw_only=True, eq=False)
class GeoSatelliteChannelConfig(NetworkChannelConfig):
    """A satellite in geostationary orbit, up and down once.

    Source: the way up and down is at least 2 times 35 786 km, 0.2387 s at the speed of
    light; a round trip typically takes 650 ms (G. Huston, notes from IETF 115, 2022).
    """

    kind = "satellite_geo"
    delay: float = 0.325
    # Assumed.
    sample_period: float = 0.02
    # The standard deviation is assumed.
    jitter: Jitter = field(default_factory=partial(_GAMMA, std=0.02, minimum=0.2387))
    # Assumed.
    loss: Loss = field(
        default_factory=partial(_BURST, probability=0.005, burst_length=3.0)
    )
