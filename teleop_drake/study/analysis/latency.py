"""The delay between two recorded signals: dead time, lag, spread, drift, losses."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from teleop_drake.loops.framework.arrays import Array, ArrayLike, Interval, Record
from teleop_drake.loops.framework.validation import (
    CheckChoice,
    CheckNumber,
    Refuse,
    ScenarioError,
)
from teleop_drake.study.numerics.dead_time import DeadTime, find_dead_time
from teleop_drake.study.numerics.delay_course import (
    Course,
    delay_course,
    drift_error,
    missing_packets,
    row_spread,
)
from teleop_drake.study.numerics.lagged_signal import Lag
from teleop_drake.study.numerics.signal_pair import SignalPair

LAGS = {"none": (0,), "first": (0, 1), "second": (0, 1, 2)}
"""The orders of the response's own lag that are allowed, by the name of the highest."""

# The attributes of Latency that its record has unchanged.
_NUMBERS = (
    *("delay", "interval", "reason", "gain", "offset", "noise", "explained"),
    *("drift", "drift_error", "spread", "spread_error", "losses", "hidden"),
)

# Rows that are needed, and windows in which the delay is estimated.
_LEAST_ROWS = 50
_NUM_WINDOWS = 20

# The largest dead time considered by default: a share of the record, and s.
_SHARE = 0.25
_MOST = 10.0

# The response follows the command if the squared correlation exceeds this share, or
# this multiple of its variance for unrelated signals, which does not occur by chance
# although the best of many dead times and lags is chosen.
_FOLLOWS_SHARE = 0.9
_FOLLOWS = 30.0

# Delays differ from row to row if their standard deviation exceeds its standard error
# by this factor.
_CLEAR = 5.0

# A smaller spread than this share of the time between rows is rounding.
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Latency:
    """The delay between a command and a response.

    The response is taken to be an offset plus a gain times the command, which is lagged
    and then delayed; see numerics.signal_pair.

    Attributes:
        delay: The dead time in the middle of the record, s. None: the record cannot
            tell it.
        reason: Why the record cannot tell it; empty if it can.
        interval: The dead times that the record does not refute at 95 % confidence with
            any of the allowed lags, s; from the least to the largest.
        by_lag: Dead time and interval for each order of the lag that the record does
            not refute.
        lag: The response's own lag.
        gain: The gain.
        offset: The offset, in the unit of the response.
        noise: The standard deviation of what is left, in the unit of the response.
        drift: The change of the dead time per time, s/s.
        drift_error: Its standard error, s/s.
        spread: The standard deviation of the delay from row to row, s. None if the
            response has a lag, which hides it.
        spread_error: Its standard error, s.
        losses: The share of packets that left the response unchanged: lost, too late,
            or replaced before a row showed them. None if the response does not show
            it; see numerics.delay_course.missing_packets.
        hidden: The most of this share that may have been replaced within one row.
        course: The dead time over the record.
        explained: The share of the response's variance that the command explains.
        search: Dead times in s, and the least root mean square error that was found
            with each (2, K).
        pair: The record.
        found: The fits.
    """

    delay: float | None
    reason: str
    interval: Interval
    by_lag: dict[int, tuple[float, Interval]]
    lag: Lag
    gain: float
    offset: float
    noise: float
    drift: float
    drift_error: float
    spread: float | None
    spread_error: float | None
    losses: float | None
    hidden: float | None
    course: Course
    explained: float
    search: Array
    pair: SignalPair
    found: DeadTime

    def ToRecord(self) -> Record:
        """Returns the numbers for JSON; a number that is not finite is null."""
        record: Record = {name: getattr(self, name) for name in _NUMBERS}
        record["lag"] = self.lag._asdict()
        record["by_lag"] = {
            str(order): {"delay": delay, "interval": interval}
            for order, (delay, interval) in self.by_lag.items()
        }
        record["course"] = {
            name: values.tolist() for name, values in self.course._asdict().items()
        }
        return cast(Record, _Finite(record))

    def Trace(self) -> tuple[Array, Array]:
        """Returns times and dead times in s (N), as a channel's trace.

        The times are those when the command left, from 0; windows in which the command
        moves too little are left out.

        Raises:
            ScenarioError: If the record cannot tell the dead time.
        """
        if self.delay is None:
            raise ScenarioError(f"no trace: {self.reason}")
        is_known = np.isfinite(self.course.delays)
        delays = self.course.delays[is_known]
        sent = self.course.times[is_known] - delays
        sent = sent - self.pair.command_time[0]
        # The trace begins with the record.
        return np.append(0.0, sent), np.append(delays[0], delays)


def EstimateLatency(
    time: ArrayLike,
    command: ArrayLike,
    response: ArrayLike,
    *,
    lag: str = "second",
    maximum: float | None = None,
) -> Latency:
    """Estimates the dead time between two recorded signals, with its interval.

    Rows in which a signal is NaN are left out for that signal.

    Args:
        time: Times of the rows, s, ascending (N).
        command: The signal that leads (N).
        response: The signal that follows (N); offset and gain are found.
        lag: The largest lag that the response may have of its own: `none`, `first` or
            `second` (order). Fewer make the interval shorter, and wrong if the response
            has more.
        maximum: The largest dead time considered, s. None: a quarter of the record, at
            most 10 s. The response is used from this time on.

    Raises:
        ScenarioError: If an argument is not allowed.
    """
    CheckChoice("lag", lag, LAGS)
    pair = _Problem(time, command, response, maximum)
    found = find_dead_time(pair, LAGS[lag])
    # Delays that differ from row to row blur the command, as a lag does. What they
    # leave shows them: it is larger where the command moves fast.
    rows = row_spread(pair, found.fits[LAGS[lag][-1]].fit)
    least = max(_CLEAR * rows.error, _NEGLIGIBLE * pair.row_step)
    if rows.spread > least:
        pair = replace(pair, spread=rows.spread)
        pair.weights = np.sqrt(rows.levels.mean() / rows.levels)
        found = find_dead_time(pair, LAGS[lag])
    fit = found.fit
    rows = row_spread(pair, fit)
    offset, gain, *_ = pair.combination(fit)
    intervals = _Widened(found.intervals, pair)
    reason = _Reason(pair, found, intervals)
    is_direct = fit.lag.order == 0
    missing = missing_packets(pair, fit) if is_direct else None
    return Latency(
        delay=None if reason else fit.delay,
        reason=reason,
        interval=(intervals[0][0], intervals[-1][1]),
        by_lag={
            order: (each.fit.delay, _Ends(_Widened(each.intervals, pair)))
            for order, each in found.fits.items()
            if each.intervals
        },
        lag=fit.lag,
        gain=float(gain),
        offset=float(offset),
        noise=rows.noise,
        drift=fit.drift,
        drift_error=drift_error(pair, fit, found.num_independent),
        spread=rows.spread if is_direct else None,
        spread_error=rows.error if is_direct else None,
        losses=None if missing is None else missing.share,
        hidden=None if missing is None else missing.hidden,
        course=delay_course(pair, fit, _NUM_WINDOWS),
        explained=found.explained,
        search=found.search,
        pair=pair,
        found=found,
    )


def _Finite(value: Any) -> Any:
    """Returns a record in which null replaces numbers that are not finite."""
    if isinstance(value, dict):
        return {key: _Finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_Finite(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _Problem(
    time: ArrayLike, command: ArrayLike, response: ArrayLike, maximum: float | None
) -> SignalPair:
    """Checks the arguments of EstimateLatency, and prepares the record."""
    t = np.asarray(time, dtype=float)
    signals = {"command": command, "response": response}
    rows = {}
    for name, signal in signals.items():
        values = np.asarray(signal, dtype=float)
        if values.shape != t.shape or t.ndim != 1:
            Refuse(name, values.shape, f"as long as time, {t.shape}")
        is_given = np.isfinite(values) & np.isfinite(t)
        rows[name] = t[is_given], values[is_given]
        if is_given.sum() < _LEAST_ROWS:
            Refuse(name, int(is_given.sum()), f"{_LEAST_ROWS} finite rows or more")
    if np.any(np.diff(t[np.isfinite(t)]) <= 0):
        Refuse("time", "rows that do not ascend", "ascending times (s)")
    span = rows["command"][0][-1] - rows["command"][0][0]
    if maximum is None:
        maximum = min(_SHARE * span, _MOST)
    CheckNumber("maximum", maximum, "s", above=0, maximum=span / 2)
    pair = SignalPair(*rows["command"], *rows["response"], float(maximum))
    if len(pair.rows) < _LEAST_ROWS / 2:
        Refuse("maximum", maximum, "such that rows of the response are left behind it")
    return pair


def _Widened(intervals: Sequence[Interval], pair: SignalPair) -> list[Interval]:
    """Returns intervals that allow for a command that jumps between two rows."""
    margin = pair.row_step if pair.is_stepwise else 0.0
    return [(max(low - margin, 0.0), high + margin) for low, high in intervals]


def _Ends(intervals: Sequence[Interval]) -> Interval:
    return intervals[0][0], intervals[-1][1]


def _Reason(pair: SignalPair, found: DeadTime, intervals: Sequence[Interval]) -> str:
    """Returns why the record cannot tell the dead time, empty if it can."""
    for name, signal in (("command", pair.command), ("response", pair.y)):
        if np.ptp(signal) == 0:
            part = ""
            if name == "response" and np.ptp(pair.response) > 0:
                part = (
                    f" after {pair.maximum:.4g} s, from which on it is used (--maximum)"
                )
            return f"the {name} never changes{part}"
    is_clear = found.explained * found.num_pairs > _FOLLOWS
    if found.explained < _FOLLOWS_SHARE and not is_clear:
        return "the response does not follow the command"
    low, high = _Ends(intervals)
    shown = ", ".join(f"{x:.4g} to {y:.4g} s" for x, y in intervals)
    same = f"dead times of {shown} explain the record equally well"
    if high >= pair.maximum:
        return f"{same}, and larger ones are not considered (--maximum)"
    if len(intervals) > 1:
        like = "has few jumps" if pair.is_stepwise else "repeats"
        return f"{same}, as with a command that {like}"
    if high - low > pair.maximum / 2:
        return f"{same}, as with a ramp or with a sine"
    return ""
