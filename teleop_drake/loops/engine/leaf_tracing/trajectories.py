"""The stand-in for a PiecewisePolynomial in a function that is followed."""

import math
from typing import Any

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from teleop_drake.loops.engine.leaf_tracing.stand_ins import StandIn
from teleop_drake.loops.jit.symbolic_arrays import AsNumbers, HasNumbers, Where

_CONSTANT = (
    "rows", "cols", "start_time", "end_time", "get_segment_times",
    "get_number_of_segments",
)  # fmt: skip


class Trajectory(StandIn):
    """A piecewise polynomial, which is evaluated at Numbers.

    As in Drake, it has its values at the ends outside of its range of times.
    """

    what = "a trajectory"
    kind = PiecewisePolynomial

    def __init__(self, trajectory: PiecewisePolynomial):
        self._trajectory = trajectory
        for name in _CONSTANT:
            setattr(self, name, getattr(trajectory, name))

    def value(self, t: Any) -> Any:
        """Returns the value at a time in s, a matrix."""
        return _ValueAt(self._trajectory, t)

    def MakeDerivative(self, derivative_order: int = 1) -> "Trajectory":
        return Trajectory(self._trajectory.MakeDerivative(derivative_order))

    derivative = MakeDerivative

    def EvalDerivative(self, t: Any, derivative_order: int = 1) -> Any:
        return self.MakeDerivative(derivative_order).value(t)


def _ValueAt(trajectory: PiecewisePolynomial, t: Any) -> Any:
    """Returns the value of a trajectory at a time in s, which may be a Number."""
    if isinstance(t, np.ndarray):
        t = t.item()
    if not HasNumbers(t):
        return AsNumbers(trajectory.value(t))
    breaks = trajectory.get_segment_times()
    t = Where(t < breaks[0], breaks[0], Where(t > breaks[-1], breaks[-1], t))
    result: Any = None
    for k, start in enumerate(breaks[:-1]):
        value = np.empty((trajectory.rows(), trajectory.cols()), object)
        # A constant trajectory begins at minus infinity.
        elapsed = t - start if math.isfinite(start) else 0.0
        for i, j in np.ndindex(*value.shape):
            element: Any = 0.0
            coefficients = trajectory.getPolynomial(k, i, j).GetCoefficients()
            for coefficient in coefficients[::-1]:
                element = element * elapsed + coefficient
            value[i, j] = element
        result = value if k == 0 else Where(t >= start, value, result)
    return AsNumbers(result)
