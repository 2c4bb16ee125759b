"""What a network does to packets, and what a receiver makes of them: the options."""

from dataclasses import dataclass, fields
from typing import ClassVar

from teleop_drake.loops.framework.validation import (
    CheckChoice,
    FixedFields,
    Number,
    Refuse,
)


@dataclass(kw_only=True)
class PacketConfig(FixedFields):
    """Base of the configs in which one field decides which others have an effect.

    Attributes:
        choice: Name of the field that decides.
        used: The fields that have an effect, keyed by the value of the field `choice`.
    """

    choice: ClassVar[str] = "kind"
    used: ClassVar[dict[str, tuple[str, ...]]] = {}

    def Check(self) -> None:
        """Checks every field; fields without effect must have their defaults.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        path = type(self).__name__.lower()
        choice = getattr(self, self.choice)
        CheckChoice(f"{path}.{self.choice}", choice, self.used)
        self.CheckNumbers(path)
        for item in fields(self):
            value = getattr(self, item.name)
            is_used = item.name in (self.choice, *self.used[choice])
            if not is_used and value != item.default:
                default = f"{item.default:g} where {path}.{self.choice} is {choice}"
                Refuse(f"{path}.{item.name}", value, default)


@dataclass(kw_only=True)
class Jitter(PacketConfig):
    """The random part of the delays of packets.

    uniform: within sqrt(3) std on either side of the mean.
    normal:  the density of N(mean, std^2), truncated below `minimum` and normalized
             again. Mean and std are the values before the truncation.
    gamma:   minimum + Gamma(shape, scale) with shape = ((mean - minimum) / std)^2 and
             scale = std^2 / (mean - minimum).

    The mean is the channel's `delay`.
    """

    used: ClassVar = {
        "none": ("keeps_order",),
        "uniform": ("std", "correlation_time", "hold", "keeps_order"),
        "normal": ("std", "minimum", "correlation_time", "hold", "keeps_order"),
        "gamma": ("std", "minimum", "correlation_time", "hold", "keeps_order"),
    }

    # One of the keys of `used`.
    kind: str = "none"
    # Standard deviation, s, >= 0.
    std: float = Number(0.0, "s", minimum=0)
    # Smallest delay, s, 0 to `delay`; normal and gamma only, else 0. The parts of the
    # delay that vary with time are added to it.
    minimum: float = 0.0
    # Time constant of the correlation between the delays of packets, s, >= 0. 0: the
    # delays are independent.
    correlation_time: float = Number(0.0, "s", minimum=0)
    # Probability that a packet has the jitter of the one before it, 0 to 1. The
    # autocorrelation of delays m packets apart is hold^m.
    hold: float = Number(0.0, "1", minimum=0, maximum=1)
    # Whether packets arrive in the order in which they are sent. A packet that waits
    # for its predecessor arrives later than mean and std imply. The effect grows as the
    # sample period and the correlation time become shorter.
    keeps_order: bool = False


@dataclass(kw_only=True)
class Loss(PacketConfig):
    """The loss of packets.

    independent: each packet is lost with `probability`.
    burst:       the Gilbert-Elliott model. A Markov chain is in a good or a bad state
                 at each packet; a packet is lost with the probability good_loss or
                 bad_loss. The chain leaves the bad state with the probability
                 1 / burst_length and starts in its stationary distribution. The share
                 of packets in the bad state is such that the share `probability` of all
                 packets is lost in the long run.
    gilbert_elliott: the same model by its four numbers: to_bad, to_good, good_loss and
                 bad_loss, which are p, r, 1-k and 1-h of netem's `loss gemodel`. The
                 chain is in the bad state at the share to_bad / (to_bad + to_good) of
                 packets, and stays there for 1 / to_good packets on average.

    Source: E. N. Gilbert, Bell Syst. Tech. J. 39 (1960); E. O. Elliott, ibid. 42
    (1963).
    """

    used: ClassVar = {
        "none": (),
        "independent": ("probability",),
        "burst": ("probability", "burst_length", "good_loss", "bad_loss"),
        "gilbert_elliott": ("to_bad", "to_good", "good_loss", "bad_loss"),
    }

    # One of the keys of `used`.
    kind: str = "none"
    # Share of packets lost in the long run, 0 to 1; below 1 for burst.
    probability: float = Number(0.0, "1", minimum=0, maximum=1)
    # Mean length of the bad state, packets, >= 1; burst only.
    burst_length: float = Number(1.0, "packets", minimum=1)
    # Share lost in the good state; of burst, at most `probability`.
    good_loss: float = Number(0.0, "1", minimum=0, maximum=1)
    # Share lost in the bad state, more than good_loss; of burst, at least
    # `probability`.
    bad_loss: float = Number(1.0, "1", minimum=0, maximum=1)
    # Probability to go from the good state to the bad one at a packet, 0 to 1;
    # gilbert_elliott only.
    to_bad: float = Number(0.0, "1", minimum=0, maximum=1)
    # Probability to go back, > 0 to 1; gilbert_elliott only.
    to_good: float = Number(1.0, "1", above=0, maximum=1)

    def Chain(self) -> tuple[float, float, float]:
        """Returns the share of the bad state, and the probabilities to_bad, to_good."""
        if self.kind == "gilbert_elliott":
            share = self.to_bad / (self.to_bad + self.to_good)
            return share, self.to_bad, self.to_good
        share = (self.probability - self.good_loss) / (self.bad_loss - self.good_loss)
        to_good = 1 / self.burst_length
        return share, to_good * share / (1 - share), to_good


@dataclass(kw_only=True)
class Receiver(PacketConfig):
    """The policy of the receiver. It discards packets older than the one it shows.

    * newest: holds the packet with the newest time stamp.
    * playout: like `newest`, but shows a packet no earlier than delay + depth after
      it was sent. A packet that arrives later is shown at once. The clocks of sender
      and receiver are assumed to agree.
    * extrapolate: shows the newest packet at its arrival, and then extrapolates with
      the slope of the line through the time stamps and values of this packet and of
      the one that it replaced.
    """

    choice = "policy"
    used: ClassVar = {"newest": (), "playout": ("depth",), "extrapolate": ()}

    # One of the keys of `used`.
    policy: str = "newest"
    # Time from sending to showing a packet in excess of `delay`, s, >= 0; playout only,
    # else 0.
    depth: float = Number(0.0, "s", minimum=0)
