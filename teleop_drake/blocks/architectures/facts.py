"""Facts of the loop from which an architecture derives its defaults."""

from dataclasses import dataclass

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.blocks.channels import ChannelConfig
from teleop_drake.blocks.systems.haptic_device import HapticDeviceConfig
from teleop_drake.numerics.transfer_function import (
    low_frequency_resistance,
    realize_transfer_function,
)
from teleop_drake.validation import Refuse, ScenarioError


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
        dampings = ("robot_damping", "environment_damping")
        robot, environment = (self.Told(fact, path) for fact in dampings)
        return robot + environment

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
            told = f"whose {name} at low frequency is {value:g} {unit}"
            allowed = f"a number, because none derives from haptic_device, {told}"
            Refuse(path, None, allowed)
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
