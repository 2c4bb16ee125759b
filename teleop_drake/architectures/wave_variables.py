"""Wave variables: the channels carry waves, which delay cannot make active."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_drake.architectures.base import Architecture, ArchitectureConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.architectures.wave_master import WaveMaster
from teleop_drake.architectures.wave_slave import WaveSlave
from teleop_drake.channels import ChannelConfig
from teleop_drake.laws.wave_variables import passive_scaling
from teleop_drake.validation import CheckGain, CheckNumber, GainMatrix, Refuse

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class WaveVariables:
    """The wave line with every number; see WaveVariablesConfig for what they are."""

    impedance: Array
    master_damping: Array
    forward_bandwidth: float | None
    return_bandwidth: float | None
    forward_scaling: float
    return_scaling: float
    drift_correction: float


@dataclass(kw_only=True, eq=False)
class WaveVariablesConfig(ArchitectureConfig):
    """The wave line; see architectures.wave_master.WaveMaster."""

    kind = "wave_variables"

    # b, wave impedance, N s/m, > 0. Null: matched to the operator, whose force is
    # H = K/s + b + O(s) at low frequency: b is the resistance of the haptic device.
    impedance: np.ndarray | float | None = None
    # Damper at the master's end of the line, N s/m, >= 0. Null: b, which absorbs the
    # returning wave whatever the operator does; 0 is the bare line.
    master_damping: np.ndarray | float | None = None
    # Corner of the low-pass through which the arriving forward wave goes, rad/s, > 0;
    # null: none.
    forward_bandwidth: float | None = None
    # The same for the returning wave.
    return_bandwidth: float | None = None
    # Factor on the arriving forward wave, 0 to 1. Null: sqrt(1 - largest dT/dt) of a
    # variable channel that grows, which keeps it passive; 1 for all others.
    forward_scaling: float | None = None
    # The same for the returning wave.
    return_scaling: float | None = None
    # Rate at which the tool is pulled to the master's position, 1/s, >= 0, as far as
    # that takes energy out of the line. 0: not at all.
    drift_correction: float = 0.0

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field for itself.

        Args:
            path: The config's place in a scenario, for messages.
            num_axes: Number n of task axes.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        for key, may_be_zero in (("impedance", False), ("master_damping", True)):
            CheckGain(
                f"{path}.{key}",
                getattr(self, key),
                num_axes,
                may_be_zero=may_be_zero,
                may_be_null=True,
            )
        for key in ("forward_bandwidth", "return_bandwidth"):
            value = getattr(self, key)
            if value is not None:
                CheckNumber(f"{path}.{key}", value, "rad/s", above=0)
        for key in ("forward_scaling", "return_scaling"):
            value = getattr(self, key)
            if value is not None:
                CheckNumber(f"{path}.{key}", value, "", above=0, maximum=1)
        CheckNumber(f"{path}.drift_correction", self.drift_correction, "1/s", minimum=0)

    def Resolve(self, facts: Facts, path: str) -> WaveVariables:
        """Returns the parameters with every default derived.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        n, impedance = facts.num_axes, self.impedance
        if impedance is None:
            impedance = facts.OperatorResistance(f"{path}.impedance")
        damping = impedance if self.master_damping is None else self.master_damping

        def Scaling(given: float | None, channel: ChannelConfig) -> float:
            if given is not None:
                return given
            return passive_scaling(channel.LargestSlope(facts.duration))

        return WaveVariables(
            impedance=GainMatrix(impedance, n),
            master_damping=GainMatrix(damping, n),
            forward_bandwidth=self.forward_bandwidth,
            return_bandwidth=self.return_bandwidth,
            forward_scaling=Scaling(self.forward_scaling, facts.forward_channel),
            return_scaling=Scaling(self.return_scaling, facts.return_channel),
            drift_correction=self.drift_correction,
        )

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived, or the wave would go round
                in no time.
        """
        line = self.Resolve(facts, path)
        facts.CheckStrictlyProper(self.kind)
        is_open = np.allclose(line.master_damping, line.impedance, rtol=1e-12, atol=0)
        is_open |= bool(line.forward_bandwidth or line.return_bandwidth)
        if facts.has_no_delay and not is_open:
            Refuse(
                f"{path}.master_damping",
                line.master_damping,
                "null without delay, or there must be a bandwidth: the wave would go "
                "round in no time",
            )
        start: list[float] = facts.start.tolist()
        # No waves under way, and both at the start.
        packet = [*[0.0] * len(start), *start]
        return Architecture(
            master_side=WaveMaster(
                impedance=line.impedance,
                damping=line.master_damping,
                start=start,
                scaling=line.return_scaling,
                bandwidth=line.return_bandwidth,
            ),
            slave_side=WaveSlave(
                impedance=line.impedance,
                scaling=line.forward_scaling,
                bandwidth=line.forward_bandwidth,
                drift_correction=line.drift_correction,
            ),
            initial_forward_packet=packet,
            initial_return_packet=packet,
        )
