"""Curves of runs: a signal's samples, and the range that shows them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from teleop_drake.recording import Recording

# A run that diverges may widen the range of a panel by this share on either side.
_DIVERGED_SHARE = 1.0

# Points across a panel: enough that no corner shows.
_NUM_POINTS = 1500


def TimeLimits(runs: Sequence[Recording]) -> tuple[float, float]:
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

    time: np.ndarray
    x: np.ndarray
    y: np.ndarray


def CurveAt(
    run: Recording, normal_W: np.ndarray | None, signal: str, time: np.ndarray
) -> Curve:
    """Returns a signal at some times."""
    x = time if normal_W is None else run.Interpolate("tool_position", time) @ normal_W
    return Curve(time, x, run.Interpolate(signal, time))


def SampleCurve(
    run: Recording,
    normal_W: np.ndarray | None,
    signal: str,
    components: Sequence[int] | None = None,
) -> Curve:
    """Returns a signal at the samples and, where it moves fast, between them."""
    time = run.time
    x = time if normal_W is None else run["tool_position"] @ normal_W
    columns = slice(None) if components is None else components
    curve = Curve(time, x, run[signal][:, columns])
    if curve.y.shape[1] > 1 or time[0] == time[-1]:
        return curve  # Telemetry, which is slow.
    parts = np.ceil(_NUM_POINTS * np.diff(time) / (time[-1] - time[0])).astype(int)
    between = [
        np.linspace(time[i], time[i + 1], parts[i], endpoint=False)[1:]
        for i in np.flatnonzero(parts > 1)
    ]
    if not between:
        return curve
    extra = CurveAt(run, normal_W, signal, np.concatenate(between))
    extra = extra._replace(y=extra.y[:, columns])
    # Stable: the two sides of a jump stay in their order.
    order = np.argsort(np.concatenate([time, extra.time]), kind="stable")
    both = zip(curve, extra, strict=True)
    return Curve(*(np.concatenate(parts)[order] for parts in both))


def RangeOf(
    runs: Sequence[Recording], curves: Sequence[Curve], commands: Sequence[Curve] = ()
) -> tuple[float, float]:
    """Returns the range that shows the runs, those that diverge only in part."""
    is_wild = [run.termination == "diverged" for run in runs]
    if all(is_wild):
        # What is left is the time before it becomes hopeless.
        shown = [curve.y[curve.time <= 0.8 * curve.time[-1]] for curve in curves]
    else:
        shown = [x.y for x, wild in zip(curves, is_wild, strict=True) if not wild]
    shown += [command.y for command in commands]
    low = min(y.min() for y in shown)
    high = max(y.max() for y in shown)
    margin = _DIVERGED_SHARE * (high - low)
    wild = [x.y.ravel() for x, wild in zip(curves, is_wild, strict=True) if wild]
    every = np.concatenate([*wild, [low, high]])
    return float(max(every.min(), low - margin)), float(min(every.max(), high + margin))
