"""Bases of the control architectures, and the facts from which their defaults derive.

An architecture is a pair: a master side, which stands between the operator and the
channels, and a slave side, which is the station at the robot. The channels carry
packets between them and nothing else. Each architecture defines the contents of its
packets; those of the thesis are

    forward packet [F_h; v_d] (2n)      return packet [p_WT; v_WT] (2n)
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import Demultiplexer, Multiplexer

from teleop_drake.loops.framework.arrays import Array, ArrayLike, Names
from teleop_drake.loops.framework.validation import (
    Config,
    Refuse,
    ScenarioError,
    Within,
)
from teleop_drake.loops.framework.wiring import OutputNames, Wire
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.model.blocks.systems.haptic_device import HapticDeviceConfig
from teleop_drake.model.channels import ChannelConfig
from teleop_drake.model.kinds import KindConfig
from teleop_drake.model.laws.transfer_function import (
    low_frequency_resistance,
    realize_transfer_function,
)


@dataclass(frozen=True, kw_only=True)
class Facts:
    """The facts about a loop from which the defaults of an architecture derive.

    The facts of robot and environment are computed from their blocks, and so exist for
    user-defined blocks as well. A fact that a block does not provide is None; a default
    that would derive from it is refused.

    Attributes:
        start: p_WT at time 0 in m (n).
        velocity: v_d, the nominal velocity command of the operator, in m/s (n).
        haptic_device: The device in the operator's hand.
        forward_channel: The channel from master to slave.
        return_channel: The channel from slave to master.
        duration: Duration of the simulation, in s.
        inertia: M_r of the robot at its start pose (2.8) in kg (n, n), or None.
        robot_damping: Damping of the robot itself at its start pose in N s/m (n, n), or
            None.
        environment_stiffness: Stiffness of the environment at the start in N/m (n, n),
            or None.
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
        forward = self.forward_channel.NominalDelay(self.duration)
        return forward + self.return_channel.NominalDelay(self.duration)

    @property
    def has_no_delay(self) -> bool:
        """Whether both channels pass their signals through without delay."""
        channels = self.forward_channel, self.return_channel
        return all(x.IsPassThrough() and not x.FieldDelays() for x in channels)

    def Told(self, fact: str, path: str) -> Array:
        """Returns a fact from which the default of a field derives.

        Args:
            fact: inertia, robot_damping, environment_stiffness or environment_damping.
            path: The field, for messages.

        Raises:
            ScenarioError: If the block of robot or environment does not provide it.
        """
        value = getattr(self, fact)
        if value is None:
            owner, _, what = fact.rpartition("_")
            owner = owner or "robot"
            Refuse(path, None, f"given, because the {owner} does not report its {what}")
        return np.array(value)

    def StartDamping(self, path: str) -> Array:
        """Returns the damping of robot and environment at the start in N s/m (n, n)."""
        robot = self.Told("robot_damping", path)
        return robot + self.Told("environment_damping", path)

    def OperatorResistance(self, path: str) -> float:
        """Returns b of H = K/s + b + O(s) in N s/m; refuses a b that is not > 0."""
        return self._AtLowFrequency(path, [], "resistance", "N s/m")

    def OperatorStiffness(self, path: str) -> float:
        """Returns K of H = K/s + b + O(s) in N/m; refuses a K that is not > 0."""
        return self._AtLowFrequency(path, [0.0], "stiffness", "N/m")

    def _AtLowFrequency(
        self, path: str, factor: list[float], name: str, unit: str
    ) -> float:
        """Returns the constant term of H, or of s H, at low frequency.

        Args:
            path: The field with the default, for messages.
            factor: Coefficients appended to the numerator of H: [] for H, [0] for s H.
            name: Name of the constant term in a message.
            unit: Unit of the constant term in a message.
        """
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
        """Returns h, the limit of s H(s) for s to infinity, in N/m."""
        device = self.haptic_device
        _, B, C, _ = realize_transfer_function(device.numerator, device.denominator)
        return float((C @ B).sum())

    def DevicePole(self) -> float:
        """Returns the magnitude of the fastest pole of the haptic device in rad/s."""
        poles = np.roots(np.asarray(self.haptic_device.denominator, dtype=float))
        return float(np.abs(poles).max(initial=0.0))

    def CheckStrictlyProper(self, kind: str) -> None:
        """Refuses a haptic device with direct feedthrough from velocity to force."""
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
"""The inputs of every control law, each of width n."""


class _Part(FixedBlock):
    """A part of an architecture that is defined by a kernel.

    Args:
        name: Name of the block.
        kernel: The kernel; its outputs without an entry in `sizes` are ports.
        n: Number of task axes, and width of the ports.
        state: The initial continuous state.
        widths: Width of each port whose width is not n, by name.
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
    """A control law defined by a kernel; see MakeSlaveStation."""

    inputs = LAW_INPUTS


class MasterSide(_Part):
    """A master side defined by a kernel; see Architecture."""

    inputs = ("haptic_force", "velocity_command", "return_packet")


class SlaveSide(_Part):
    """A slave side defined by a kernel; see Architecture."""

    inputs = ("forward_packet", *LAW_INPUTS[2:])


def CheckStart(start: ArrayLike) -> Array:
    """Returns a position as a vector; refuses one that is not a finite vector."""
    vector = np.array(start, dtype=float)
    if vector.ndim != 1 or not np.all(np.isfinite(vector)):
        Refuse("start", start, "finite numbers (m)")
    return vector


@dataclass(kw_only=True)
class Architecture:
    """A master side and a slave side that exchange packets.

    The widths of the packets, m_f forward and m_r back, are those of the ports. Further
    outputs of either side are recorded under their names.

    Attributes:
        master_side: A system with the inputs haptic_force (n, N), velocity_command
            (n, m/s) and return_packet (m_r), and the outputs felt_position (n, m),
            felt_velocity (n, m/s) and forward_packet (m_f). The operator perceives
            contact when felt_position reaches the surface. None: the master side of
            the thesis; see stations.MakeMasterStation.
        slave_side: A system with the inputs forward_packet (m_f), tool_position (n, m),
            tool_velocity (n, m/s) and environment_force (n, N), and the outputs
            control_force (n, N) and return_packet (m_r).
        initial_forward_packet: The packet that the slave side receives at first (m_f).
        initial_return_packet: The packet that the master side receives at first (m_r).
        forward_fields: The names of the parts of a forward packet, of equal widths;
            empty: they have no names.
        return_fields: The names of the parts of a return packet.
    """

    master_side: System | None = None
    slave_side: System
    initial_forward_packet: Sequence[float]
    initial_return_packet: Sequence[float]
    forward_fields: Names = ()
    return_fields: Names = ()


@Config
class ArchitectureConfig(KindConfig, ABC):
    """The kind and the parameters of a control architecture.

    A null stands for a default that derives from the rest of the loop by the rule in
    the field's comment; Resolve() applies the rule. An architecture of your own derives
    from this class. A scenario selects it by the name of its class,
    `kind: my_module:MyArchitecture`, and has its fields in the mapping `parameters`.

    Attributes:
        forward_parts: Names of the vectors (n each) in a forward packet, for tables;
            empty: the vectors are numbered.
        return_parts: Names of the vectors (n each) in a return packet.
        derives_from_channels: Whether MakeArchitecture() uses the channels or the
            duration in its facts.
    """

    forward_parts: ClassVar[Names] = ()
    return_parts: ClassVar[Names] = ()
    derives_from_channels: ClassVar[bool] = True

    @property
    def has_gains_of_delay(self) -> bool:
        """Whether a default gain derives from the nominal delays."""
        return False

    def Check(self, path: str, num_axes: int) -> None:
        """Checks each field; by default, those declared by GainField() or Number().

        Args:
            path: The field of the config in a scenario, for messages.
        """
        self.CheckGains(path, num_axes)
        self.CheckNumbers(path)

    def Resolve(self, facts: Facts, path: str) -> Any:
        """Returns the config with every default derived.

        Its gains are matrices, and none of its nulls stands for a default. A default
        that cannot be derived is refused.
        """
        config = replace(self)
        config.MakeMatrices(facts.num_axes)
        with Within(path):
            config.DeriveDefaults(facts)
        config.MakeMatrices(facts.num_axes)
        return config

    def DeriveDefaults(self, facts: Facts) -> None:
        """Replaces each null that stands for a default.

        The gains that are given are matrices at this point. A derived gain may be a
        number. This method of the base class derives nothing.
        """

    @abstractmethod
    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides, or refuses a parameter that this loop does not allow."""


@Config
class ControlLawConfig(ArchitectureConfig):
    """An architecture with the packets of the thesis, defined by the law at the slave.

    A control law of your own derives from this class.
    """

    forward_parts = ("F_h", "v_d")
    return_parts = ("p_WT", "v_WT")

    @abstractmethod
    def MakeControlLaw(self, facts: Facts, path: str) -> System:
        """Makes the law; see MakeSlaveStation for its ports."""

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes the slave side from the law; the master side is that of the thesis."""
        return MakeLawArchitecture(
            self.MakeControlLaw(facts, path), facts.start.tolist()
        )


def MakeLawArchitecture(control_law: System, start: Sequence[float]) -> Architecture:
    """Makes an architecture with the packets of the thesis from a control law.

    The initial packets have no force and no velocity, and the position `start`.

    Args:
        control_law: The law; see MakeSlaveStation.
        start: p_WT at time 0 in m (n).

    Raises:
        RuntimeError: If the control law lacks a port.
    """
    at_rest = [0.0] * len(start)
    return Architecture(
        slave_side=MakeSlaveStation(control_law),
        initial_forward_packet=[*at_rest, *at_rest],
        initial_return_packet=[*start, *at_rest],
        forward_fields=("force", "velocity"),
        return_fields=("position", "velocity"),
    )


def MakeSlaveStation(control_law: System) -> Diagram:
    """Makes the slave side of the thesis, named `controller`, from a control law.

    | port | name              | size | unit     |
    |------|-------------------|------|----------|
    | in   | forward_packet    | 2n   | [N; m/s] |
    | in   | tool_position     | n    | m        |
    | in   | tool_velocity     | n    | m/s      |
    | in   | environment_force | n    | N        |
    | out  | control_force     | n    | N        |
    | out  | return_packet     | 2n   | [m; m/s] |

    and every further output of the control law (its telemetry), under its own name.

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
