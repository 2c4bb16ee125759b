"""A recording between its samples: pieces of time, in each a polynomial.

The integrator's steps are long compared with what happens in them, so no number is
read off at the samples. Between two samples every signal is a polynomial: position
and velocity by quintic Hermite interpolation of (p_WT, v_WT, a_WT), everything else by
Recording.Interpolate(). Instants are roots of these polynomials, peaks are their
extremes, and integrals are exact for them. Metrics thus converge with the solver, not
with the sampling.

A signal is held as its values (M, 8) or (M, 8, k) at the nodes of M pieces.
"""

import dataclasses

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebvander
from numpy.polynomial.legendre import Legendre

from teleop_drake.recording import Recording
from teleop_drake.validation import Refuse

# A polynomial of degree 7 on a piece of time is kept as its values at the 8
# Gauss-Lobatto points of [-1, 1], both ends included.
_DEGREE = 7
_INNER = np.sort(Legendre.basis(_DEGREE).deriv().roots().real)
_NODES = np.concatenate([[-1.0], _INNER, [1.0]])
# Weights of the mean over the piece, exact up to degree 13.
_WEIGHTS = 1 / (_DEGREE * (_DEGREE + 1) * Legendre.basis(_DEGREE)(_NODES) ** 2)
_TO_CHEBYSHEV = np.linalg.inv(chebvander(_NODES, _DEGREE))
_DERIVATIVE = chebvander(_NODES, _DEGREE - 1) @ chebder(_TO_CHEBYSHEV)

# Newton's method takes some seven; bisection of a bracket alone as many as these.
_MAX_ITERATIONS = 60

# Pieces shorter than this share of the recording are jumps.
_SHORTEST_PIECE = 1e-14


def FinitePart(recording: Recording) -> Recording:
    """Returns the recording up to its first sample that is not finite.

    Args:
        recording: A run.

    Raises:
        ValueError: If it has no finite sample.
    """
    is_finite = np.isfinite(recording.time)
    for samples in recording.signals.values():
        is_finite &= np.isfinite(samples).all(axis=1)
    if is_finite.all() and len(is_finite) > 0:
        return recording
    count = int(np.argmin(is_finite)) if len(is_finite) > 0 else 0
    if count == 0:
        Refuse("recording.time", [], "a list of one finite sample or more")
    return dataclasses.replace(
        recording,
        time=recording.time[:count],
        signals={name: x[:count] for name, x in recording.signals.items()},
    )


def Split(time: np.ndarray, instants: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the pieces of time between the samples.

    Args:
        time: (N,) of the samples, in s.
        instants: More times in s at which a piece ends and the next one begins.

    Returns:
        When they begin and when they end, (M,) each in s, ascending. A jump is no
        piece; a recording of one instant is one of no length.
    """
    edges = np.sort(np.concatenate([time, instants]))
    is_piece = np.diff(edges) > _SHORTEST_PIECE * (edges[-1] - edges[0])
    if not is_piece.any():
        return edges[-1:], edges[-1:]
    return edges[:-1][is_piece], edges[1:][is_piece]


def NodeTimes(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Returns the times (M, 8) of the nodes of the pieces, in s.

    Args:
        begin: (M,) when the pieces begin, in s.
        end: (M,) when they end, in s.
    """
    times = ((1 - _NODES) * begin[:, None] + (1 + _NODES) * end[:, None]) / 2
    return np.asarray(times)


def Sample(
    recording: Recording,
    name: str,
    begin: np.ndarray,
    end: np.ndarray,
    *,
    is_cautious: bool = True,
) -> np.ndarray:
    """Returns a signal (M, 8, k) at the nodes of the pieces.

    Args:
        recording: A run.
        name: Of the signal.
        begin: (M,) when the pieces begin, in s.
        end: (M,) when they end, in s.
        is_cautious: See Recording.Interpolate().
    """
    time, samples = recording.time, recording[name]
    if len(begin) == 1 and begin[0] == end[0]:
        return np.tile(samples[-1], (1, len(_NODES), 1))
    times = NodeTimes(begin, end)
    values = recording.Interpolate(name, times.ravel(), is_cautious=is_cautious)
    values = values.reshape(*times.shape, -1)
    # At a jump Interpolate() returns the value before it.
    i = _Intervals(time, begin, end)
    starts_there = begin == time[i]
    values[starts_there, 0] = samples[i[starts_there]]
    return values


def Motion(
    recording: Recording, begin: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns p_WT in m and v_WT in m/s (M, 8, n) at the nodes of the pieces.

    Without a signal `tool_acceleration` they are interpolated as any other signal.

    Args:
        recording: A run.
        begin: (M,) when the pieces begin, in s.
        end: (M,) when they end, in s.
    """
    if "tool_acceleration" not in recording.signals or begin[0] == end[0]:
        p = Sample(recording, "tool_position", begin, end)
        return p, Sample(recording, "tool_velocity", begin, end)
    time = recording.time
    i = _Intervals(time, begin, end)
    h = (time[i + 1] - time[i])[:, None, None]
    s = ((NodeTimes(begin, end) - time[i, None]) / h[:, 0])[:, :, None]
    p0, p1 = (recording["tool_position"][k][:, None] for k in (i, i + 1))
    v0, v1 = (recording["tool_velocity"][k][:, None] for k in (i, i + 1))
    a0, a1 = (recording["tool_acceleration"][k][:, None] for k in (i, i + 1))
    # In a very short step the difference of the positions is but rounding errors;
    # then the velocities and accelerations alone decide.
    distance = p1 - p0
    expected = h * (v0 + v1) / 2 + h**2 * (a0 - a1) / 12
    is_noise = np.abs(distance - expected) < 64 * np.spacing(np.abs(p0) + np.abs(p1))
    distance = np.where(is_noise, expected, distance)
    e = distance - h * v0 - h**2 * a0 / 2
    f = h * (v1 - v0 - h * a0)
    g = h**2 * (a1 - a0)
    c3 = 10 * e - 4 * f + g / 2
    c4 = -15 * e + 7 * f - g
    c5 = 6 * e - 3 * f + g / 2
    p = p0 + s * (h * v0 + s * (h**2 * a0 / 2 + s * (c3 + s * (c4 + s * c5))))
    v = v0 + s * (h * a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)) / h)
    # Exactly, so that neighbours agree on which side of a boundary they meet.
    ends_there = end == time[i + 1]
    p[ends_there, -1] = p1[ends_there, 0]
    return p, v


def Crossings(
    begin: np.ndarray, end: np.ndarray, y: np.ndarray
) -> list[tuple[float, bool]]:
    """Returns when a signal crosses 0, in s, and whether upwards.

    Args:
        begin: (M,) when the pieces begin, in s.
        end: (M,) when they end, in s.
        y: (M, 8) the signal at the nodes.
    """
    is_above = y >= 0
    i, j = np.nonzero(is_above[:, :-1] != is_above[:, 1:])
    c = _TO_CHEBYSHEV @ y[i].T
    s = _Roots(c, _NODES[j], _NODES[j + 1], is_above[i, j], 2e-16)
    times = ((1 - s) * begin[i] + (1 + s) * end[i]) / 2
    return list(zip(times.tolist(), is_above[i, j + 1].tolist(), strict=True))


def Trace(y: np.ndarray) -> np.ndarray:
    """Returns values of a signal between which it is monotonic.

    Args:
        y: (M, 8) the signal at the nodes.

    Returns:
        (M, 15): the values at the nodes and, between two of them, the extreme that
        lies there (or the former value again).
    """
    slope = y @ _DERIVATIVE.T
    i, j = np.nonzero(slope[:, :-1] * slope[:, 1:] < 0)
    c = _TO_CHEBYSHEV @ y[i].T
    # An extreme is flat: its value is as exact as the numbers are.
    s = _Roots(chebder(c), _NODES[j], _NODES[j + 1], slope[i, j] >= 0, 1e-8)
    values = np.repeat(y, 2, axis=1)[:, :-1]
    values[i, 2 * j + 1] = _Value(c, s)
    return values


def Variation(y: np.ndarray) -> np.ndarray:
    """Returns the total variation of a signal, jumps included, per axis (n).

    Args:
        y: (M, 8, n) the signal at the nodes.
    """
    values = np.array([Trace(axis).ravel() for axis in np.moveaxis(y, 2, 0)])
    variation: np.ndarray = np.abs(np.diff(values)).sum(axis=1)
    return variation


def Maximum(y: np.ndarray, first: int, last: int) -> float:
    """Returns the maximum of a signal over some pieces.

    Args:
        y: (M, 8) the signal at the nodes.
        first: Number of the first piece.
        last: Number of the piece after the last one. If it is not after the first
            one, the value where the first one begins is the maximum.
    """
    if first >= last:
        return ValueBefore(y, first)
    return float(Trace(y[first:last]).max())


def ValueBefore(y: np.ndarray, i: int) -> float:
    """Returns the value of a signal at the end of the piece before piece i.

    Args:
        y: (M, 8) the signal at the nodes.
        i: Number of a piece. Before the first one the signal is what it begins with.
    """
    return float(y[i - 1, -1]) if i > 0 else float(y[0, 0])


def RootMeanSquare(
    begin: np.ndarray, end: np.ndarray, error: np.ndarray
) -> list[float]:
    """Returns the rms over time of a signal, per axis.

    Args:
        begin: (M,) when the pieces begin, in s.
        end: (M,) when they end, in s.
        error: (M, 8, n) the signal at the nodes.
    """
    length = end - begin
    total = length.sum()
    share = length / total if total > 0 else np.ones(len(length))
    mean = np.einsum("m,j,mjn->n", share, _WEIGHTS, error**2)
    return [float(value) for value in np.sqrt(mean)]


def _Intervals(time: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Returns the indices (M,) of the samples that each piece follows."""
    indices = np.searchsorted(time, (begin + end) / 2) - 1
    return np.asarray(np.clip(indices, 0, None))


def _Roots(
    c: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    is_positive_at_low: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """Returns where Chebyshev series c (d, K) change their sign, each in its bracket.

    By Newton's method, and by bisection where that leaves the bracket.

    Args:
        c: Coefficients of K series.
        low: (K,) Lower ends of the brackets.
        high: (K,) Upper ends of the brackets.
        is_positive_at_low: (K,) Whether the series is >= 0 at the lower end.
        tolerance: How exactly, as a share of half a piece.
    """
    x: np.ndarray = (low + high) / 2
    if x.size == 0:
        return x
    slope = chebder(c)
    for _ in range(_MAX_ITERATIONS):
        y = _Value(c, x)
        is_low = (y >= 0) == is_positive_at_low
        low, high = np.where(is_low, x, low), np.where(is_low, high, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = x - y / _Value(slope, x)
        is_there = np.abs(newton - x) <= tolerance
        is_inside = (low < newton) & (newton < high)
        middle = (low + high) / 2
        x = np.where(is_there, x, np.where(is_inside, newton, middle))
        if np.all(is_there | (high - low <= tolerance)):
            break
    return x


def _Value(c: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Returns the values (K,) of Chebyshev series c (d, K), by Clenshaw's recurrence.

    chebval() spends most of its time on its arguments.
    """
    twice = 2 * x
    before, last = c[-2], c[-1]
    for coefficient in c[-3::-1]:
        before, last = coefficient - last, before + last * twice
    result: np.ndarray = before + last * x
    return result
