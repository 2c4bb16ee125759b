"""Curves of runs: a signal's samples, and the range that shows them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array, Interval
from teleop_drake.recording import Recording

# Points across a panel: enough that no corner shows.
_NUM_POINTS = 1500


def TimeLimits(runs: Sequence[Recording]) -> Interval:
    """Returns the span of time of some runs in s; of a single sample it is 1 s."""
    begin = min(float(run.time[0]) for run in runs)
    end = max(float(run.time[-1]) for run in runs)
    return begin, end if end > begin else begin + 1.0


class Curve(NamedTuple):
    """The components of a signal of one run.

    Attributes:
        time: (T,) in s; a time that stands twice is a jump.
        x: (T,) position in m along the direction that is shown.
        y: (T, k).
    """

    time: Array
    x: Array
    y: Array


def CurveAt(run: Recording, normal_W: Array | None, signal: str, time: Array) -> Curve:
    """Returns a signal at some times."""
    x = time if normal_W is None else run.Interpolate("tool_position", time) @ normal_W
    return Curve(time, x, run.Interpolate(signal, time))


def SampleCurve(
    run: Recording,
    normal_W: Array | None,
    signal: str,
    components: Sequence[int] | None = None,
) -> Curve:
    """Returns a signal at the samples and, of a single component, between them."""
    time = run.time
    columns = slice(None) if components is None else components
    rows = Curve(
        time,
        time if normal_W is None else run["tool_position"] @ normal_W,
        run[signal][:, columns],
    )
    if rows.y.shape[1] > 1 or time[0] == time[-1]:
        return rows  # Telemetry, which is slow.
    instants = np.linspace(time[0], time[-1], _NUM_POINTS)
    even = CurveAt(run, normal_W, signal, np.setdiff1d(instants, time))
    even = even._replace(y=even.y[:, columns])
    # Stable: the two sides of a jump stay in their order.
    order = np.argsort(np.concatenate([time, even.time]), kind="stable")
    both = zip(rows, even, strict=True)
    return Curve(*(np.concatenate(parts)[order] for parts in both))


def RangeOf(
    runs: Sequence[Recording], curves: Sequence[Curve], commands: Sequence[Curve] = ()
) -> Interval:
    """Returns the range that shows the runs, those that diverge only in part.

    A run that diverges widens the range by as much as it is, on either side, at most.
    """
    calm: list[Array] = []
    wild: list[Array] = []
    for run, curve in zip(runs, curves, strict=True):
        (wild if run.termination == "diverged" else calm).append(curve.y)
    if not calm:
        # What is left is the time before it becomes hopeless.
        calm = [curve.y[curve.time <= 0.8 * curve.time[-1]] for curve in curves]
    shown = np.concatenate([y.ravel() for y in (*calm, *(x.y for x in commands))])
    every = np.concatenate([shown, *(y.ravel() for y in wild)])
    low = float(shown.min())
    high = float(shown.max())
    width = high - low
    return max(float(every.min()), low - width), min(float(every.max()), high + width)
