"""P+d: position-position control with a spring and damping injection."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector

from teleop_drake.architectures.base import Architecture, ArchitectureConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.kernel import Kernel, KernelBlock
from teleop_drake.laws.proportional import coupling_force, master_rate, slave_force
from teleop_drake.validation import CheckGain, GainField, GainMatrix, Number, Refuse


class ProportionalMaster(KernelBlock):
    """A handle with mass, tied to where the tool was by a spring and braked.

        M dv_m/dt = F_h - K (x_m - x_s) - B v_m,   dx_m/dt = v_m

    with x_s = p_WT(t - T_r). With the slave F_c = K (x_m(t - T_f) - p_WT) - B_s v
    (ProportionalSlave) the pair is stable for 4 B B_s > (T_f + T_r)^2 K^2.

    Sources: D. Lee and M. W. Spong, "Passive bilateral teleoperation with constant time
    delay", IEEE Trans. Robotics 22 (2006); E. Nuno, L. Basanez and R. Ortega,
    "Passivity-based control for bilateral teleoperation: a tutorial", Automatica 47
    (2011), where this is P+d.

    | port | name             | size | unit | is                    |
    |------|------------------|------|------|-----------------------|
    | in   | haptic_force     | n    | N    | F_h                   |
    | in   | velocity_command | n    | m/s  | ignored               |
    | in   | return_packet    | n    | m    | x_s                   |
    | out  | felt_position    | n    | m    | x_s                   |
    | out  | felt_velocity    | n    | m/s  | v_m                   |
    | out  | forward_packet   | n    | m    | x_m                   |
    | out  | coupling_force   | n    | N    | K (x_m - x_s)         |

    State (continuous): [x_m (n), v_m (n)].

    Initial value: x_m = start, v_m = 0.

    Direct feedthrough: return_packet to felt_position and coupling_force.

    It compensates neither the mass nor the damping: the operator feels both.

    Args:
        mass: M in kg (n, n), symmetric positive definite.
        stiffness: K in N/m (n, n), symmetric, not negative.
        damping: B in N s/m (n, n), symmetric, not negative.
        start: x_m at time 0 in m (n).

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        *,
        mass: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        start: ArrayLike,
    ):
        KernelBlock.__init__(self)
        self.set_name("proportional_master")
        start = np.array(start, dtype=float)
        if start.ndim != 1 or not np.all(np.isfinite(start)):
            Refuse("start", start, "finite numbers (m)")
        n = self._n = start.size
        self._M = CheckGain("mass", mass, n)
        self._K = CheckGain("stiffness", stiffness, n, may_be_zero=True)
        self._B = CheckGain("damping", damping, n, may_be_zero=True)
        for name in ("haptic_force", "velocity_command", "return_packet"):
            self.DeclareVectorInputPort(name, n)
        self.DeclareContinuousState(
            BasicVector(np.concatenate([start, np.zeros(n)])), n, n, 0
        )
        self.DeclareOutputs(
            felt_position=n, felt_velocity=n, forward_packet=n, coupling_force=n
        )

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        n = self._n
        return Kernel(
            parameters={"mass": self._M, "stiffness": self._K, "damping": self._B},
            rate=(
                master_rate, "state", "haptic_force", "return_packet", "mass",
                "stiffness", "damping",
            ),
            outputs={
                "felt_position": "return_packet",
                "felt_velocity": ("state", n, 2 * n),
                "forward_packet": ("state", 0, n),
                "coupling_force": (
                    coupling_force, ("state", 0, n), "return_packet", "stiffness"
                ),
            },
            unused=("velocity_command",),
        )  # fmt: skip


class ProportionalSlave(KernelBlock):
    """Ties the tool to where the master was by a spring, and brakes it.

        F_c = K (x_m - p_WT) - B v

    with x_m(t - T_f) as it arrives. See ProportionalMaster for the other end, for the
    sources and for when the two are stable.

    | port | name              | size | unit | is      |
    |------|-------------------|------|------|---------|
    | in   | forward_packet    | n    | m    | x_m     |
    | in   | tool_position     | n    | m    | p_WT    |
    | in   | tool_velocity     | n    | m/s  | v       |
    | in   | environment_force | n    | N    | ignored |
    | out  | control_force     | n    | N    | F_c     |
    | out  | return_packet     | n    | m    | p_WT    |

    State: none.

    Direct feedthrough: all inputs but environment_force to control_force; tool_position
    to return_packet.

    It has no integral action: a force that lasts leaves a position error.

    Args:
        stiffness: K in N/m (n, n), symmetric, not negative.
        damping: B in N s/m (n, n), symmetric, not negative.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(self, *, stiffness: ArrayLike, damping: ArrayLike):
        KernelBlock.__init__(self)
        self.set_name("proportional_slave")
        n = np.atleast_2d(stiffness).shape[0]
        self._K = CheckGain("stiffness", stiffness, n, may_be_zero=True)
        self._B = CheckGain("damping", damping, n, may_be_zero=True)
        for name in (
            "forward_packet",
            "tool_position",
            "tool_velocity",
            "environment_force",
        ):
            self.DeclareVectorInputPort(name, n)
        self.DeclareOutputs(control_force=n, return_packet=n)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        return Kernel(
            parameters={"stiffness": self._K, "damping": self._B},
            outputs={
                "control_force": (
                    slave_force, "forward_packet", "tool_position", "tool_velocity",
                    "stiffness", "damping",
                ),
                "return_packet": "tool_position",
            },
            unused=("environment_force",),
        )  # fmt: skip


Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ProportionalDamping:
    """Every number; see ProportionalDampingConfig for what they are."""

    master_mass: Array
    master_damping: Array
    slave_damping: Array
    stiffness: Array


@dataclass(kw_only=True, eq=False)
class ProportionalDampingConfig(ArchitectureConfig):
    """P+d; see architectures.proportional_damping.ProportionalMaster."""

    kind = "proportional_damping"
    forward_parts = ("x_m",)
    return_parts = ("p_WT",)

    # Mass of the handle, kg, > 0. Assumed: that of the slider (thesis eq. 2.12).
    master_mass: np.ndarray | float = GainField(0.5)
    # B_m, damping of the handle, N s/m, >= 0. Null: the resistance of the haptic device
    # at low frequency, so that the operator feels no more of it than of his own.
    master_damping: np.ndarray | float | None = GainField(None, may_be_zero=True)
    # B_s, damping of the tool, N s/m, >= 0. Null: as B_m.
    slave_damping: np.ndarray | float | None = GainField(None, may_be_zero=True)
    # By how much the dampings exceed what stability needs, > 1, for the null below:
    # 4 B_m B_s = margin (T_f + T_r)^2 K^2. Assumed.
    margin: float = Number(2.0, above=1)
    # K, N/m, >= 0. Null: from the margin and the nominal delays, with the smallest
    # dampings, but at most what makes the handle as fast as the fastest pole p of the
    # haptic device, K = M |p|^2.
    stiffness: np.ndarray | float | None = GainField(None, may_be_zero=True)

    @property
    def has_gains_of_delay(self) -> bool:
        """Whether the stiffness derives from the nominal delays."""
        return self.stiffness is None

    def Resolve(self, facts: Facts, path: str) -> ProportionalDamping:
        """Returns the parameters with every default derived.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        n, B_m = facts.num_axes, self.master_damping
        if B_m is None:
            B_m = facts.OperatorResistance(f"{path}.master_damping")
        B_m = GainMatrix(B_m, n)
        B_s = B_m if self.slave_damping is None else GainMatrix(self.slave_damping, n)
        mass = GainMatrix(self.master_mass, n)
        stiffness = self.stiffness
        if stiffness is None:
            least = np.linalg.eigvalsh(B_m)[0] * np.linalg.eigvalsh(B_s)[0]
            stiffness = float(np.linalg.eigvalsh(mass)[0]) * facts.DevicePole() ** 2
            T = facts.round_trip
            if T > 0:
                stiffness = min(stiffness, math.sqrt(4 * least / self.margin) / T)
            if not stiffness > 0:
                Refuse(
                    f"{path}.stiffness",
                    None,
                    "a number, because the dampings or the poles of haptic_device "
                    "are 0",
                )
        return ProportionalDamping(
            master_mass=mass,
            master_damping=B_m,
            slave_damping=B_s,
            stiffness=GainMatrix(stiffness, n),
        )

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        numbers = self.Resolve(facts, path)
        start: list[float] = facts.start.tolist()
        return Architecture(
            master_side=ProportionalMaster(
                mass=numbers.master_mass,
                stiffness=numbers.stiffness,
                damping=numbers.master_damping,
                start=start,
            ),
            slave_side=ProportionalSlave(
                stiffness=numbers.stiffness, damping=numbers.slave_damping
            ),
            initial_forward_packet=start,
            initial_return_packet=start,
        )
