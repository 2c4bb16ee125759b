"""Direct force under passivity control in the time domain."""

from typing import Any, ClassVar

import numpy as np

from teleop_drake.loops.framework.validation import (
    CheckNumber,
    Config,
    GainField,
    GainRange,
    Gains,
    Number,
    Range,
    Refuse,
)
from teleop_drake.loops.kernel import Kernel, Name, times
from teleop_drake.loops.kernel.linear_part import IDLE_PASSIVITY, LinearPart
from teleop_drake.model.blocks.architectures.base import (
    Architecture,
    Facts,
    MasterSide,
    SlaveSide,
)
from teleop_drake.model.blocks.architectures.local_damper import (
    BrakedVelocity,
    LocalDamperConfig,
)
from teleop_drake.model.kinds import NumberNames
from teleop_drake.model.laws.passivity import (
    energy_budget,
    injected_resistance,
    passive_effort,
    scaled_energy_rates,
)
from teleop_drake.model.laws.proportional import braked_force

# A budget that a linear model never uses up, in units of the scale or of E_0.
_AMPLE = 1e9


class _Idle:
    """The linear model of a passivity controller that does not act."""

    def ForLinearModel(self, estimates: np.ndarray | None) -> LinearPart:
        """Returns constant energies with an ample budget."""
        num_states = self.num_continuous_states()  # type: ignore[attr-defined]
        energies = np.repeat([0.0, -_AMPLE], num_states // 2)
        return LinearPart(num_states=0, state=energies, assumption=IDLE_PASSIVITY)


class PassivityMaster(_Idle, MasterSide):
    """Feeds back the tool's velocity, changed as far as passivity requires.

        v_m = v_ret + beta F_h,   0 <= beta <= maximum_mobility
        dE_in/dt = max(F_h v_m, 0),   dE_out/dt = max(-F_h v_m, 0)
        W_m = E_in of the slave as received - E_out

    on each axis. Without the controller, the power -F_h v_ret would flow to the
    operator's hand. beta is 0 as long as the budget W_m suffices for this power during
    the next `horizon`. Otherwise, beta reduces the power to W_m / horizon. F_h is sent
    unchanged. The law is `teleop_drake.model.laws.passivity`.

    | port | name             | size | unit        | is                              |
    |------|------------------|------|-------------|---------------------------------|
    | in   | haptic_force     | n    | N           | F_h                             |
    | in   | velocity_command | n    | m/s         | v_d or ignored                  |
    | in   | return_packet    | 3n   | [m; m/s; J] | [p_WT; v; E_in] of PassivitySlave |
    | out  | felt_position    | n    | m           | p_WT as received                |
    | out  | felt_velocity    | n    | m/s         | v_m                             |
    | out  | forward_packet   | 2n, 3n | [N; J; m/s] | [F_h; E_in] or [F_h; E_in; v_d] |
    | out  | master_budget    | n    | J           | W_m                             |
    | out  | master_power     | n    | W           | F_h v_m, into the channel       |
    | out  | injected_mobility | n   | m/(N s)     | beta                            |

    | parameter | name             | unit    |
    |-----------|------------------|---------|
    | 0         | maximum_mobility | m/(N s) |

    State (continuous): [E_in (n), E_out (n)] in units of `initial_energy`, because the
    solver's tolerance is absolute.

    Initial value: 0.

    Direct feedthrough: haptic_force to felt_velocity, forward_packet and master_power;
    return_packet to all but forward_packet.

    The maximum of beta keeps the loop through the operator from becoming infinitely
    fast. At the maximum, more energy than the budget may flow out. The budget is then
    negative, and incoming energy first makes up for the deficit.

    The law requires neither the delay nor a model. Because E_in only grows, it is
    conservative with a channel that loses, holds or reorders packets, but not with one
    that extrapolates.

    Args:
        config: The config without nulls, as returned by Resolve(). Its initial_energy
            is the unit of the state.
    """

    numeric_parameters: ClassVar = {
        "maximum_mobility": Range("m/(N s)", above=0),
    }

    def __init__(self, config: "TimeDomainPassivityConfig", *, num_axes: int):
        names = ("horizon", "maximum_mobility", "initial_energy")
        n = num_axes
        # The tool's velocity v_ret. `stored` is E_in in J, `reaction` is -F_h.
        v: Name = ("return_packet", n, 2 * n)
        MasterSide.__init__(
            self,
            "passivity_master",
            Kernel(
                parameters={
                    **_Positive(config, *names), "no_energy": 0.0, "minus": -1.0
                },
                rate=(scaled_energy_rates, "master_power", "initial_energy"),
                outputs={
                    "felt_position": ("return_packet", 0, n),
                    "reaction": (times, "haptic_force", "minus"),
                    "felt_velocity": (
                        passive_effort, v, "injected_mobility", "reaction"
                    ),
                    "stored": (times, ("state", 0, n), "initial_energy"),
                    "forward_packet": [
                        "haptic_force", "stored", *config.Sent("velocity_command")
                    ],
                    "master_budget": (
                        energy_budget, "no_energy", ("return_packet", 2 * n, 3 * n),
                        ("state", n, 2 * n), "initial_energy",
                    ),
                    "master_power": (times, "haptic_force", "felt_velocity"),
                    "injected_mobility": (
                        injected_resistance, v, "reaction", "master_budget",
                        "horizon", "maximum_mobility",
                    ),
                },
                sizes={"stored": n, "reaction": n},
            ),
            n,
            forward_packet=n * config.num_sent,
            return_packet=3 * n,
            state=[0.0] * (2 * n),
        )  # fmt: skip


def _Positive(config: "TimeDomainPassivityConfig", *names: str) -> dict[str, float]:
    """Returns fields by name; refuses values that are null or not > 0."""
    numbers = {name: getattr(config, name) for name in names}
    for name, value in numbers.items():
        for x in value if isinstance(value, np.ndarray) else [value]:
            CheckNumber(name, x, above=0)
    return numbers


def _Extreme(matrix: np.ndarray, which: int) -> Any:
    """Returns an eigenvalue of a symmetric matrix.

    With six axes, it is that of the translational and of the rotational block, each
    repeated for the three axes (n).

    Args:
        matrix: The matrix (n, n).
        which: Index of the eigenvalue in ascending order.
    """
    if len(matrix) < 6:
        return float(np.linalg.eigvalsh(matrix)[which])
    halves = matrix[:3, :3], matrix[3:, 3:]
    return np.repeat([np.linalg.eigvalsh(half)[which] for half in halves], 3)


class PassivitySlave(_Idle, SlaveSide):
    """Applies the haptic force that arrives, changed as far as passivity requires.

        F = F_hd - alpha v,   0 <= alpha <= maximum_damping
        dE_out/dt = max(F v, 0),   dE_in/dt = max(-F v, 0)
        F_c = F - B v
        W_s = E_0 + E_in of the master as received - E_out

    on each axis. Without the controller, the power F_hd v would flow to the tool. alpha
    is 0 as long as the budget W_s suffices for this power during the next `horizon`.
    Otherwise, the damping alpha reduces the power to W_s / horizon. E_0 allows the tool
    to start: the operator feels the tool at rest for a round trip, and supplies no
    power before. The law is `laws.passivity`. B is a local damper behind
    the port, against the ground or the command (see local_damper); the power that it
    takes is part of F v.

    | port | name              | size | unit        | is                             |
    |------|-------------------|------|-------------|--------------------------------|
    | in   | forward_packet    | 2n, 3n | [N; J; m/s] | that of PassivityMaster      |
    | in   | tool_position     | n    | m           | p_WT                           |
    | in   | tool_velocity     | n    | m/s         | v                              |
    | in   | environment_force | n    | N           | ignored                        |
    | out  | control_force     | n    | N           | F_c                            |
    | out  | return_packet     | 3n   | [m; m/s; J] | [p_WT; v; E_in]                |
    | out  | slave_budget      | n    | J           | W_s                            |
    | out  | slave_power       | n    | W           | F v, out of the channel        |
    | out  | injected_damping  | n    | N s/m       | alpha                          |

    | parameter | name            | unit  |
    |-----------|-----------------|-------|
    | 0         | maximum_damping | N s/m |
    | 1         | local_damping   | N s/m |

    State (continuous): [E_in (n), E_out (n)] in units of E_0, because the solver's
    tolerance is absolute.

    Initial value: 0, so that W_s = E_0.

    Direct feedthrough: forward_packet and tool_velocity to all but return_packet;
    tool_position and tool_velocity to return_packet.

    The maximum of alpha keeps the tool from stopping infinitely fast. At the maximum,
    more energy than the budget may flow out. The budget is then negative, and incoming
    energy first makes up for the deficit.

    Energy that flows back from the tool is limited at the master, not here. When the
    budget is used up, the tool gets no power until the operator has moved against a
    force.

    Args:
        config: The config without nulls, as returned by Resolve().
    """

    numeric_parameters: ClassVar = {
        "maximum_damping": Range("N s/m", above=0),
        "local_damping": GainRange("N s/m", may_be_zero=True),
    }

    def __init__(self, config: "TimeDomainPassivityConfig", *, num_axes: int):
        n = num_axes
        names = ("horizon", "maximum_damping", "initial_energy")
        # The force F_hd. `stored` is E_in in J, and `passive_force` is F.
        F: Name = ("forward_packet", 0, n)
        SlaveSide.__init__(
            self,
            "passivity_slave",
            Kernel(
                parameters={
                    **_Positive(config, *names),
                    "minus": -1.0,
                    "local_damping": config.Gain("local_damping", n),
                },
                rate=(scaled_energy_rates, "incoming_power", "initial_energy"),
                outputs={
                    "passive_force": (
                        passive_effort, F, "injected_damping", "tool_velocity"
                    ),
                    "control_force": (
                        braked_force, "passive_force", "braked_velocity",
                        "local_damping",
                    ),
                    "braked_velocity": BrakedVelocity(
                        config.against, "tool_velocity",
                        ("forward_packet", 2 * n, 3 * n),
                    ),
                    "stored": (times, ("state", 0, n), "initial_energy"),
                    "return_packet": ["tool_position", "tool_velocity", "stored"],
                    "slave_budget": (
                        energy_budget, "initial_energy", ("forward_packet", n, 2 * n),
                        ("state", n, 2 * n), "initial_energy",
                    ),
                    "slave_power": (times, "passive_force", "tool_velocity"),
                    "incoming_power": (times, "slave_power", "minus"),
                    "injected_damping": (
                        injected_resistance, F, "tool_velocity", "slave_budget",
                        "horizon", "maximum_damping",
                    ),
                },
                sizes=dict.fromkeys(
                    ("passive_force", "stored", "incoming_power", "braked_velocity"), n
                ),
            ),
            n,
            forward_packet=n * config.num_sent,
            return_packet=3 * n,
            state=[0.0] * (2 * n),
        )  # fmt: skip


@Config
class TimeDomainPassivityConfig(LocalDamperConfig):
    """Direct force under passivity control; see architectures.time_domain_passivity."""

    kind = "time_domain_passivity"
    forward_parts = ("F_h", "E_in")
    return_parts = ("p_WT", "v_WT", "E_in")

    # With six axes each null below is derived for translation and for rotation.
    #
    # Time for which the budget must suffice at the present power, s, > 0. It
    # corresponds to the sample period of the customary controllers, 1 ms. A shorter
    # horizon is more exactly passive and takes longer to simulate. Assumed.
    horizon: float = Number(0.01, "s", above=0)
    # Largest damping at the tool, N s/m, > 0. Null: m / horizon, with the smallest
    # apparent mass m at the start pose, so that it stops the tool with a time constant
    # of at least a horizon.
    maximum_damping: float | None = Number(None, "N s/m", above=0)
    # Largest mobility at the hand, m/(N s), > 0. Null: 1 / (h horizon), with the limit
    # h of s H(s) for s to infinity, so that the haptic force falls with a time constant
    # of at least a horizon.
    maximum_mobility: float | None = Number(None, "m/(N s)", above=0)
    # E_0, energy that the tool may receive on each axis before the operator has
    # supplied any, J, > 0. Null: the energy that brings the tool to the commanded speed
    # v_d and keeps it there for a round trip T, m |v_d|^2 / 2 + d |v_d|^2 T, with the
    # largest apparent mass m and the largest damping d of robot, environment and local
    # damper at the start pose.
    initial_energy: float | None = Number(None, "J", above=0)
    # Local damper at the tool, N s/m, >= 0; see DampedForce. The customary scheme has
    # none.
    local_damping: Gains = GainField(0.0, may_be_zero=True)

    def Sent(self, command: str) -> list[str]:
        """Returns a name of the command if the forward packet has it."""
        return [command] if self.follows_command else []

    @property
    def num_sent(self) -> int:
        """Number of vectors (n each) in a forward packet."""
        return 2 + len(self.Sent("v_d"))

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        return {
            "maximum_damping": ("controller.maximum_damping",),
            "maximum_mobility": ("master.maximum_mobility",),
            "local_damping": ("controller.local_damping",),
        }

    def DeriveDefaults(self, facts: Facts) -> None:
        """Derives the fields that are null; see ArchitectureConfig.DeriveDefaults."""
        if self.maximum_damping is None:
            inertia = facts.Told("inertia", "maximum_damping")
            self.maximum_damping = _Extreme(inertia, 0) / self.horizon
        if self.maximum_mobility is None:
            h: Any = facts.DeviceGain()
            if not h > 0:
                Refuse(
                    "maximum_mobility",
                    None,
                    "a number, because none derives from haptic_device with s H(s) -> "
                    f"{h:g}",
                )
            # About an axis the device is lever^2 H(s).
            if facts.num_axes == 6:
                h = h * np.repeat([1.0, facts.haptic_device.lever**2], 3)
            self.maximum_mobility = 1 / (h * self.horizon)
        if self.initial_energy is None:
            mass = _Extreme(facts.Told("inertia", "initial_energy"), -1)
            damping = facts.StartDamping("initial_energy") + self.local_damping
            drag = _Extreme(damping, -1)
            speed_squared = facts.velocity @ facts.velocity
            self.initial_energy = (mass / 2 + drag * facts.round_trip) * speed_squared

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides."""
        config = self.Resolve(facts, path)
        n = facts.num_axes
        facts.CheckStrictlyProper(self.kind)
        return Architecture(
            master_side=PassivityMaster(config, num_axes=n),
            slave_side=PassivitySlave(config, num_axes=n),
            initial_forward_packet=[0.0] * (n * config.num_sent),
            initial_return_packet=[*facts.start.tolist(), *[0.0] * (2 * n)],
            forward_fields=("force", "energy", *config.Sent("velocity")),
            return_fields=("position", "velocity", "energy"),
        )
