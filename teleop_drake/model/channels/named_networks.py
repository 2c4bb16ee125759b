"""Networks by name: kinds of channels with the delays and losses of a technology.

Each is the kind `network` with other defaults, all of which a scenario can change. The
jitter is a shifted gamma distribution, which fits delays on the Internet (A. Mukherjee,
On the dynamics and significance of low frequency components of Internet load,
Internetworking: Research and Experience 5, 1994). It is correlated from packet to
packet, and packets keep their order, as on one path through queues; see packet_network.
The correlation time is assumed, 1 s for all of them: M. S. Borella and G. B. Brewster
(Measurement and analysis of long-range dependent behavior of Internet packet delay,
INFOCOM 1998) find that delays stay correlated over many time scales, of which this is
one. Losses come in bursts (Gilbert and Elliott; see packet_network.Loss). All of these
are models: a measured `trace` is the better description of a particular network.

A round trip of mean m and standard deviation s is taken to consist of two equal and
independent ways, with the mean m / 2 and the standard deviation s / sqrt(2) each.
Values that no source states are marked "assumed".
"""

from dataclasses import field
from functools import partial

from teleop_drake.loops.delays.packet_options import Jitter, Loss
from teleop_drake.loops.framework.validation import Config
from teleop_drake.model.channels.network import NetworkChannelConfig

# The correlation time and the order are assumed.
_GAMMA = partial(Jitter, kind="gamma", correlation_time=1.0, keeps_order=True)
_BURST = partial(Loss, kind="burst")


@Config
class WifiChannelConfig(NetworkChannelConfig):
    """One hop of a large Wi-Fi with many users.

    Source: K. Sui et al., Characterizing and improving WiFi latency in large-scale
    operational networks, MobiSys 2016: round trips of 3 ms, read as the median, and of
    20 ms at the 90th percentile, over 47 000 devices. The gamma distribution with these
    two has a mean of 7.2 ms and a standard deviation of 10.8 ms. Its 99th percentile is
    51 ms; the source reports 250 ms.
    """

    kind = "wifi"
    delay: float = 0.0036
    # Assumed.
    sample_period: float = 0.005
    jitter: Jitter = field(default_factory=partial(_GAMMA, std=0.0076))
    # Assumed.
    loss: Loss = field(
        default_factory=partial(_BURST, probability=0.01, burst_length=3.0)
    )


@Config
class LteChannelConfig(NetworkChannelConfig):
    """A 4G connection with a good signal, from the mobile device to a server.

    Source: M. Trevisan, A. Safari Khatouni and D. Giordano, ERRANT: Realistic emulation
    of radio access networks, Computer Networks 176 (2020), and the profile of Telia,
    Sweden, 4G, good signal in its profiles.csv (github.com/marty90/errant): round trips
    of 91.9 ms on average with a standard deviation of 45.9 ms over many tests.
    """

    kind = "lte"
    delay: float = 0.0459
    # Assumed.
    sample_period: float = 0.01
    # The minimum is assumed.
    jitter: Jitter = field(default_factory=partial(_GAMMA, std=0.0325, minimum=0.01))
    # Assumed.
    loss: Loss = field(
        default_factory=partial(_BURST, probability=0.005, burst_length=3.0)
    )


@Config
class LeoSatelliteChannelConfig(NetworkChannelConfig):
    """A constellation of satellites in low orbit, as seen by a user at home.

    Source: F. Michel, M. Trevisan, D. Giordano and O. Bonaventure, A first look at
    Starlink performance, IMC 2022: round trips of 50 ms in the median, 40 to 60 ms
    between the quartiles, and 20 ms at least.
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


@Config
class GeoSatelliteChannelConfig(NetworkChannelConfig):
    """A satellite in geostationary orbit, up and down once.

    Source: D. Perdices, G. Perna, M. Trevisan, D. Giordano and M. Mellia, When
    satellite is all you have: watching the Internet from 550 ms, IMC 2022: round trips
    of 550 ms at least.
    """

    kind = "satellite_geo"
    # Assumed.
    delay: float = 0.325
    # Assumed.
    sample_period: float = 0.02
    # The standard deviation is assumed.
    jitter: Jitter = field(default_factory=partial(_GAMMA, std=0.02, minimum=0.275))
    # Assumed.
    loss: Loss = field(
        default_factory=partial(_BURST, probability=0.005, burst_length=3.0)
    )
