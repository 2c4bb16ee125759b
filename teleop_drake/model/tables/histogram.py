"""A histogram of delays: a value and how often it was measured, a row each."""

import re
from dataclasses import dataclass

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.tables.headers import ParseHeader
from teleop_drake.model.tables.measured import HALVED, ONE_WAY
from teleop_drake.model.tables.source import TableSource
from teleop_drake.model.tables.stamps import CheckTimeUnit
from teleop_drake.model.tables.table import Table

# The names of columns, as keys of ParseHeader(). A value is a delay one way.
_COUNT = (
    r"(?!.*cumulative)(.+_)?(counts?|frequency|frequencies|occurrences|packets|samples)"
)
_DELAY = r"(.+_)?(values?|bins?|delay|owd|jitter)"
_ROUND_TRIP = r"(.+_)?(rtt|round_?trips?)"


@dataclass(frozen=True, kw_only=True)
class Histogram:
    """A distribution of delays: each value has the share of its count.

    Attributes:
        delays: The delays one way, s, ascending (N).
        counts: How often each was measured, >= 0 (N).
        kind: What was measured: ONE_WAY or HALVED.
    """

    delays: Array
    counts: Array
    kind: str

    def Quantiles(self, shares: Array) -> Array:
        """Returns the delays below which the given shares lie, s (K).

        Args:
            shares: Shares of all packets, 0 to less than 1 (K).
        """
        total = np.cumsum(self.counts)
        places = np.searchsorted(total, np.asarray(shares) * total[-1], side="right")
        return self.delays[np.minimum(places, len(self.delays) - 1)]

    def Summary(self) -> str:
        """Returns a line that tells what was read."""
        share = self.counts / self.counts.sum()
        median = float(self.Quantiles(np.array([0.5]))[0])
        mean = float(share @ self.delays)
        return (
            f"histogram of {self.counts.sum():.10g} packets, median {1e3 * median:.4g} "
            f"ms, mean {1e3 * mean:.4g} ms, {1e3 * self.delays[0]:.4g} to "
            f"{1e3 * self.delays[-1]:.4g} ms ({self.kind}), drawn anew for each packet"
        )


def HistogramOf(table: Table, source: TableSource) -> Histogram | None:
    """Returns the histogram of a table; None if the table is none.

    It has a column of counts, one of delays, and no other.

    Raises:
        ScenarioError: If a unit is unknown, or a cell is not allowed.
    """
    keys = {name: ParseHeader(name).key for name in table.names}
    counted = [name for name, key in keys.items() if re.fullmatch(_COUNT, key)]
    if len(keys) != 2 or len(counted) != 1 or source.columns:
        return None
    (value,) = set(keys) - set(counted)
    is_halved = re.fullmatch(_ROUND_TRIP, keys[value]) is not None
    if not is_halved and not re.fullmatch(_DELAY, keys[value]):
        return None
    unit = source.units.get("rtt" if is_halved else "delay") or table.UnitOf(value)
    CheckTimeUnit(table.Place(value), unit, ", in its header")
    delays = table.Values(value, unit) / (2 if is_halved else 1)
    counts = table.Values(counted[0], "")
    is_good = (delays >= 0) & (counts >= 0)
    for i in np.flatnonzero(~is_good)[:1]:
        raise ScenarioError(
            f"{table.origin}: line {table.lines[i]}: must be a delay and a count, >= 0"
        )
    if not counts.sum() > 0:
        raise ScenarioError(f"{table.origin}: must have a count > 0")
    order = np.argsort(delays, kind="stable")
    return Histogram(
        delays=delays[order],
        counts=counts[order],
        kind=HALVED if is_halved else ONE_WAY,
    )
