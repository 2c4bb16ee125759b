"""The haptic device in the operator's hand."""

from dataclasses import field

import numpy as np
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import Adder, Gain, LinearSystem

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import (
    Config,
    FixedFields,
    Number,
    Refuse,
    Within,
)
from teleop_drake.loops.framework.wiring import Wire
from teleop_drake.model.laws.transfer_function import realize_transfer_function


@Config
class HapticDeviceConfig(FixedFields):
    """F_h = H(s) (v_d - v) on each axis (thesis eq. 2.1, 2.4, 2.5)."""

    # Coefficients of H in N s/m, highest power of s first.
    numerator: np.ndarray = field(default_factory=lambda: np.array([25.0, 50.0]))
    # Coefficients of the denominator, highest power first. The first is not zero, and
    # there are at least as many as in the numerator (H is proper).
    denominator: np.ndarray = field(default_factory=lambda: np.array([1.0, 25.0, 0.0]))
    # With six axes, the moments about the last three are lever^2 H(s) times the error
    # of the angular velocity, m, > 0. Assumed.
    lever: float = Number(0.1, "m", above=0)

    def Check(self, path: str) -> None:
        """Checks every field."""
        self.CheckNumbers(path)
        with np.errstate(over="ignore"), Within(path):
            matrices = realize_transfer_function(self.numerator, self.denominator)
        if not all(np.all(np.isfinite(matrix)) for matrix in matrices):
            Refuse(
                f"{path}.denominator",
                self.denominator,
                "coefficients that can be divided by the first one",
            )

    def MakeDevice(self, num_axes: int) -> "HapticDevice":
        """Makes the device."""
        return HapticDevice(
            numerator=self.numerator,
            denominator=self.denominator,
            num_axes=num_axes,
            lever=self.lever,
        )


class HapticDevice(Diagram):
    """Computes the haptic force from the velocity error that the operator feels.

        F_h(s) = H(s) [v_d(s) - v(s)],   the same H(s) on every axis   (2.1, 2.4, 2.5)

    The thesis uses H(s) = (25 s + 50)/(s^2 + 25 s). It prints the error with the
    opposite sign (2.2), which would be positive feedback.

    | port | name             | size | unit |
    |------|------------------|------|------|
    | in   | velocity_command | n    | m/s  |
    | in   | felt_velocity    | n    | m/s  |
    | out  | haptic_force     | n    | N    |

    State: H(s) in controllable canonical form, axis after axis (n k, k = order of H).

    Initial value: zero state, so that F_h(0) = 0 if H is strictly proper.

    Direct feedthrough: from both inputs if the degrees of numerator and denominator
    are equal, else none.

    It models neither delays nor contact. The operator may replace F_h by another
    command after contact. An integrator in H, as in the thesis, is neither reset nor
    limited.

    Args:
        numerator: Coefficients of H's numerator, highest power of s first.
        denominator: Coefficients of H's denominator, highest power first.
        num_axes: Number n of axes, >= 1.
        lever: Lever arm in m. From the fourth axis on, the output is a moment, and the
            transfer function is lever^2 H(s).
    """

    def __init__(
        self,
        numerator: ArrayLike,
        denominator: ArrayLike,
        num_axes: int,
        *,
        lever: float = 1.0,
    ):
        Diagram.__init__(self)
        A, B, C, D = realize_transfer_function(
            numerator, denominator, num_axes=num_axes
        )
        # From the fourth axis on, the output is lever^2 H(s).
        scale = np.append(np.ones(3), np.full(3, lever**2))[:num_axes, np.newaxis]
        C = scale * C
        D = scale * D
        Wire(
            self,
            "haptic_device",
            {
                "negation": Gain(-1.0, num_axes),
                "velocity_error": Adder(2, num_axes),
                "transfer_function": LinearSystem(A, B, C, D),
            },
            inputs={
                "velocity_command": ["velocity_error.u0"],
                "felt_velocity": ["negation"],
            },
            connections={
                "velocity_error.u1": "negation",
                "transfer_function": "velocity_error",
            },
            outputs={"haptic_force": "transfer_function"},
        )
