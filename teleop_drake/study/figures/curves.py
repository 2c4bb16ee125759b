"""Curves of runs: a signal against time, and the range of an axis that shows it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Interval
from teleop_drake.loops.run.recording import Recording

# Points across a panel, enough for a curve to look smooth.
_NUM_POINTS = 1500


def TimeLimits(runs: Sequence[Recording]) -> Interval:
    """Returns the time span of some runs in s; with a single instant it is 1 s long."""
    begin = min(run.time[0] for run in runs)
    end = max(run.time[-1] for run in runs)
    return begin, end if end > begin else begin + 1.0


class Curve(NamedTuple):
    """The components of a signal of one run.

    Attributes:
        time: Times in s (T); the time of a jump occurs twice.
        y: Values (T, k).
        diverges: Whether the run diverges.
    """

    time: Array
    y: Array
    diverges: bool = False


def SampleCurve(run: Recording, signal: str, components: Sequence[int]) -> Curve:
    """Returns components of a signal at the samples; a single one also between them."""
    # Several components are telemetry, for which the samples suffice.
    num_points = _NUM_POINTS if len(components) == 1 else 0
    instants = np.linspace(run.time[0], run.time[-1], num_points)
    between = np.setdiff1d(instants, run.time)
    places = np.searchsorted(run.time, between)
    time = np.insert(run.time, places, between)
    values = np.insert(run[signal], places, run.Interpolate(signal, between), axis=0)
    return Curve(time, values[:, components], run.termination == "diverged")


def RangeOf(curves: Sequence[Curve], commands: Sequence[Curve] = ()) -> Interval:
    """Returns the range that shows the runs, of diverging ones only a part.

    Runs that diverge extend the range by no more than its width on either side.

    Args:
        curves: The curves of the runs.
        commands: Curves that are drawn beside them and shown in full.
    """
    shown = [curve.y for curve in curves if not curve.diverges]
    if not shown:
        # All runs diverge: the last fifth of their time is left out.
        shown = [curve.y[curve.time <= 0.8 * curve.time[-1]] for curve in curves]
    known = np.concatenate(shown + [curve.y for curve in commands])
    every = np.concatenate([known, *(curve.y for curve in curves)])
    width = np.ptp(known)
    low = max(every.min(), known.min() - width)
    high = min(every.max(), known.max() + width)
    return low, high
