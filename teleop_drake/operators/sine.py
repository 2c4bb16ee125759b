"""An operator who moves to and fro."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.environments import Surface
from teleop_drake.kernel import Term
from teleop_drake.operators.base import OperatorConfig
from teleop_drake.operators.modes import Array, CheckVelocity, ModalOperator
from teleop_drake.validation import CheckNumber, Number

MAX_FREQUENCY = 1000.0
"""Highest frequency in rad/s."""

# Steps of the solver in a period, at least.
_STEPS_PER_PERIOD = 20


class SineOperator(ModalOperator):
    """Commands a velocity that swings: v_d(t) = velocity sin(frequency t).

    Ports, state, modes, initial value and feedthrough are those of ModalOperator.

    It does not react to forces, and does not know whether the tool follows.

    Args:
        velocity: Amplitude in m/s (n).
        frequency: In rad/s, > 0.
        contact_force: Force after contact in N (n); None: never switches.
        contact_surface: Where contact is perceived; None: never.
        stop_time: When the stop is commanded in s; None: never.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        *,
        velocity: ArrayLike,
        frequency: float,
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
    ):
        self._velocity = CheckVelocity(velocity)
        CheckNumber("frequency", frequency, "rad/s", above=0)
        self._frequency = float(frequency)
        ModalOperator.__init__(
            self,
            num_axes=self._velocity.size,
            contact_force=contact_force,
            contact_surface=contact_surface,
            stop_time=stop_time,
            longest_step=2 * math.pi / frequency / _STEPS_PER_PERIOD,
        )

    def IntentionTerm(self) -> tuple[Term, Mapping[str, Any]]:
        """Returns the term of the intended velocity, and its parameters; see kernel."""
        parameters = {"velocity": self._velocity, "frequency": self._frequency}
        return (swinging_velocity, "time", "velocity", "frequency"), parameters


def swinging_velocity(time: float, velocity: Array, frequency: float) -> Array:
    """Returns velocity sin(frequency t) in m/s (n)."""
    swinging: Array = velocity * np.sin(frequency * time)
    return swinging


@dataclass(kw_only=True, eq=False)
class SineConfig(OperatorConfig):
    """v_d = velocity sin(frequency t): to and fro, from rest."""

    kind = "sine"

    # rad/s, > 0 to MAX_FREQUENCY. Assumed.
    frequency: float = Number(1.0, "rad/s", above=0, maximum=MAX_FREQUENCY)

    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> SineOperator:
        """Makes the block; see OperatorConfig.MakeOperator."""
        return SineOperator(
            velocity=self.velocity,
            frequency=self.frequency,
            contact_force=self.contact_force,
            contact_surface=contact_surface,
            stop_time=self.stop_time,
        )

    def LongestStep(self) -> float:
        """Returns a share of the period in s."""
        return 2 * math.pi / self.frequency / _STEPS_PER_PERIOD
