"""Base classes of the operators' configs, and of the operators with modes."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.loops.framework.arrays import Array, ArrayLike, Record
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckNumber,
    CheckVector,
    Config,
    Number,
    Refuse,
    Within,
)
from teleop_drake.loops.kernel import FixedBlock, Kernel, Term, Transition
from teleop_drake.loops.kernel.linear_part import HeldForce, LinearPart
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.kinds import KindConfig
from teleop_drake.model.laws.operator import (
    force_command,
    operator_mode,
    velocity_command,
)

MOST_VELOCITY = 1000.0
"""The largest velocity that is allowed on each axis, m/s; no hand is as fast."""


@Config
class OperatorConfig(KindConfig, ABC):
    """The operator who holds the haptic device (thesis section 2.5).

    An operator of your own derives from this class, adds its fields, and makes its
    block in MakeOperator. A scenario selects it by the name of its class:
    `surgeon: {kind: my_module:MyOperator}`.
    """

    # Nominal largest velocity command, m/s, n entries, not all zero. With six entries,
    # the last three are the angular velocity, rad/s. Limits of runs, operating points
    # of an analysis and defaults of controllers derive from it.
    velocity: np.ndarray = REQUIRED
    # Force command after contact is perceived, N, n entries. Null: the operator keeps
    # commanding a velocity. No effect if the environment has no contact surface.
    contact_force: np.ndarray | None = None
    # Time of the final stop, s, >= 0; null: never.
    stop_time: float | None = Number(None, "s", minimum=0)

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; refuses the first bad one by a ScenarioError."""
        with Within(path):
            CheckVector("velocity", self.velocity, num_axes, "m/s")
            if np.abs(self.velocity).max() > MOST_VELOCITY:
                Refuse(
                    "velocity",
                    self.velocity,
                    f"at most {MOST_VELOCITY:g} m/s on each axis",
                )
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

        The block may leave out inputs. These attributes are optional:

        * jump_times: the times known in advance at which outputs jump, s
        * longest_step: the longest step that the solver may take, s
        * contact_surface: the surface at which the operator perceives contact
        * has_constant_command: whether v_d is `velocity` as long as the mode is 0. If
          it is not, metrics compare with the command that arrives at the slave.

        Args:
            start: p_WT at time 0 in m (n).
            contact_surface: The surface at which the operator perceives contact; None:
                contact is never perceived.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def Modes(self, contact_surface: Surface | None) -> Record:
        """Returns the arguments of ModalOperator that determine its changes of mode."""
        return {
            "contact_force": self.contact_force,
            "contact_surface": contact_surface,
            "stop_time": self.stop_time,
        }

    def MakeLinearOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> System:
        """Makes the block by which a linear analysis replaces the operator.

        By default, this is the operator's own block, which is right if its states are
        continuous. An operator without a linear model raises a ScenarioError.
        """
        return self.MakeOperator(start=start, contact_surface=contact_surface)

    def LinearNote(self) -> str | None:
        """Returns a sentence on the linear model's assumptions, or None."""
        return None

    def LongestStep(self) -> float:
        """Returns the longest step in s that the solver may take, or infinity."""
        return math.inf


class ModalOperator(FixedBlock):
    """Base of the operators that command a velocity, then a force, then a stop.

        mode 0, velocity: v_d = intended, F_h = force of the haptic device
        mode 1, force:    v_d = 0,        F_h = contact_force
        mode 2, stopped:  v_d = 0,        F_h = 0 if contact was perceived, otherwise
                                          the force of the haptic device, which brakes
                                          the tool

    Contact is perceived when the felt tool position reaches `contact_surface`, a return
    delay after the tool touched it. The operator then never returns to mode 0.

    | port | name             | size | unit                     |
    |------|------------------|------|--------------------------|
    | in   | haptic_force     | n    | N                        |
    | in   | felt_position    | n    | m, from the return channel |
    | out  | velocity_command | n    | m/s                      |
    | out  | force_command    | n    | N                        |
    | out  | mode             | 1    | 0, 1 or 2                |

    State (discrete, 2): [contact perceived, stopped], each 0 or 1. If the Context has
    an accuracy (context.SetAccuracy), a witness function locates the instant at which
    a continuous returned position reaches the surface. A returned position that jumps,
    as behind a sampled channel, is checked at the end of every step. That is the
    instant of the jump if an unrestricted update made it.

    Initial value: velocity mode.

    Direct feedthrough: haptic_force to force_command; nothing else.

    It does not model fatigue, and the force remains when the tool bounces off.

    Attributes:
        jump_times: The times known in advance at which the outputs jump or are not
            smooth, s.
        contact_surface: The surface at which contact is perceived; None: never.

    Args:
        num_axes: n.
        intention: The kernel term of v_d in m/s (n) before contact and before the stop.
        parameters: The parameters of this term, of `rate` and of `transitions`.
        inputs: Width of each further input by its name.
        rate: The kernel term of the continuous state's rate; None: no such state.
        state: The initial continuous state.
        memory: Initial values of further discrete states, which follow the first two.
        transitions: Further changes of the discrete state.
        contact_force: Force after contact in N (n); None: contact is never perceived.
        contact_surface: The surface at which contact is perceived; None: never.
        stop_time: The time of the stop in s; None: never.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        num_axes: int,
        intention: Term,
        parameters: Mapping[str, Any],
        *,
        inputs: Mapping[str, int] = MappingProxyType({}),
        rate: Term | None = None,
        state: ArrayLike = (),
        memory: ArrayLike = (),
        transitions: Mapping[str, Transition] = MappingProxyType({}),
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
    ):
        n = num_axes
        force = np.zeros(n) if contact_force is None else contact_force
        CheckVector("contact_force", force, n, "N")
        if contact_surface is not None:
            CheckVector("contact_surface.point_W", contact_surface.point_W, n, "m")
        self._contact_force = np.array(force, dtype=float)
        self._mode = np.append([0.0, 0.0], memory)
        self.contact_surface = None if contact_force is None else contact_surface
        self.jump_times: list[float] = []
        # The transitions between the modes.
        parameters = {"contact_force": self._contact_force, **parameters}
        switches = {}
        if self.contact_surface is not None:
            parameters["point"] = self.contact_surface.point_W
            parameters["normal"] = self.contact_surface.normal_W
            switches["perceives_contact"] = Transition(
                guard=(past_surface, "mode", "felt_position", "point", "normal"),
                mode=(with_contact, "mode"),
            )
        if stop_time is not None:
            CheckNumber("stop_time", stop_time, "s", minimum=0)
            self.jump_times = [stop_time]
            switches["stops"] = Transition(mode=(with_stop, "mode"), offset=stop_time)
        # The commands follow from the mode and from the intended velocity and force.
        outputs: dict[str, Term] = {
            "intended_velocity": intention,
            "velocity_command": (velocity_command, "mode", "intended_velocity"),
            "force_command": (force_command, "mode", "haptic_force", "contact_force"),
            "mode": (mode_vector, "mode"),
        }
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters=parameters,
                rate=rate,
                outputs=outputs,
                sizes={"intended_velocity": n},
                transitions={**switches, **transitions},
            ),
            inputs={"haptic_force": n, "felt_position": n, **inputs},
            outputs={"velocity_command": n, "force_command": n, "mode": 1},
            state=state,
            mode=self._mode,
        )

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns that the mode stays as it is, and the force held after contact."""
        if self.contact_surface is None:
            return LinearPart(has_modes=True)
        return LinearPart(
            has_modes=True,
            held_force=HeldForce(
                state=with_contact(self._mode), force=self._contact_force
            ),
        )


def mode_vector(state: Array) -> Array:
    """Returns operator_mode() as a vector."""
    return np.array([operator_mode(state)])


def past_surface(
    state: Array, felt_position: Array, point: Array, normal: Array
) -> Array:
    """Returns the depth in m at which contact is perceived (1).

    It is negative after contact has been perceived.
    """
    if operator_mode(state) != 0:
        return np.full(1, -1.0)
    return np.array([np.sum((felt_position - point) * normal)])


def with_contact(state: Array) -> Array:
    """Returns the state after contact was perceived."""
    return np.concatenate(([1.0], state[1:]))


def with_stop(state: Array) -> Array:
    """Returns the state after the stop."""
    return np.concatenate((state[:1], [1.0], state[2:]))
