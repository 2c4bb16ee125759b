"""Receivers of a network's packets."""

from dataclasses import dataclass

from teleop_drake.validation import FixedFields, Number, Refuse

RECEIVERS = ("newest", "playout", "extrapolate")
"""Every policy of a receiver."""


@dataclass(kw_only=True)
class Receiver(FixedFields):
    """What the receiver makes of the packets; older ones than it has are discarded.

    newest:      holds the packet with the newest time stamp.
    playout:     the same, but shows a packet no earlier than delay + depth after it
                 was sent; one that is late is shown at once. The clocks agree.
    extrapolate: goes on from the newest packet, from its arrival, along the line
                 through the time stamps and values of this packet and the one it
                 replaced.
    """

    # One of RECEIVERS.
    policy: str = "newest"
    # How much longer than `delay` a packet waits, s, >= 0; playout only, else 0.
    depth: float = Number(0.0, "s", minimum=0)


def CheckReceiver(receiver: Receiver) -> None:
    """Checks a receiver.

    Raises:
        ValueError: If a parameter is outside its range.
    """
    if receiver.policy not in RECEIVERS:
        Refuse("receiver.policy", receiver.policy, f"one of {', '.join(RECEIVERS)}")
    receiver.CheckNumbers("receiver")
    if receiver.policy != "playout" and receiver.depth != 0:
        Refuse(
            "receiver.depth",
            receiver.depth,
            f"0 where receiver.policy is {receiver.policy}",
        )
