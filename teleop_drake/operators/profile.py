"""An operator who commands what was planned beforehand."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.environments import Surface
from teleop_drake.kernel import Term
from teleop_drake.numerics.piecewise_polynomial import evaluate_pieces
from teleop_drake.operators.modes import ModalOperator
from teleop_drake.validation import Refuse


class ProfileOperator(ModalOperator):
    """Commands a velocity that is a polynomial of time, piece after piece.

        v_d(t) = sum_i coefficients[k, i] (t - breaks[k])^i
                                             for breaks[k] <= t < breaks[k + 1]
               = 0                           before and after

    Ports, state, modes, initial value and feedthrough are those of ModalOperator.

    It does not react to forces, and does not know whether the tool follows.

    Args:
        breaks: (K + 1,) in s, ascending; the last one may be infinite.
        coefficients: (K, d + 1, n) in m/s, m/s^2 and so on.
        contact_force: Force after contact in N (n); None: never switches.
        contact_surface: Where contact is perceived; None: never.
        stop_time: When the stop is commanded in s; None: never.
        nonsmooth_times: When v_d is not smooth, s; steps of the solver end
            there, and short ones follow.
        ends: Where steps end as well: (first, period) each, in s.
        longest_step: No step of the solver may be longer, s.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        *,
        breaks: ArrayLike,
        coefficients: ArrayLike,
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
        nonsmooth_times: ArrayLike = (),
        ends: Sequence[tuple[float, float]] = (),
        longest_step: float = math.inf,
    ):
        self._breaks = np.array(breaks, dtype=float)
        self._coefficients = np.array(coefficients, dtype=float)
        if self._coefficients.ndim != 3 or self._breaks.shape != (
            len(self._coefficients) + 1,
        ):
            shape = self._coefficients.shape
            Refuse(
                "breaks", breaks, f"K + 1 with coefficients (K, d + 1, n), here {shape}"
            )
        if not (np.diff(self._breaks) > 0).all():
            Refuse("breaks", breaks, "ascending")
        if not np.isfinite(self._coefficients).all():
            Refuse("coefficients", coefficients, "finite")
        ModalOperator.__init__(
            self,
            num_axes=self._coefficients.shape[2],
            contact_force=contact_force,
            contact_surface=contact_surface,
            stop_time=stop_time,
            nonsmooth_times=nonsmooth_times,
            ends=ends,
            longest_step=longest_step,
        )

    def IntentionTerm(self) -> tuple[Term, Mapping[str, Any]]:
        """Returns the term of the intended velocity, and its parameters; see kernel."""
        parameters = {"breaks": self._breaks, "coefficients": self._coefficients}
        return (evaluate_pieces, "time", "breaks", "coefficients"), parameters
