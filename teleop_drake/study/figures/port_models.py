"""Bode and Nyquist plots of the loop of any diagram, with its margins drawn in."""

import itertools
import math
import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Circle
from matplotlib.ticker import MultipleLocator
from scipy.optimize import linear_sum_assignment

from teleop_drake.loops.framework.arrays import Array, ComplexArray
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.linear.port_model import PortModel
from teleop_drake.loops.linear.sampled_model import SampledModel
from teleop_drake.loops.numerics.margins import Margins
from teleop_drake.study.figures.layout import MakeMultiples
from teleop_drake.study.figures.style import (
    GREY,
    AddLegend,
    Figure,
    Key,
    Look,
    RunColor,
    RunKeys,
    RunStyle,
)

Model = PortModel | SampledModel

_HEIGHT = 3.8  # inches

# The letters in a line of the legend.
_NUM_LETTERS = 60

# Decades that are shown below the slowest and above the fastest margin.
_BELOW = 1.5
_ABOVE = 0.75

# The number of points of a curve, and the largest phase shift by delays in rad between
# two of them, as long as there are not more than a limit.
_NUM_POINTS = 2000
_TURN = 0.3
_MOST_POINTS = 30_000

MAGNITUDES = (1e-3, 1e3)
"""The magnitudes of loops that Bode plots show."""

NYQUIST_RANGE = 2.5
"""Half the width of a Nyquist plot."""

GUIDE: Look = {"color": GREY, "linewidth": 0.6, "zorder": 0}
"""The style of reference lines."""

# The marks of the margins, which differ in colour and in shape. A delay is often at the
# frequency of the phase, whose dot is seen inside of the triangle.
_GAIN: Look = {"color": RunColor(1), "marker": "s", "ms": 4}
_PHASE: Look = {"color": RunColor(2), "marker": "o", "ms": 4}
_DELAY: Look = {"color": RunColor(3), "marker": "^", "ms": 8, "fillstyle": "none"}

# A locus below this share of the largest one is 0, as of a loop of one force and
# several measurements.
_NOTHING = 1e-9


class _Place(NamedTuple):
    """The point of a locus that limits a margin.

    Attributes:
        label: The margin in words.
        frequency: The frequency of the point in rad/s; 0 for the beginning of the
            locus.
        value: The value of the locus there.
        look: The mark of the margin.
    """

    label: str
    frequency: float
    value: complex
    look: Look


def PlotModelBode(model: Model) -> Figure:
    """Plots magnitude and phase of a model, and the margins of a loop.

    A loop of several signals has a line for each eigenlocus of L, any other model one
    for each pair of an output and an input.
    """
    places, lines = _Read(model)
    w = _Frequencies(model, places)
    values = _Values(model, w)
    what = "|eigenlocus of L|" if _IsLoop(model) and values.shape[1] > 1 else "|L|"
    figure, axes = MakeMultiples(
        [""],
        "frequency [rad/s]",
        [what if _IsLoop(model) else "magnitude", "phase [°]"],
        height=_HEIGHT,
    )
    top, bottom = axes[:, 0]
    phases = _Phases(w, values, places)
    for i, value in enumerate(values.T):
        top.loglog(w, np.abs(value), **RunStyle(i))
        bottom.semilogx(w, phases[:, i], **RunStyle(i))
    top.set(xlim=(w[0], w[-1]), ylim=_MagnitudeLimits(np.abs(values)))
    shown = [-180.0] if _IsLoop(model) else []
    if _IsLoop(model):
        top.axhline(1, **GUIDE)
    for place in places:
        at = place if place.frequency > 0 else place._replace(frequency=w[0])
        shown += _DrawOnBode(top, bottom, at, _PhaseAt(at, w, values, phases))
    _SetPhaseLimits(bottom, phases, shown)
    if isinstance(model, SampledModel):
        for ax in (top, bottom):
            ax.axvline(math.pi / model.period, linestyle="--", **GUIDE)
        lines = [*lines, Key("Nyquist frequency", linestyle="--", **GUIDE)]
    AddLegend(figure, [*lines, *_Names(model, values.shape[1])])
    return figure


def PlotModelNyquist(model: Model) -> Figure:
    """Plots the eigenloci of a loop near the critical point -1, with its margins.

    The frequencies are positive. The loop of a stable diagram becomes unstable where a
    locus passes through -1: by another gain, which moves it along a ray, or by a phase
    or a delay, which turn it about 0.

    Raises:
        ValueError: If the model is not that of a loop.
    """
    if not _IsLoop(model):
        allowed = "a loop, LinearizePorts(diagram, context, port, is_opened=True)"
        Refuse("model", repr(model), allowed)
    places, lines = _Read(model)
    w = _Frequencies(model, places)
    # The loci begin near their values at 0 rad/s.
    values = _Values(model, np.union1d(np.geomspace(w[0] / 1e3, w[0], _NUM_POINTS), w))
    figure, [[ax]] = MakeMultiples(
        [""], "real part of L", ["imaginary part of L"], height=4.4
    )
    for i, value in enumerate(values.T):
        ax.plot(value.real, value.imag, **RunStyle(i))
    DrawNyquistFrame(ax)
    for place in places:
        _DrawOnNyquist(ax, place)
    critical = Key("-1", color="black", marker="+", ms=7, linestyle="")
    AddLegend(figure, [critical, *lines, *_Names(model, values.shape[1])])
    return figure


def DrawNyquistFrame(ax: Axes) -> None:
    """Draws the unit circle, the axes and the critical point, and sets the limits."""
    ax.add_patch(Circle((0, 0), 1, fill=False, **GUIDE))
    ax.axhline(0, **GUIDE)
    ax.axvline(0, **GUIDE)
    ax.plot([-1], [0], "+", color="black", ms=7, zorder=5)
    limits = (-NYQUIST_RANGE, NYQUIST_RANGE)
    ax.set(xlim=limits, ylim=limits, aspect="equal")


def TrackedLoci(loci: ComplexArray) -> ComplexArray:
    """Returns eigenloci (K, m) in an order that makes each column continuous."""
    tracked = loci.copy()
    for before, now in itertools.pairwise(tracked):
        _, order = linear_sum_assignment(np.abs(before[:, np.newaxis] - now))
        now[:] = now[order]
    return tracked


def ContinuousPhase(angle: Array) -> Array:
    """Returns a phase in degrees without its jumps by 360.

    A jump by 180 at an undamped mode is taken as downward, which is its direction with
    any damping.
    """
    steps = (np.diff(angle) + 210) % 360 - 210
    return np.cumsum(np.append(angle[:1], steps))


def LocusKeys(count: int) -> list[Line2D]:
    """Returns the legend entries of eigenloci if there are several."""
    return RunKeys(f"locus {i}" for i in range(1, count + 1)) if count > 1 else []


def _IsLoop(model: Model) -> bool:
    return isinstance(model, SampledModel) or model.is_loop


def _Read(model: Model) -> tuple[list[_Place], list[Artist]]:
    """Returns the places of a model's margins, and entries of the legend."""
    if not _IsLoop(model):
        return [], []
    margins = model.margins()
    if not margins.is_stable:
        words = f"the closed loop is unstable; {margins.remedy}"
        return [], [Key(textwrap.fill(words, _NUM_LETTERS), linestyle="")]
    places = _Places(model, margins)
    lines: list[Artist] = [
        Key(place.label, **place.look, linestyle="") for place in places
    ]
    if math.isinf(margins.delay):
        lines.append(Key("stable with every delay", linestyle=""))
    elif isinstance(model, SampledModel):
        # A continuous delay of a sampled loop is at no point of L.
        lines.append(Key(f"delay margin {margins.delay:.4g} s", linestyle=""))
    return places, lines


def _Places(model: Model, margins: Margins) -> list[_Place]:
    """Returns the places of the finite margins of a stable loop."""
    places = []
    for gain, w in zip(margins.gain, margins.gain_frequencies, strict=True):
        if 0.0 < gain < math.inf:
            label = f"gain margin {gain:.3g} ({20 * math.log10(gain):.1f} dB)"
            places.append(_PlaceAt(model, label, w, [-1 / gain], _GAIN))
    if math.isfinite(margins.phase):
        turns = np.exp(1j * margins.phase * np.array([1, -1]))
        label = f"phase margin {math.degrees(margins.phase):.3g}°"
        places.append(_PlaceAt(model, label, margins.phase_frequency, -turns, _PHASE))
    if math.isfinite(margins.delay) and isinstance(model, PortModel):
        # The locus is turned to -1 by the delay.
        turn = np.exp(1j * margins.frequency * margins.delay)
        label = f"delay margin {margins.delay:.4g} s"
        places.append(_PlaceAt(model, label, margins.frequency, [-turn], _DELAY))
    return places


def _PlaceAt(
    model: Model,
    label: str,
    frequency: float,
    targets: Sequence[complex] | ComplexArray,
    look: Look,
) -> _Place:
    """Returns the point of the loci at a frequency that is next to one of some values.

    Args:
        targets: The values; at 0 rad/s, where a locus may be infinite, the point is the
            first one.
    """
    value = complex(targets[0])
    if frequency > 0:
        (values,) = _Values(model, np.array([frequency]))
        distances = np.abs(values[:, np.newaxis] - np.asarray(targets))
        value = complex(values[distances.min(axis=1).argmin()])
    return _Place(f"{label} at {frequency:.3g} rad/s", frequency, value, look)


def _Frequencies(model: Model, places: Sequence[_Place]) -> Array:
    """Returns the frequencies in rad/s that a plot shows."""
    w = model.bode().frequencies
    low, high = w[0], w[-1]
    found = [place.frequency for place in places if place.frequency > 0]
    if found:
        low = min(found) / 10**_BELOW
        high = max(found) * 10**_ABOVE
    if isinstance(model, SampledModel):
        high = min(high, w[-1])
    return np.union1d(_Dense(model, low, high), found)


def _Dense(model: Model, low: float, high: float) -> Array:
    """Returns frequencies between two ones, at which the phase can be followed."""
    delays = model.delays if isinstance(model, PortModel) else ()
    num_points = min(math.ceil(sum(delays) * high / _TURN), _MOST_POINTS)
    even = np.linspace(low, high, num_points + 2)
    # The last one is not rounded up: a sampled loop has none beyond it.
    return np.union1d(np.geomspace(low, high, _NUM_POINTS)[:-1], even)


def _Values(model: Model, w: Array) -> ComplexArray:
    """Returns the values to plot (K, m): the eigenloci of a loop, or all responses."""
    response = model.Response(w)
    if not _IsLoop(model):
        return response.reshape(len(w), -1)
    # On an undamped mode the response is infinite, and a curve has a gap.
    response[~np.isfinite(response).all(axis=(1, 2))] = np.nan
    if response.shape[1] == 1:
        return response[:, 0]
    loci = np.full(response.shape[:2], np.nan + 0j)
    is_finite = np.isfinite(response).all(axis=(1, 2))
    loci[is_finite] = np.linalg.eigvals(response[is_finite])
    loci[is_finite] = TrackedLoci(loci[is_finite])
    sizes = np.nanmax(np.abs(loci), axis=0)
    return loci[:, sizes > _NOTHING * sizes.max()]


def _Phases(w: Array, values: ComplexArray, places: Sequence[_Place]) -> Array:
    """Returns continuous phases in degrees (K, m), on the branch of the margins.

    On this branch the phase at a margin of the phase or, without one, of another one
    lies in the turn below 0. Without a margin the phase begins as near to 0 as it can.
    """
    phases = np.full(values.shape, np.nan)
    is_finite = np.isfinite(values)
    at = next((x for x in places if x.look is _PHASE), places[0] if places else None)
    for i, value in enumerate(values.T):
        known = is_finite[:, i]
        angle = np.degrees(np.angle(value[known]))
        phase = ContinuousPhase(angle)
        if at is None:
            turns = np.round(phase[0] / 360)
        else:
            k = int(np.argmin(np.abs(w[known] - at.frequency)))
            # Rounding errors do not turn a positive, real value by 360 degrees.
            turns = np.ceil((phase[k] - 1e-6) / 360)
        phases[known, i] = phase - 360 * turns
    return phases


def _PhaseAt(place: _Place, w: Array, values: ComplexArray, phases: Array) -> float:
    """Returns the phase in degrees of the locus of a margin on its branch."""
    k = int(np.argmin(np.abs(w - place.frequency)))
    i = int(np.nanargmin(np.abs(values[k] - place.value)))
    return float(phases[k, i])


def _MagnitudeLimits(magnitudes: Array) -> tuple[float, float]:
    """Returns the limits of the magnitudes, which contain 1."""
    known = magnitudes[np.isfinite(magnitudes) & (magnitudes > 0)]
    if known.size == 0:
        return MAGNITUDES
    low = min(known.min(), 0.5)
    high = max(known.max(), 2.0)
    return max(low / 1.5, MAGNITUDES[0]), min(high * 1.5, MAGNITUDES[1])


def _SetPhaseLimits(ax: Axes, phases: Array, shown: Sequence[float]) -> None:
    """Limits the phases to what is marked and half a turn below it."""
    known = phases[np.isfinite(phases)]
    low, high = known.min(initial=math.inf), known.max(initial=-math.inf)
    if shown:
        low = max(low, min(shown) - 180)
        low = min(low, *shown)
        high = max(high, *shown)
    low = 90 * math.floor((low - 20) / 90)
    high = 90 * math.ceil((min(high, low + 900) + 20) / 90)
    ax.set_ylim(low, high)
    ax.yaxis.set_major_locator(MultipleLocator(90 if high - low <= 540 else 180))
    for level in range(-180 + 360 * math.ceil((low + 180) / 360), int(high) + 1, 360):
        if shown:
            ax.axhline(level, **GUIDE)


def _DrawOnBode(top: Axes, bottom: Axes, place: _Place, phase: float) -> list[float]:
    """Draws a margin as a line to the critical value; returns phases to be shown."""
    w = place.frequency
    size = abs(place.value)
    # The nearest odd multiple of -180 degrees.
    critical = 360 * round((phase - 180) / 360) + 180
    line: Any = {"color": place.look["color"], "linewidth": 1.6, "zorder": 8}
    dot: Any = {**place.look, "linestyle": "", "zorder": 9, "clip_on": False}
    for ax in (top, bottom):
        ax.axvline(w, color=place.look["color"], linewidth=0.6, linestyle=":")
    if place.look is _GAIN:
        top.plot([w, w], [size, 1.0], **line)
    elif place.look is _PHASE:
        bottom.plot([w, w], [phase, critical], **line)
    top.plot([w], [size], **dot)
    bottom.plot([w], [phase], **dot)
    return [phase, critical]


def _DrawOnNyquist(ax: Axes, place: _Place) -> None:
    """Draws a margin as a line from its point to -1, along a ray or about 0."""
    value = place.value
    line: Any = {"color": place.look["color"], "linewidth": 1.6, "zorder": 4}
    if place.look is _GAIN:
        ax.plot([value.real, -1.0], [0.0, 0.0], **line)
    elif place.look is _PHASE:
        angle = math.degrees(math.atan2(value.imag, value.real)) % 360
        ends = sorted((angle, 180.0))
        ax.add_patch(Arc((0, 0), 2, 2, theta1=ends[0], theta2=ends[1], **line))
    dot: Any = {**place.look, "linestyle": "", "zorder": 9}
    ax.plot([value.real], [value.imag], **dot)


def _Names(model: Model, count: int) -> list[Artist]:
    """Returns the legend entries of the curves if there are several."""
    if isinstance(model, SampledModel) or model.is_loop or count == 1:
        return [*LocusKeys(count)]
    num_outputs, num_inputs = model.num_open
    return [
        *RunKeys(
            f"output {i} by input {j}"
            for i in range(num_outputs)
            for j in range(num_inputs)
        )
    ]
