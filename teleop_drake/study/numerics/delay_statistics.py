"""Statistics of measured delays of packets: bursts of losses, correlation, drift."""

from itertools import pairwise

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices


def burst_lengths(is_lost: Array) -> Indices:
    """Returns the number of packets in each run of lost ones.

    Args:
        is_lost: Whether each packet was lost (N).
    """
    edges = np.flatnonzero(np.diff(is_lost.astype(int), prepend=0, append=0))
    return edges[1::2] - edges[::2]


def delay_autocorrelation(delays: Array, num_lags: int) -> Array:
    """Returns the autocorrelation of delays at lags from 0 in packets (num_lags).

    A pair with a lost packet is left out. The result is NaN where no pair is left, or
    if all delays are equal.

    Args:
        delays: The delays (N); NaN: lost.
        num_lags: The number of lags, at most N.
    """
    deviations = delays - np.nanmean(delays)
    variance = np.nanmean(deviations**2)
    correlation = np.full(num_lags, np.nan)
    if not variance > 0:
        return correlation
    for lag in range(num_lags):
        products = deviations[lag:] * deviations[: len(deviations) - lag]
        if np.isfinite(products).any():
            correlation[lag] = np.nanmean(products) / variance
    return correlation


def least_delay_line(times: Array, delays: Array) -> tuple[float, float]:
    """Returns the line under all delays that is closest to them: value at 0, slope.

    Queues only add to a delay, so that the slope of the least delays is that of two
    clocks, or of the path. The line minimises the sum of its distances to the delays.
    It goes through the edge of their lower convex hull at the mean of the times.

    Source: S. B. Moon, P. Skelly, D. Towsley, Estimation and removal of clock skew from
    network delay measurements, INFOCOM 1999.

    Args:
        times: Times when packets were sent, s, ascending (N).
        delays: Their delays, s (N), finite; two or more at different times.
    """
    hull: list[int] = []
    for i in range(len(times)):
        while len(hull) > 1 and _turns_right(times, delays, hull[-2], hull[-1], i):
            hull.pop()
        hull.append(i)
    mean = times.mean()
    for first, second in pairwise(hull):
        if times[second] >= mean and times[second] > times[first]:
            rise = delays[second] - delays[first]
            slope = float(rise / (times[second] - times[first]))
            return float(delays[first] - slope * times[first]), slope
    return float(delays.min()), 0.0


def _turns_right(times: Array, delays: Array, a: int, b: int, c: int) -> bool:
    """Returns whether point b lies on or above the line from a to c."""
    ahead = (times[b] - times[a]) * (delays[c] - delays[a])
    return bool(ahead <= (times[c] - times[a]) * (delays[b] - delays[a]))


def least_delay_slope_error(times: Array, delays: Array, num_parts: int) -> float:
    """Returns the standard error of the slope of the least delays in s/s.

    It is that of the line through the least delay of each of some parts of the record.

    Args:
        times: As for least_delay_line().
        delays: As for least_delay_line().
        num_parts: The number of parts, 3 or more.
    """
    edges = np.linspace(times[0], times[-1], num_parts + 1)
    parts = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, num_parts - 1)
    least = [
        int(np.argmin(np.where(parts == part, delays, np.inf)))
        for part in range(num_parts)
        if (parts == part).any()
    ]
    if len(least) < 3:
        return float("inf")
    t = times[least] - times[least].mean()
    columns = np.column_stack([np.ones(len(t)), t])
    _, squares, *_ = np.linalg.lstsq(columns, delays[least], rcond=None)
    left = float(squares[0]) if len(squares) else 0.0
    return float(np.sqrt(left / (len(t) - 2) / (t @ t)))
