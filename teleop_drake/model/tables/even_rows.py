"""Rows at equal distances in time, from stamps that are rounded or uneven."""

from dataclasses import dataclass

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.tables.measured import ShowTime

MOST_UNEVEN = 100
"""The largest number of rows that keep uneven times."""

# Stamps that are nearer than this share of the period to even ones are rounded.
_ROUNDED = 0.05

# The error of a resampled signal at the rows of the file, as a share of its range, and
# the largest number of samples for each row.
_ENOUGH = 1e-3
_MOST_SAMPLES = 16

# Stamps that are moved by less than this share of the period are not worth a word.
_SAME = 1e-4


@dataclass(frozen=True)
class EvenRows:
    """Rows with their times.

    Attributes:
        times: The times, s, ascending (N).
        values: The values (N, n).
        period: The distance of the rows, s; the last distance may be shorter. None: the
            times are uneven.
        remark: What was done, in words.
    """

    times: Array
    values: Array
    period: float | None
    remark: str


def MakeEven(times: Array, values: Array, most_uneven: int = MOST_UNEVEN) -> EvenRows:
    """Returns rows at equal distances in time, or a few uneven ones as they are.

    Rounded stamps are moved to even ones. Uneven rows are interpolated linearly; the
    remark has the largest error at the rows of the file.

    Args:
        times: The times, s, ascending (N); N >= 2.
        values: The values (N, n).
        most_uneven: The largest number of rows that keep uneven times.
    """
    # The last row may be nearer, as where a drive ended.
    num_even = max(len(times) - 1, 2)
    period = _MeanStep(times[:num_even])
    even = times[0] + period * np.arange(len(times))
    moved = float(np.abs(even - times)[:num_even].max())
    distance = float(times[-1] - times[-2])
    if moved <= _ROUNDED * period and distance <= (1 + 2 * _ROUNDED) * period:
        is_last_even = distance >= (1 - 2 * _ROUNDED) * period
        even[-1] = even[-1] if is_last_even else times[-1]
        remark = f"every {ShowTime(period)}"
        if moved > _SAME * period:
            remark += f" (stamps moved by up to {ShowTime(moved)})"
        return EvenRows(even, values, period, remark)
    if len(times) <= most_uneven:
        return EvenRows(times, values, None, "at uneven times")
    return _Resampled(times, values)


def _MeanStep(times: Array) -> float:
    """Returns the slope of the straight line that fits times best."""
    k = np.arange(len(times)) - (len(times) - 1) / 2
    return float(np.sum(k * times) / np.sum(k**2))


def _Resampled(times: Array, values: Array) -> EvenRows:
    """Returns rows at equal distances, interpolated linearly."""
    span = float(times[-1] - times[0])
    count = round(span / float(np.median(np.diff(times))))
    most = _MOST_SAMPLES * len(times)
    count = min(max(count, 1), most)
    size = float(np.ptp(values, axis=0).max()) or 1.0
    while True:
        even = np.linspace(times[0], times[-1], count + 1)
        samples = _Interpolated(even, times, values)
        errors = _Interpolated(times, even, samples) - values
        error = float(np.abs(errors).max()) / size
        if error <= _ENOUGH or 2 * count > most:
            break
        count *= 2
    period = span / count
    remark = (
        f"uneven, resampled every {ShowTime(period)} within {100 * error:.2g} % of the "
        f"range, longest gap {ShowTime(float(np.diff(times).max()))}"
    )
    return EvenRows(even, samples, period, remark)


def _Interpolated(at: Array, times: Array, values: Array) -> Array:
    return np.stack([np.interp(at, times, axis) for axis in values.T], axis=1)
