"""The surgeon: commands a velocity, then a force, then a stop."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    Event,
    EventStatus,
    LeafSystem,
    State,
    UnrestrictedUpdateEvent,
    WitnessFunction,
    WitnessFunctionDirection,
)

from teleop_drake.callbacks import Weakly
from teleop_drake.environments.surface import Surface
from teleop_drake.kernel import Kernel, Transition
from teleop_drake.laws.operator import force_command, operator_mode, velocity_command

Array = NDArray[np.float64]

# Longer than any simulation: an event with this period happens once.
_ONCE = 1e12


class Surgeon(LeafSystem):
    """Commands a velocity until contact is felt, then a constant force (section 2.5).

        mode 0, velocity: v_d = velocity, F_h = force of the haptic device
        mode 1, force:    v_d = 0,        F_h = contact_force
        mode 2, stopped:  v_d = 0,        F_h = 0 if the mode was 1, otherwise the
                                          haptic device brakes the tool

    Contact is perceived, once and for all, when the RETURNED tool position reaches
    `contact_surface`; that is a return delay after the tool touched it.

    | port | name             | size | unit                     |
    |------|------------------|------|--------------------------|
    | in   | haptic_force     | n    | N                        |
    | in   | felt_position    | n    | m, from the return channel |
    | out  | velocity_command | n    | m/s                      |
    | out  | force_command    | n    | N                        |
    | out  | mode             | 1    | 0, 1 or 2                |

    State (discrete, 2): [contact perceived, stopped], each 0 or 1. A returned
    position that moves continuously is watched by a witness function if the Context
    has an accuracy (context.SetAccuracy); one that jumps, as behind a sampled
    channel, is checked at the end of every step, which is the instant of the jump
    if an unrestricted update made it.

    Initial value: velocity mode.

    Direct feedthrough: haptic_force to force_command; nothing else.

    It does not react to forces, get tired, or let go when the tool bounces off.

    Args:
        velocity: v_d in m/s (n).
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
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
    ):
        LeafSystem.__init__(self)
        self._velocity = np.array(velocity, dtype=float)
        n = self._velocity.size
        if self._velocity.ndim != 1 or not np.all(np.isfinite(self._velocity)):
            raise ValueError(f"velocity: {velocity!r}; allowed: finite numbers (m/s)")
        self._contact_force = np.zeros(n)
        if contact_force is not None:
            self._contact_force = np.array(contact_force, dtype=float)
            if self._contact_force.shape != (n,) or not np.all(
                np.isfinite(self._contact_force)
            ):
                raise ValueError(
                    f"contact_force: {contact_force!r}; allowed: {n} finite numbers (N)"
                )
        if contact_surface is not None and (
            contact_surface.point_W.shape != (n,)
            or not np.all(np.isfinite(contact_surface.point_W))
        ):
            raise ValueError(
                f"contact_surface: at {contact_surface.point_W}; allowed: a surface "
                f"at {n} finite numbers (m)"
            )
        if stop_time is not None and not (math.isfinite(stop_time) and stop_time >= 0):
            raise ValueError(
                f"stop_time: {stop_time}; allowed: a finite number >= 0 (s)"
            )
        self._surface = None if contact_force is None else contact_surface
        self._jump_times = [] if stop_time is None else [stop_time]
        self._stop_time = stop_time
        self._haptic_force = self.DeclareVectorInputPort("haptic_force", n)
        self._p = self.DeclareVectorInputPort("felt_position", n)
        self._mode = self.DeclareDiscreteState(2)
        self.DeclareVectorOutputPort(
            "velocity_command",
            n,
            self._CalcVelocityCommand,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclareVectorOutputPort(
            "force_command",
            n,
            self._CalcForceCommand,
            prerequisites_of_calc={self.xd_ticket(), self._haptic_force.ticket()},
        )
        self.DeclareVectorOutputPort(
            "mode", 1, self._CalcMode, prerequisites_of_calc={self.xd_ticket()}
        )
        if stop_time is not None:
            self.DeclarePeriodicUnrestrictedUpdateEvent(_ONCE, stop_time, self._Stop)
        self._witnesses = []
        if self._surface is not None:
            self.DeclarePerStepDiscreteUpdateEvent(self._CheckContact)
            self._witnesses.append(
                self.MakeWitnessFunction(
                    "perceives_contact",
                    WitnessFunctionDirection.kNegativeThenNonNegative,
                    Weakly(self._CalcPastSurface),
                    UnrestrictedUpdateEvent(Weakly(self._PerceiveContact)),
                )
            )

    @property
    def contact_surface(self) -> Surface | None:
        """Where the surgeon perceives contact; None: nowhere."""
        return self._surface

    @property
    def jump_times(self) -> list[float]:
        """When the outputs jump in any case, s."""
        return self._jump_times

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        transitions = {}
        parameters = {
            "velocity": self._velocity,
            "contact_force": self._contact_force,
        }
        if self._surface is not None:
            parameters["point"] = self._surface.point_W
            parameters["normal"] = self._surface.normal_W
            transitions["perceives_contact"] = Transition(
                guard=(past_surface, "mode", "felt_position", "point", "normal"),
                mode=(with_contact, "mode"),
            )
        if self._stop_time is not None:
            transitions["stops"] = Transition(
                mode=(with_stop, "mode"), offset=self._stop_time
            )
        return Kernel(
            parameters=parameters,
            outputs={
                "velocity_command": (velocity_command, "mode", "velocity"),
                "force_command": (
                    force_command, "mode", "haptic_force", "contact_force"
                ),
                "mode": (mode_vector, "mode"),
            },
            transitions=transitions,
            unused=("felt_position",),
        )  # fmt: skip

    def _GetState(self, context: Context) -> np.ndarray:
        """Returns [contact perceived, stopped]."""
        state: np.ndarray = context.get_discrete_state_vector().CopyToVector()
        return state

    def _AwaitsContact(self, context: Context) -> bool:
        return operator_mode(self._GetState(context)) == 0

    def _CalcVelocityCommand(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(velocity_command(self._GetState(context), self._velocity))

    def _CalcForceCommand(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            force_command(
                self._GetState(context),
                self._haptic_force.Eval(context),
                self._contact_force,
            )
        )

    def _CalcMode(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, operator_mode(self._GetState(context)))

    def DoGetWitnessFunctions(self, context: Context) -> list[WitnessFunction]:
        """Returns the contact witness while contact is awaited and can be located."""
        is_located = context.get_accuracy() and self._AwaitsContact(context)
        return self._witnesses if is_located else []

    def _CalcPastSurface(self, context: Context) -> float:
        if self._surface is None:
            return -math.inf
        return float(self._surface.Depth(self._p.Eval(context)))

    def _PerceiveContact(self, context: Context, event: Event, state: State) -> None:
        state.get_mutable_discrete_state(self._mode).SetAtIndex(0, 1.0)

    def _CheckContact(self, context: Context, values: DiscreteValues) -> EventStatus:
        if not self._AwaitsContact(context) or self._CalcPastSurface(context) < 0:
            return EventStatus.DidNothing()
        values.get_mutable_vector(self._mode).SetAtIndex(0, 1.0)
        return EventStatus.Succeeded()

    def _Stop(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._mode).SetAtIndex(1, 1.0)


def mode_vector(state: Array) -> Array:
    """Returns operator_mode() as a vector."""
    return np.array([operator_mode(state)])


def past_surface(
    state: Array, felt_position: Array, point: Array, normal: Array
) -> Array:
    """Returns how far behind the surface the tool is felt, m; negative once known."""
    if operator_mode(state) != 0:
        return np.full(1, -1.0)
    return np.array([np.sum((felt_position - point) * normal)])


def with_contact(state: Array) -> Array:
    """Returns the state after contact was perceived."""
    return np.array([1.0, state[1]])


def with_stop(state: Array) -> Array:
    """Returns the state after the stop."""
    return np.array([state[0], 1.0])
