"""A source that outputs a trajectory."""

import math
from typing import Any

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.loops.kernel import Kernel, KernelBlock, Transition
from teleop_drake.loops.numerics.instants import same_within

# A break counts as reached so many s before its time, if no piece is that short.
_REACHED = 1e-9

# With more breaks than this at equal distances, there is one periodic event.
_MOST_EVENTS = 16


class TrajectorySource(KernelBlock):
    """Outputs a piecewise polynomial of time and its derivatives.

        y0(t) = [p(t); p'(t); ...],   p the polynomial of the piece that contains t

    It is used like Drake's TrajectorySource, which does not tell its trajectory and
    therefore runs in Drake's Simulator only. Steps end exactly at the breaks, so jumps
    are sharp, also behind a delay.

    | port | name | size         | unit              |
    |------|------|--------------|-------------------|
    | out  | y0   | rows (1 + d) | of the trajectory |

    State: the number of breaks that have passed, a discrete state.

    Initial value: the piece at the time when the run begins.

    Before the first break and after the last one, the value is that at this break, and
    the derivatives are 0.

    It has no numeric parameters. It does not take other trajectories, such as splines
    by control points or quaternions.

    Args:
        trajectory: The trajectory, a column vector, from its start_time() >= 0 s to its
            end_time().
        output_derivative_order: The number d of derivatives in the output, >= 0.

    Raises:
        ScenarioError: If an argument is not allowed.
    """

    def __init__(
        self, trajectory: PiecewisePolynomial, output_derivative_order: int = 0
    ):
        KernelBlock.__init__(self)
        _Check(trajectory, output_derivative_order)
        breaks = np.array(trajectory.get_segment_times(), dtype=float)
        breaks = breaks[np.isfinite(breaks)]
        self._coefficients = np.concatenate(
            [
                _Coefficients(trajectory, order)
                for order in range(output_derivative_order + 1)
            ],
            axis=2,
        )
        # Each piece is a polynomial of the time since its base.
        self._bases = np.r_[breaks[:1], breaks] if len(breaks) else np.zeros(1)
        margin = min([_REACHED, *(np.diff(breaks) / 2)])
        self._edges = breaks - margin
        self._breaks = breaks
        self.DeclareDiscreteState(1)
        self.DeclareOutputs(y0=self._coefficients.shape[2])

    def Kernel(self) -> Kernel:
        """Returns the kernel; the mode counts the breaks that have passed."""
        piece = (piece_at, "time", "edges")
        return Kernel(
            parameters={
                "edges": self._edges,
                "bases": self._bases,
                "coefficients": self._coefficients,
            },
            outputs={"y0": (value_of_piece, "time", "mode", "bases", "coefficients")},
            transitions={
                f"break_{k}": Transition(mode=piece, offset=offset, period=period)
                for k, (offset, period) in enumerate(_Instants(self._breaks))
            },
            initial_mode=piece,
        )


def piece_at(time: float, edges: Array) -> Array:
    """Returns the number of breaks that have passed at a time (1).

    Args:
        time: The time, s.
        edges: The instants from which the breaks count as passed, ascending, s (K).
    """
    return np.array([np.searchsorted(edges, time, side="right")]) + 0.0


def value_of_piece(
    time: float, mode: Array, bases: Array, coefficients: Array
) -> Array:
    """Returns the value of a piece (n).

    Args:
        time: The time t, s.
        mode: The index k of the piece (1).
        bases: The time from which each piece counts, s (K).
        coefficients: The coefficients (K, d + 1, n) of ascending powers of
            t - bases[k].
    """
    k = int(mode[0])
    since = time - bases[k]
    value = coefficients[k, -1]
    for i in range(coefficients.shape[1] - 2, -1, -1):
        value = value * since + coefficients[k, i]
    return value


def _Check(trajectory: Any, order: int) -> None:
    """Refuses what is no piecewise polynomial, a column vector from 0 s on."""
    if not isinstance(trajectory, PiecewisePolynomial):
        Refuse("trajectory", type(trajectory).__name__, "a PiecewisePolynomial")
    CheckNumber("output_derivative_order", order, minimum=0)
    num_pieces = trajectory.get_number_of_segments()
    shape = (trajectory.rows(), trajectory.cols()) if num_pieces else (0, 0)
    if shape[0] == 0 or shape[1] != 1:
        Refuse("trajectory", f"{shape[0]} x {shape[1]}", "a column vector")
    start = trajectory.start_time()
    if start < 0 and math.isfinite(start):
        Refuse("trajectory", f"from {start:g} s on", "from 0 s or later on")


def _Coefficients(trajectory: PiecewisePolynomial, order: int) -> Array:
    """Returns the coefficients of a derivative of a trajectory (K, degree + 1, n).

    Two constant pieces are added, before the first break and after the last one.

    Args:
        order: The order of the derivative; 0: the trajectory itself.
    """
    derivative = trajectory.MakeDerivative(order) if order else trajectory
    numbers = range(trajectory.get_number_of_segments())
    degree = max(trajectory.getSegmentPolynomialDegree(i) for i in numbers)
    pieces = np.zeros((len(numbers), degree + 1, trajectory.rows()))
    for k, row in np.ndindex(len(numbers), trajectory.rows()):
        found = derivative.getPolynomial(k, row, 0).GetCoefficients()
        pieces[k, : len(found), row] = found
    if not math.isfinite(trajectory.start_time()):
        return pieces
    ends = np.zeros((2, degree + 1, trajectory.rows()))
    if order == 0:
        ends[0, 0] = trajectory.value(trajectory.start_time()).ravel()
        ends[1, 0] = trajectory.value(trajectory.end_time()).ravel()
    return np.concatenate([ends[:1], pieces, ends[1:]])


def _Instants(breaks: Array) -> list[tuple[float, float]]:
    """Returns the events at breaks: the first instant and the period of each, s."""
    if len(breaks) > _MOST_EVENTS:
        period = (breaks[-1] - breaks[0]) / (len(breaks) - 1)
        ticks = breaks[0] + period * np.arange(len(breaks))
        if np.abs(ticks - breaks).max() <= same_within(breaks[-1]):
            return [(float(breaks[0]), float(period))]
    return [(time, math.inf) for time in breaks.tolist()]
