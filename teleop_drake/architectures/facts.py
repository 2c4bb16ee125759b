"""Facts of the loop from which an architecture derives its defaults."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_drake.channels import ChannelConfig
from teleop_drake.numerics.transfer_function import (
    low_frequency_resistance,
    realize_transfer_function,
)
from teleop_drake.systems.haptic_device import HapticDeviceConfig
from teleop_drake.validation import Refuse, ScenarioError

Array = NDArray[np.float64]


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

    def Inertia(self, path: str) -> Array:
        """Returns M_r in kg (n, n), from which a default derives.

        Raises:
            ScenarioError: If the robot does not tell it.
        """
        return _Told(self.inertia, path, "robot does not tell its inertia")

    def RobotDamping(self, path: str) -> Array:
        """Returns the damping of the robot in N s/m (n, n); see Inertia.

        Raises:
            ScenarioError: If the robot does not tell it.
        """
        return _Told(self.robot_damping, path, "robot does not tell its damping")

    def StartStiffness(self, path: str) -> Array:
        """Returns the stiffness of the environment at the start in N/m (n, n).

        Raises:
            ScenarioError: If the environment does not tell it.
        """
        reason = "environment does not tell its stiffness"
        return _Told(self.environment_stiffness, path, reason)

    def StartDamping(self, path: str) -> Array:
        """Returns the damping of robot and environment at the start in N s/m (n, n).

        Raises:
            ScenarioError: If one of them does not tell it.
        """
        return self.RobotDamping(path) + self.EnvironmentDamping(path)

    def EnvironmentDamping(self, path: str) -> Array:
        """Returns D_e at the start in N s/m (n, n).

        Raises:
            ScenarioError: If the environment does not tell it.
        """
        reason = "environment does not tell its damping"
        return _Told(self.environment_damping, path, reason)

    def OperatorResistance(self, path: str) -> float:
        """Returns b of H = K/s + b + O(s) in N s/m, from which a default derives.

        Raises:
            ScenarioError: If it is not positive.
        """
        device = self.haptic_device
        b = low_frequency_resistance(device.numerator, device.denominator)
        if not b > 0:
            Refuse(
                path,
                None,
                "a number, because none derives from haptic_device, whose resistance "
                f"at low frequency is {b:g} N s/m",
            )
        return b

    def OperatorStiffness(self, path: str) -> float:
        """Returns K of H = K/s + b + O(s) in N/m, from which a default derives.

        Raises:
            ScenarioError: If it is not positive.
        """
        device = self.haptic_device
        K = low_frequency_resistance([*device.numerator, 0.0], device.denominator)
        if not K > 0:
            Refuse(
                path,
                None,
                "a number, because none derives from haptic_device, whose stiffness "
                f"at low frequency is {K:g} N/m",
            )
        return K

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
        """Refuses a device whose force answers at once to the velocity it feels.

        Raises:
            ScenarioError: If the device has such a force.
        """
        device = self.haptic_device
        numerator = np.trim_zeros(np.asarray(device.numerator, dtype=float), "f")
        if len(numerator) >= len(device.denominator):
            raise ScenarioError(
                f"haptic_device.numerator = {numerator.tolist()}: must be of lower "
                f"degree than the denominator for {kind}, in which the velocity that "
                "is felt depends on the force"
            )


def _Told(value: Array | None, path: str, reason: str) -> Array:
    if value is None:
        Refuse(path, None, f"given, because the {reason}")
    return value.copy()
