"""Measured packets, and the line that tells what was read."""

from dataclasses import dataclass

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.framework.validation import ScenarioError

ONE_WAY = "one way"
HALVED = "half of rtt"
BETWEEN_STAMPS = "from sent to received"

SET_BACK = "if a clock was set back there, split the file"
"""What to do with a file whose times descend."""


@dataclass(frozen=True, kw_only=True)
class Packets:
    """Measured delays, one entry for each packet that was sent.

    Attributes:
        times: The times when the packets were sent, s from the first one, ascending
            (N).
        delays: The delays one way, s (N). NaN: the packet was lost.
        kind: What was measured: ONE_WAY, HALVED or BETWEEN_STAMPS.
        clock: What the clock shows, in words.
        remarks: What else was found or done, a phrase each.
    """

    times: Array
    delays: Array
    kind: str
    clock: str
    remarks: tuple[str, ...] = ()

    def Summary(self) -> str:
        """Returns a line that tells what was read."""
        is_lost = np.isnan(self.delays)
        parts = [
            f"{len(self.times)} packets in {ShowTime(self.times[-1])}",
            f"{int(is_lost.sum())} lost",
        ]
        arrived = self.delays[~is_lost] * 1e3
        if arrived.size:
            parts.append(
                f"median {np.median(arrived):.4g} ms, {arrived.min():.4g} to "
                f"{arrived.max():.4g} ms ({self.kind})"
            )
        return ", ".join([*parts, f"clock: {self.clock}", *self.remarks])


def ShowTime(seconds: float) -> str:
    """Returns a time with its unit; without an exponent where it is long."""
    return f"{seconds:.0f} s" if seconds >= 1e4 else f"{seconds:.4g} s"


def InOrder(
    times: Array, delays: Array, arrivals: Array, origin: str, lines: Indices
) -> Indices:
    """Returns the order in which packets were sent, as indices (N).

    A log has its rows in the order in which packets were sent, or in that in which
    they arrived.

    Args:
        times: The times when they were sent, s (N).
        delays: The delays, s (N); NaN: lost.
        arrivals: The times when the sender or the receiver saw them, s (N).
        origin: The beginning of messages.
        lines: The numbers of the lines, for messages (N).

    Raises:
        ScenarioError: If they are in neither order: the clock was set back.
    """
    if (np.diff(times) >= 0).all():
        return np.arange(len(times))
    arrived = np.flatnonzero(~np.isnan(delays))
    # Stamps and delays may be rounded to ms.
    if (np.diff(arrivals[arrived]) >= -2e-3).all():
        return np.argsort(times, kind="stable")
    i = int(np.argmin(np.diff(times))) + 1
    raise ScenarioError(
        f"{origin}: line {lines[i]}: must not be earlier than the line before, and is "
        f"by {ShowTime(times[i - 1] - times[i])}; {SET_BACK}"
    )
