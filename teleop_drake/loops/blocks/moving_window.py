"""A weighted average over a moving window: a distributed delay."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Diagram
from pydrake.trajectories import PiecewisePolynomial

from teleop_drake.loops.delays.base import SHORTEST_TIME, CheckSize
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.loops.framework.wiring import Wire
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.loops.numerics.moving_window import (
    MAX_DEGREE,
    lag_chain_rate,
    window_weights,
    windowed,
)


class MovingWindow(Diagram):
    """Averages a vector signal over the last T seconds, or weights it there.

        windowed_signal(t) = integral of w(s) signal(t - s) ds,   s from 0 to T

    The weights w are 1/T, or a piecewise polynomial of degree 3 at most, which may jump
    from piece to piece. This is a distributed delay: the output is a sum of the signal
    with all delays up to T. It is as accurate as the solver, also where the signal
    jumps.

    | port | name            | size | unit                          |
    |------|-----------------|------|-------------------------------|
    | in   | signal          | size | any                           |
    | out  | windowed_signal | size | of signal, times that of w ds |

    State: 15 to 18 first-order lags for each signal, and their history in a
    TransportDelay for each break of w after s = 0.

    Initial value: that of a signal that was `initial_value` before the start.

    Direct feedthrough: none.

    Steps: no step can be longer than the first break of w after s = 0.

    It has no numeric parameters: another window is another block.

    Args:
        window: T in s, for the average; or w in 1/s as a function (1 x 1) of the age s
            of the signal, from its start_time() >= 0 to its end_time(), T.
        size: Width of the signal, >= 1.
        initial_value: The signal before the start (size); zeros if None.
        max_sample_interval: As for TransportDelay.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        window: float | PiecewisePolynomial,
        size: int,
        initial_value: Sequence[float] | None = None,
        *,
        max_sample_interval: float | None = None,
    ):
        Diagram.__init__(self)
        breaks, pieces = _PiecesOf(window)
        CheckSize(size)
        before = np.zeros(size) if initial_value is None else np.array(initial_value)
        if before.shape != (size,):
            Refuse("initial_value", initial_value, f"{size} numbers or null")
        weights = window_weights(breaks, pieces)
        # Behind a constant signal, all lags have its value.
        rest = np.tile(before, weights.shape[1]).tolist()
        systems = {
            "lags": _Lags(breaks[-1], size, rest),
            "average": _Average(weights, size, len(rest)),
        }
        connections = {}
        for j, delay in enumerate(breaks):
            source = "lags"
            if delay > 0:
                source = f"memory{j}"
                systems[source] = _Memory(
                    delay, len(rest), rest, max_sample_interval=max_sample_interval
                )
                connections[source] = "lags"
            connections[f"average.states{j}"] = source
        Wire(
            self,
            "moving_window",
            systems,
            inputs={"signal": ["lags"]},
            connections=connections,
            outputs={"windowed_signal": "average"},
        )


class _Memory(TransportDelay):
    """A delay of fixed length, because the weights belong to it."""

    has_fixed_delays = True


class _Lags(FixedBlock):
    """A chain of first-order lags, see laws.moving_window."""

    def __init__(self, window: float, size: int, rest: list[float]):
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters={"window": window},
                outputs={"states": "state"},
                rate=(lag_chain_rate, "window", "state", "signal"),
            ),
            inputs={"signal": size},
            outputs={"states": len(rest)},
            state=rest,
        )


class _Average(FixedBlock):
    """The weighted sum of the lags' states at all breaks, see laws.moving_window."""

    def __init__(self, weights: Array, size: int, width: int):
        inputs = {f"states{j}": width for j in range(len(weights))}
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters={"weights": weights.ravel()},
                outputs={
                    "all_states": [*inputs],
                    "windowed_signal": (windowed, "weights", "all_states"),
                },
                sizes={"all_states": width * len(weights)},
            ),
            inputs=inputs,
            outputs={"windowed_signal": size},
        )


def _PiecesOf(window: float | PiecewisePolynomial) -> tuple[list[float], list[Array]]:
    """Returns the breaks of a window's weights, and the coefficients of each piece.

    Raises:
        ScenarioError: If the window is too short, or its weights are not allowed.
    """
    if not isinstance(window, PiecewisePolynomial):
        CheckNumber("window", window, "s", minimum=SHORTEST_TIME)
        return [0.0, float(window)], [np.array([1.0 / window])]
    numbers = range(window.get_number_of_segments())
    shape = (window.rows(), window.cols()) if numbers else (0, 0)
    if shape != (1, 1):
        Refuse("window", f"weights of {shape[0]} x {shape[1]}", "weights of 1 x 1")
    breaks = window.get_segment_times()
    degree = max(window.getSegmentPolynomialDegree(i) for i in numbers)
    if degree > MAX_DEGREE:
        Refuse("window", f"weights of degree {degree}", f"of degree <= {MAX_DEGREE}")
    if breaks[0] < 0:
        Refuse("window", f"weights from {breaks[0]:g} s on", "from an age >= 0 s on")
    first = min(x for x in breaks if x > 0)
    if first < SHORTEST_TIME:
        Refuse("window", f"a break at {first:g} s", f"breaks >= {SHORTEST_TIME:g} (s)")
    pieces = [window.getPolynomial(i, 0, 0).GetCoefficients() for i in numbers]
    if not all(np.isfinite(piece).all() for piece in pieces):
        Refuse("window", "weights that are not finite", "finite")
    return breaks, pieces
