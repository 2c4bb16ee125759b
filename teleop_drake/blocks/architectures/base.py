"""Base of the control architectures, and the facts that their defaults derive from.

An architecture is a pair: a master side, which stands between the operator and the
channels, and a slave side, which is the station at the robot. They speak in packets,
which is all that the channels carry. What a packet holds is the architecture's own
affair; those of the thesis are

    forward packet [F_h; v_d] (2n)      return packet [p_WT; v_WT] (2n)
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import Demultiplexer, Multiplexer

from teleop_drake.arrays import Array, ArrayLike, Names
from teleop_drake.blocks.channels import ChannelConfig
from teleop_drake.blocks.systems.haptic_device import HapticDeviceConfig
from teleop_drake.kernel import FixedBlock, Kernel
from teleop_drake.kinds import KindConfig
from teleop_drake.numerics.transfer_function import (
    low_frequency_resistance,
    realize_transfer_function,
)
from teleop_drake.validation import Config, Refuse, ScenarioError, Within
from teleop_drake.wiring import OutputNames, Wire


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What the defaults of an architecture derive from.

    Robot and environment tell their part themselves, so that it holds for those of a
    user's own as well. What they cannot tell is None, and a default that would derive
    from it is refused.

    Attributes:
        start: p_WT at time 0 in m (n).
        velocity: v_d, what the operator commands at first, in m/s (n).
        haptic_device: The device in the operator's hand.
        forward_channel: The channel from master to slave.
        return_channel: The channel back.
        duration: How long the simulation lasts, in s.
        inertia: M_r of the robot at its start pose (2.8) in kg (n, n), or None.
        robot_damping: Of the robot itself at its start pose in N s/m (n, n), or None.
        environment_stiffness: Of the environment at the start in N/m (n, n), or None.
        environment_damping: D_e at the start in N s/m (n, n), or None.
    """

    start: Array
    velocity: Array
    haptic_device: HapticDeviceConfig
    forward_channel: ChannelConfig
    return_channel: ChannelConfig
    duration: float
    inertia: Array | None
    robot_damping: Array | None
    environment_stiffness: Array | None
    environment_damping: Array | None

    @property
    def num_axes(self) -> int:
        """Number n of task axes."""
        return self.start.size

    @property
    def round_trip(self) -> float:
        """The nominal round trip T_f + T_r in s."""
        return self.forward_channel.delay + self.return_channel.delay

    @property
    def has_no_delay(self) -> bool:
        """Whether both channels pass their signals straight through."""
        return (
            self.forward_channel.IsPassThrough() and self.return_channel.IsPassThrough()
        )

    def Told(self, fact: str, path: str) -> Array:
        """Returns a fact from which the default of a field derives.

        Args:
            fact: inertia, robot_damping, environment_stiffness or environment_damping.
            path: The field, for the message.

        Raises:
            ScenarioError: If robot or environment does not tell it.
        """
        value = getattr(self, fact)
        if value is None:
            owner, _, what = fact.rpartition("_")
            owner = owner or "robot"
            Refuse(path, None, f"given, because the {owner} does not tell its {what}")
        return np.array(value)

    def StartDamping(self, path: str) -> Array:
        """Returns the damping of robot and environment at the start in N s/m (n, n)."""
        robot = self.Told("robot_damping", path)
        return robot + self.Told("environment_damping", path)

    def OperatorResistance(self, path: str) -> float:
        """Returns b of H = K/s + b + O(s) in N s/m; refuses one that is not > 0."""
        return self._AtLowFrequency(path, [], "resistance", "N s/m")

    def OperatorStiffness(self, path: str) -> float:
        """Returns K of H = K/s + b + O(s) in N/m; refuses one that is not > 0."""
        return self._AtLowFrequency(path, [0.0], "stiffness", "N/m")

    def _AtLowFrequency(
        self, path: str, factor: list[float], name: str, unit: str
    ) -> float:
        """Returns the resistance of H, or of s H."""
        if self.num_axes == 6:
            Refuse(path, None, "given, because six axes have no one default")
        device = self.haptic_device
        value = low_frequency_resistance(
            [*device.numerator, *factor], device.denominator
        )
        if not value > 0:
            Refuse(
                path,
                None,
                "a number, because none derives from haptic_device, whose "
                f"{name} at low frequency is {value:g} {unit}",
            )
        return value

    def DeviceGain(self) -> float:
        """Returns h = s H(s) for s to infinity, in N/m."""
        device = self.haptic_device
        _, B, C, _ = realize_transfer_function(device.numerator, device.denominator)
        return float((C @ B).sum())

    def DevicePole(self) -> float:
        """Returns the magnitude of the fastest pole of the haptic device in rad/s."""
        poles = np.roots(np.asarray(self.haptic_device.denominator, dtype=float))
        return float(np.abs(poles).max(initial=0.0))

    def CheckStrictlyProper(self, kind: str) -> None:
        """Refuses a device whose force answers at once to the velocity it feels."""
        device = self.haptic_device
        numerator = np.trim_zeros(np.asarray(device.numerator, dtype=float), "f")
        if len(numerator) >= len(device.denominator):
            raise ScenarioError(
                f"haptic_device.numerator = {numerator.tolist()}: must be of lower "
                f"degree than the denominator for {kind}, in which the velocity that "
                "is felt depends on the force"
            )


LAW_INPUTS = (
    "haptic_force",
    "velocity_command",
    "tool_position",
    "tool_velocity",
    "environment_force",
)
"""The inputs of every control law, n wide each."""


class _Part(FixedBlock):
    """A part of an architecture that is a kernel.

    Args:
        n: Number of task axes, and width of the ports.
        state: The continuous state at first.
        widths: Width of each port that has another one.
    """

    inputs: Names = ()

    def __init__(
        self, name: str, kernel: Kernel, n: int, *, state: ArrayLike = (), **widths: int
    ):
        outputs = [name for name in kernel.outputs if name not in kernel.sizes]
        FixedBlock.__init__(
            self,
            name,
            kernel,
            inputs={name: widths.get(name, n) for name in self.inputs},
            outputs={name: widths.get(name, n) for name in outputs},
            state=state,
        )


class LawBlock(_Part):
    """A control law that is a kernel; see MakeSlaveStation."""

    inputs = LAW_INPUTS


class MasterSide(_Part):
    """A master side that is a kernel; see Architecture."""

    inputs = ("haptic_force", "velocity_command", "return_packet")


class SlaveSide(_Part):
    """A slave side that is a kernel; see Architecture."""

    inputs = ("forward_packet", *LAW_INPUTS[2:])


def CheckStart(start: ArrayLike) -> Array:
    """Returns a position as a vector, or refuses it."""
    vector = np.array(start, dtype=float)
    if vector.ndim != 1 or not np.all(np.isfinite(vector)):
        Refuse("start", start, "finite numbers (m)")
    return vector


@dataclass(kw_only=True)
class Architecture:
    """A master side and a slave side which understand each other's packets.

    The widths of the packets, m_f forward and m_r back, are those of the ports.

    Attributes:
        master_side: In haptic_force (n, N), velocity_command (n, m/s) and
            return_packet (m_r); out felt_position (n, m), felt_velocity (n, m/s) and
            forward_packet (m_f). The operator perceives contact when felt_position
            reaches the surface. None: the thesis's; see stations.MakeMasterStation.
        slave_side: In forward_packet (m_f), tool_position (n, m), tool_velocity
            (n, m/s) and environment_force (n, N); out control_force (n, N) and
            return_packet (m_r). Outputs beyond these, of either side, are recorded
            under their names.
        initial_forward_packet: What the slave side receives at first (m_f).
        initial_return_packet: What the master side receives at first (m_r).
    """

    master_side: System | None = None
    slave_side: System
    initial_forward_packet: Sequence[float]
    initial_return_packet: Sequence[float]


@Config
class ArchitectureConfig(KindConfig, ABC):
    """A control architecture as plain data.

    A null stands for a default that derives from the rest of the loop by the rule in
    the field's comment; Resolve() applies it. An architecture of your own derives from
    this class and can be named in a scenario: `kind: my_module:MyArchitecture`, its
    fields in the mapping `parameters`.

    Attributes:
        forward_parts: Names of the vectors (n each) in a forward packet, for tables;
            empty: they are numbered.
        return_parts: Names of the vectors (n each) in a return packet.
        derives_from_channels: Whether MakeArchitecture() reads the channels, or the
            duration, of its facts.
    """

    forward_parts: ClassVar[Names] = ()
    return_parts: ClassVar[Names] = ()
    derives_from_channels: ClassVar[bool] = True

    @property
    def has_gains_of_delay(self) -> bool:
        """Whether a default gain derives from the nominal delays."""
        return False

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field for itself; here those of GainField() and of Number().

        Args:
            path: The config's place in a scenario, for messages.
        """
        self.CheckGains(path, num_axes)
        self.CheckNumbers(path)

    def Resolve(self, facts: Facts, path: str) -> Any:
        """Returns the config with every default derived.

        Gains are matrices then, and no null is left that stands for a default. What
        cannot be derived is refused.
        """
        config = replace(self)
        config.MakeMatrices(facts.num_axes)
        with Within(path):
            config.DeriveDefaults(facts)
        config.MakeMatrices(facts.num_axes)
        return config

    def DeriveDefaults(self, facts: Facts) -> None:
        """Replaces each null that stands for a default; here nothing derives.

        Gains that are given are matrices; a derived one may be a number.
        """

    @abstractmethod
    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides, or refuses a parameter that this loop does not allow."""


@Config
class ControlLawConfig(ArchitectureConfig):
    """An architecture with the thesis's packets: all of it is the law at the slave.

    A control law of your own derives from this class.
    """

    forward_parts = ("F_h", "v_d")
    return_parts = ("p_WT", "v_WT")

    @abstractmethod
    def MakeControlLaw(self, facts: Facts, path: str) -> System:
        """Makes the law; see MakeSlaveStation for its ports."""

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes the slave side out of the law; the master side is the thesis's."""
        return MakeLawArchitecture(
            self.MakeControlLaw(facts, path), facts.start.tolist()
        )


def MakeLawArchitecture(control_law: System, start: Sequence[float]) -> Architecture:
    """Makes an architecture with the thesis's packets out of a control law.

    Neither a force nor a command arrives at first, and the tool is felt at rest.

    Args:
        start: p_WT at time 0 in m (n).

    Raises:
        RuntimeError: If the control law lacks a port.
    """
    at_rest = [0.0] * len(start)
    return Architecture(
        slave_side=MakeSlaveStation(control_law),
        initial_forward_packet=[*at_rest, *at_rest],
        initial_return_packet=[*start, *at_rest],
    )


def MakeSlaveStation(control_law: System) -> Diagram:
    """Makes the slave side of the thesis out of a control law, named `controller`.

    | port | name              | size | unit     |
    |------|-------------------|------|----------|
    | in   | forward_packet    | 2n   | [N; m/s] |
    | in   | tool_position     | n    | m        |
    | in   | tool_velocity     | n    | m/s      |
    | in   | environment_force | n    | N        |
    | out  | control_force     | n    | N        |
    | out  | return_packet     | 2n   | [m; m/s] |

    and every further output of the control law (its telemetry), by its own name.

    Args:
        control_law: A system with the inputs haptic_force, velocity_command,
            tool_position, tool_velocity and environment_force and the output
            control_force (n each), such as DirectForce.

    Raises:
        RuntimeError: If the control law lacks one of these ports.
    """
    n = control_law.GetOutputPort("control_force").size()
    telemetry = OutputNames(control_law)
    telemetry.remove("control_force")
    return Wire(
        Diagram(),
        "controller",
        {
            "unpack": Demultiplexer([n, n]),
            "control_law": control_law,
            "pack": Multiplexer([n, n]),
        },
        inputs={
            "forward_packet": ["unpack"],
            "tool_position": ["control_law.tool_position", "pack.u0"],
            "tool_velocity": ["control_law.tool_velocity", "pack.u1"],
            "environment_force": ["control_law.environment_force"],
        },
        connections={
            "control_law.haptic_force": "unpack.y0",
            "control_law.velocity_command": "unpack.y1",
        },
        outputs={
            "control_force": "control_law.control_force",
            "return_packet": "pack",
            **{name: f"control_law.{name}" for name in telemetry},
        },
    )
