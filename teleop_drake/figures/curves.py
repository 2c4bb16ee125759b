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
    begin = min(run.time[0] for run in runs)
    end = max(run.time[-1] for run in runs)
    return begin, end if end > begin else begin + 1.0


class Curve(NamedTuple):
    """The components of a signal of one run.

    Attributes:
        time: (T,) in s; a time that stands twice is a jump.
        y: (T, k).
        diverges: Whether the run does.
    """

    time: Array
    y: Array
    diverges: bool = False


def SampleCurve(run: Recording, signal: str, components: Sequence[int]) -> Curve:
    """Returns a signal at the samples and, of a single component, between them."""
    # Of several components, which are telemetry, the samples are enough.
    num_points = _NUM_POINTS if len(components) == 1 else 0
    instants = np.linspace(run.time[0], run.time[-1], num_points)
    between = np.setdiff1d(instants, run.time)
    places = np.searchsorted(run.time, between)
    time = np.insert(run.time, places, between)
    values = np.insert(run[signal], places, run.Interpolate(signal, between), axis=0)
    return Curve(time, values[:, components], run.termination == "diverged")


def RangeOf(curves: Sequence[Curve], commands: Sequence[Curve] = ()) -> Interval:
    """Returns the range that shows the runs, those that diverge only in part.

    A run that diverges widens the range by as much as it is, on either side, at most.
    """
    shown = [curve.y for curve in curves if not curve.diverges]
    if not shown:
        # What is left is the time before it becomes hopeless.
        shown = [curve.y[curve.time <= 0.8 * curve.time[-1]] for curve in curves]
    known = np.concatenate(shown + [curve.y for curve in commands])
    every = np.concatenate([known, *(curve.y for curve in curves)])
    width = np.ptp(known)
    low = max(every.min(), known.min() - width)
    high = min(every.max(), known.max() + width)
    return low, high
