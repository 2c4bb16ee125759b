"""Base of the configs of operators."""

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.arrays import ArrayLike
from teleop_drake.blocks.environments import Surface
from teleop_drake.kinds import KindConfig
from teleop_drake.validation import (
    REQUIRED,
    CheckVector,
    Config,
    Number,
    Refuse,
    Within,
)

# Largest velocity on each axis, m/s: more than any hand reaches.
_MOST_VELOCITY = 1000.0


@Config
class OperatorConfig(KindConfig, ABC):
    """Who holds the haptic device (thesis section 2.5).

    An operator of your own derives from this class, adds its fields, and makes its
    block in MakeOperator. It can be named in a scenario:
    `surgeon: {kind: my_module:MyOperator}`.
    """

    # The velocity that is commanded at most, m/s, n entries, not all zero; of six, the
    # last three are the angular velocity, rad/s. Limits of runs, operating points of an
    # analysis and defaults of controllers go by it.
    velocity: np.ndarray = REQUIRED
    # Force once contact is perceived, N, n entries; null: keeps commanding velocity.
    # It has no effect where the environment has no contact surface.
    contact_force: np.ndarray | None = None
    # Time of the final stop, s, >= 0; null: never.
    stop_time: float | None = Number(None, "s", minimum=0)

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; refuses the first bad one by a ScenarioError."""
        with Within(path):
            CheckVector("velocity", self.velocity, num_axes, "m/s")
            if np.abs(self.velocity).max() > _MOST_VELOCITY:
                allowed = f"at most {_MOST_VELOCITY:g} m/s on each axis"
                Refuse("velocity", self.velocity, allowed)
            if not np.any(self.velocity):
                Refuse("velocity", self.velocity, "non-zero on at least one axis")
            if self.contact_force is not None:
                CheckVector("contact_force", self.contact_force, num_axes, "N")
            self.CheckNumbers()

    @abstractmethod
    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> System:
        """Makes the block.

        | port | name             | size | unit                        |
        |------|------------------|------|-----------------------------|
        | in   | haptic_force     | n    | N, of the haptic device     |
        | in   | felt_position    | n    | m, from the return channel  |
        | in   | felt_velocity    | n    | m/s, from the return channel |
        | out  | velocity_command | n    | m/s                         |
        | out  | force_command    | n    | N                           |
        | out  | mode             | 1    | 0 velocity, 1 force, 2 stopped |

        It may leave out inputs. It may have an attribute `jump_times` (when its outputs
        jump in any case, s), `longest_step` (no step of the solver may be longer, s),
        `contact_surface` (where it perceives contact) and `has_constant_command`
        (whether v_d is `velocity` as long as the mode is 0; metrics compare with the
        command that arrives at the slave where it is not).

        Args:
            start: p_WT at time 0 in m (n).
            contact_surface: Where it perceives contact; None: nowhere.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def Modes(self, contact_surface: Surface | None) -> dict[str, Any]:
        """Returns what every ModalOperator takes: when it changes its mode."""
        return {
            "contact_force": self.contact_force,
            "contact_surface": contact_surface,
            "stop_time": self.stop_time,
        }

    def MakeLinearOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> System:
        """Makes the block by which a linear analysis replaces the operator.

        Here the operator's own, which is right if its states are continuous. An
        operator without a linear model raises a ScenarioError.
        """
        return self.MakeOperator(start=start, contact_surface=contact_surface)

    def LinearNote(self) -> str | None:
        """Returns a sentence: what the linear model assumes; None: nothing."""
        return None

    def LongestStep(self) -> float:
        """Returns the longest step in s that the solver may take, infinity if any."""
        return math.inf
