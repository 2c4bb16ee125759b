"""Control architectures: what stands at the two ends of the channels.

An architecture is a master side, a slave side and what the channels deliver before the
first packet. Nothing else in the package knows which one it is.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.architectures.four_channel_master import FourChannelMaster
from teleop_drake.architectures.four_channel_slave import FourChannelSlave
from teleop_drake.architectures.passivity_master import PassivityMaster
from teleop_drake.architectures.passivity_slave import PassivitySlave
from teleop_drake.architectures.proportional_master import ProportionalMaster
from teleop_drake.architectures.proportional_slave import ProportionalSlave
from teleop_drake.architectures.smith_predictor_master import SmithPredictorMaster
from teleop_drake.architectures.wave_master import WaveMaster
from teleop_drake.architectures.wave_slave import WaveSlave
from teleop_drake.laws.layered_force import layer_index
from teleop_drake.laws.wave_variables import passive_scaling
from teleop_drake.numerics.transfer_function import (
    low_frequency_resistance,
    realize_transfer_function,
)
from teleop_drake.robots import TaskDamping, TaskInertiaInverse
from teleop_drake.scenario import (
    CONTROLLERS,
    ChannelConfig,
    GainMatrix,
    LayerConfig,
    Scenario,
    ScenarioError,
)
from teleop_drake.scenario.architecture_config import (
    FOUR_CHANNEL_VARIANTS,
    FourChannelConfig,
    LocalController,
    ProportionalDampingConfig,
    SmithPredictorConfig,
    TimeDomainPassivityConfig,
    WaveVariablesConfig,
)
from teleop_drake.stations import MakeControlLaw, MakeSlaveStation
from teleop_drake.systems.direct_force import DirectForce


@dataclass(kw_only=True)
class Architecture:
    """A master side and a slave side which understand each other's packets.

    The widths of the packets, m_f forward and m_r back, are those of the ports.

    Attributes:
        master_side: In haptic_force (n, N), velocity_command (n, m/s) and
            return_packet (m_r); out felt_position (n, m), felt_velocity (n, m/s) and
            forward_packet (m_f). The surgeon perceives contact when felt_position
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


def MakeArchitecture(
    scenario: Scenario, *, control_law: System | None = None
) -> Architecture:
    """Makes the architecture that the scenario names.

    Args:
        scenario: Its field controller is used, and what its defaults derive from.
        control_law: A control law of your own, which takes the place of the
            scenario's; it gets the thesis's packets. See stations.MakeSlaveStation.

    Raises:
        ScenarioError: If a parameter is not allowed.
        RuntimeError: If the control law lacks a port.
    """
    kind = scenario.controller.kind
    if control_law is None and kind not in CONTROLLERS:
        make: Callable[[Scenario], Architecture] = _MAKERS[kind]
        return make(scenario)
    # Neither a force nor a command at first, and the tool felt at rest at its start.
    n, start = scenario.num_axes, _Start(scenario)
    return Architecture(
        slave_side=MakeSlaveStation(control_law or MakeControlLaw(scenario)),
        initial_forward_packet=[0.0] * (2 * n),
        initial_return_packet=[*start, *[0.0] * n],
    )


def CheckArchitecture(scenario: Scenario) -> None:
    """Checks what the scenario's architecture needs of the rest of it.

    Scenario.Validate() checks each parameter, but not what derives from others.

    Args:
        scenario: A valid one.

    Raises:
        ValueError: If a default cannot be derived, or the architecture cannot be built
            with this haptic device, these channels or this robot.
    """
    if scenario.controller.kind not in CONTROLLERS:
        MakeArchitecture(scenario)


def ResolveController(scenario: Scenario) -> Any:
    """Returns the parameters of the scenario's architecture with every default derived.

    Args:
        scenario: Its controller.kind is not one of the thesis's two.

    Returns:
        The field of scenario.controller of that name, in which no null is left that
        stands for a derived value; gains are n x n matrices.

    Raises:
        ScenarioError: If it is one of the two, or a default cannot be derived.
    """
    kind = scenario.controller.kind
    if kind not in _RESOLVERS:
        raise ScenarioError(
            f"controller.kind = {kind!r}: must be one of {', '.join(_RESOLVERS)}"
        )
    resolve: Callable[[Scenario], Any] = _RESOLVERS[kind]
    return resolve(scenario)


def _Start(scenario: Scenario) -> list[float]:
    start: list[float] = np.asarray(scenario.robot.start, dtype=float).tolist()
    return start


def _OperatorResistance(scenario: Scenario, path: str) -> float:
    """Returns b of H = K/s + b + O(s) in N s/m, from which a default derives."""
    device = scenario.haptic_device
    b = low_frequency_resistance(device.numerator, device.denominator)
    if not b > 0:
        raise ScenarioError(
            f"controller.{path} = null: must be a number, because none derives from "
            f"haptic_device, whose resistance at low frequency is {b:g} N s/m"
        )
    return b


def _RoundTrip(scenario: Scenario) -> float:
    """Returns the nominal round trip T_f + T_r in s."""
    return scenario.forward_channel.delay + scenario.return_channel.delay


def _ApparentMass(scenario: Scenario) -> np.ndarray:
    """Returns M_r of the robot at its start pose in kg (n, n)."""
    robot = scenario.robot
    inverse = TaskInertiaInverse(
        model=robot.model, start=robot.start, elbow=robot.elbow, mass=robot.mass
    )
    return np.asarray(np.linalg.inv(inverse))


def _RobotDamping(scenario: Scenario) -> np.ndarray:
    """Returns the damping of the robot itself in N s/m (n, n)."""
    robot = scenario.robot
    return TaskDamping(
        model=robot.model, start=robot.start, elbow=robot.elbow, damping=robot.damping
    )


def _StartDamping(scenario: Scenario) -> np.ndarray:
    """Returns the damping of robot and layer at the start in N s/m (n, n)."""
    damping = _RobotDamping(scenario)
    damping[0, 0] += _StartLayer(scenario).damping
    return damping


def _StartLayer(scenario: Scenario) -> LayerConfig:
    """Returns the layer in which the tool starts, an empty one if there is none."""
    layers = scenario.environment.layers
    index = layer_index([layer.start for layer in layers], scenario.robot.start[0])
    return layers[index] if index >= 0 else LayerConfig()


def _HasNoDelay(scenario: Scenario) -> bool:
    """Returns whether both channels pass their signals straight through."""
    return all(
        channel.IsPassThrough()
        for channel in (scenario.forward_channel, scenario.return_channel)
    )


def _CheckStrictlyProper(scenario: Scenario) -> None:
    """Refuses a haptic device whose force answers at once to the velocity it feels."""
    device = scenario.haptic_device
    num = np.trim_zeros(np.asarray(device.numerator, dtype=float), "f")
    if len(num) >= len(device.denominator):
        raise ScenarioError(
            f"haptic_device.numerator = {num.tolist()}: must be of lower degree than "
            f"the denominator for {scenario.controller.kind}, in which the velocity "
            "that is felt depends on the force"
        )


# Wave variables.


def _ResolveWaveVariables(scenario: Scenario) -> WaveVariablesConfig:
    config, n = scenario.controller.wave_variables, scenario.num_axes
    impedance = config.impedance
    if impedance is None:
        impedance = _OperatorResistance(scenario, "wave_variables.impedance")
    damping = impedance if config.master_damping is None else config.master_damping

    def Scaling(given: float | None, channel: ChannelConfig) -> float:
        if given is not None:
            return given
        return passive_scaling(channel.LargestSlope(scenario.duration))

    return dataclasses.replace(
        config,
        impedance=GainMatrix(impedance, n),
        master_damping=GainMatrix(damping, n),
        forward_scaling=Scaling(config.forward_scaling, scenario.forward_channel),
        return_scaling=Scaling(config.return_scaling, scenario.return_channel),
    )


def _MakeWaveVariables(scenario: Scenario) -> Architecture:
    config: Any = _ResolveWaveVariables(scenario)
    _CheckStrictlyProper(scenario)
    is_open = np.allclose(config.master_damping, config.impedance, rtol=1e-12, atol=0)
    is_open |= bool(config.forward_bandwidth or config.return_bandwidth)
    if _HasNoDelay(scenario) and not is_open:
        raise ScenarioError(
            "controller.wave_variables.master_damping = "
            f"{config.master_damping.tolist()}: must be null without delay, or there "
            "must be a bandwidth: the wave would go round in no time"
        )
    n, start = scenario.num_axes, _Start(scenario)
    return Architecture(
        master_side=WaveMaster(
            impedance=config.impedance,
            damping=config.master_damping,
            start=start,
            scaling=config.return_scaling,
            bandwidth=config.return_bandwidth,
        ),
        slave_side=WaveSlave(
            impedance=config.impedance,
            scaling=config.forward_scaling,
            bandwidth=config.forward_bandwidth,
            drift_correction=config.drift_correction,
        ),
        # No waves under way, and both at the start.
        initial_forward_packet=[*[0.0] * n, *start],
        initial_return_packet=[*[0.0] * n, *start],
    )


# Time-domain passivity.


def _ResolveTimeDomainPassivity(scenario: Scenario) -> TimeDomainPassivityConfig:
    config = scenario.controller.time_domain_passivity
    masses = np.linalg.eigvalsh(_ApparentMass(scenario))
    mobility = config.maximum_mobility
    if mobility is None:
        device = scenario.haptic_device
        _, B, C, _ = realize_transfer_function(device.numerator, device.denominator)
        h = float((C @ B).sum())
        if not h > 0:
            raise ScenarioError(
                "controller.time_domain_passivity.maximum_mobility = null: must be a "
                f"number, because none derives from haptic_device with s H(s) -> {h:g}"
            )
        mobility = 1 / (h * config.horizon)
    energy = config.initial_energy
    if energy is None:
        damping = float(np.linalg.eigvalsh(_StartDamping(scenario))[-1])
        v_d = np.asarray(scenario.surgeon.velocity, dtype=float)
        energy = (masses[-1] / 2 + damping * _RoundTrip(scenario)) * float(v_d @ v_d)
    return dataclasses.replace(
        config,
        maximum_damping=config.maximum_damping or float(masses[0]) / config.horizon,
        maximum_mobility=mobility,
        initial_energy=float(energy),
    )


def _MakeTimeDomainPassivity(scenario: Scenario) -> Architecture:
    config: Any = _ResolveTimeDomainPassivity(scenario)
    _CheckStrictlyProper(scenario)
    n, start = scenario.num_axes, _Start(scenario)
    return Architecture(
        master_side=PassivityMaster(
            num_axes=n,
            horizon=config.horizon,
            maximum_mobility=config.maximum_mobility,
            energy_scale=config.initial_energy,
        ),
        slave_side=PassivitySlave(
            num_axes=n,
            horizon=config.horizon,
            maximum_damping=config.maximum_damping,
            initial_energy=config.initial_energy,
        ),
        initial_forward_packet=[0.0] * (2 * n),
        initial_return_packet=[*start, *[0.0] * (2 * n)],
    )


# P+d.


def _DevicePole(scenario: Scenario) -> float:
    """Returns the magnitude of the fastest pole of the haptic device in rad/s."""
    poles = np.roots(np.asarray(scenario.haptic_device.denominator, dtype=float))
    return float(np.abs(poles).max(initial=0.0))


def _ResolveProportionalDamping(scenario: Scenario) -> ProportionalDampingConfig:
    config, n = scenario.controller.proportional_damping, scenario.num_axes
    B_m = config.master_damping
    if B_m is None:
        B_m = _OperatorResistance(scenario, "proportional_damping.master_damping")
    B_m = GainMatrix(B_m, n)
    B_s = B_m if config.slave_damping is None else GainMatrix(config.slave_damping, n)
    mass = GainMatrix(config.master_mass, n)
    stiffness = config.stiffness
    if stiffness is None:
        least = np.linalg.eigvalsh(B_m)[0] * np.linalg.eigvalsh(B_s)[0]
        stiffness = float(np.linalg.eigvalsh(mass)[0]) * _DevicePole(scenario) ** 2
        T = _RoundTrip(scenario)
        if T > 0:
            stiffness = min(stiffness, math.sqrt(4 * least / config.margin) / T)
        if not stiffness > 0:
            raise ScenarioError(
                "controller.proportional_damping.stiffness = null: must be a number, "
                "because the dampings or the poles of haptic_device are 0"
            )
    return dataclasses.replace(
        config,
        master_mass=mass,
        master_damping=B_m,
        slave_damping=B_s,
        stiffness=GainMatrix(stiffness, n),
    )


def _MakeProportionalDamping(scenario: Scenario) -> Architecture:
    config: Any = _ResolveProportionalDamping(scenario)
    start = _Start(scenario)
    return Architecture(
        master_side=ProportionalMaster(
            mass=config.master_mass,
            stiffness=config.stiffness,
            damping=config.master_damping,
            start=start,
        ),
        slave_side=ProportionalSlave(
            stiffness=config.stiffness, damping=config.slave_damping
        ),
        initial_forward_packet=start,
        initial_return_packet=start,
    )


# Four channels.


def _ResolveFourChannel(scenario: Scenario) -> FourChannelConfig:
    config, n = scenario.controller.four_channel, scenario.num_axes
    C1, C2, C3, C4, is_master_tied, is_slave_tied = FOUR_CHANNEL_VARIANTS[
        config.variant
    ]
    C1, C2, C3, C4 = (
        default if given is None else given
        for default, given in (
            (C1, config.C1),
            (C2, config.C2),
            (C3, config.C3),
            (C4, config.C4),
        )
    )
    w = config.bandwidth
    if w is None:
        w, T = _DevicePole(scenario), _RoundTrip(scenario)
        w = min(w, 1 / T) if T > 0 else w
    M_m = GainMatrix(config.master_mass, n)
    M_s = config.slave_mass
    M_s = _ApparentMass(scenario) if M_s is None else GainMatrix(M_s, n)
    B_s = config.slave_damping
    if B_s is None:
        is_compensated = config.variant == "four_channel"
        B_s = _RobotDamping(scenario) if is_compensated else 0.0

    def Local(given: LocalController, is_tied: bool) -> LocalController:
        K, B = given.stiffness, given.damping
        if K is None:
            K = M_m * w**2 if is_tied else 0.0
        if B is None:
            B = 2 * M_m * w if is_tied else 0.0
        return LocalController(damping=GainMatrix(B, n), stiffness=GainMatrix(K, n))

    def LocalForce(given: float | None, exchanged: float) -> float:
        if given is not None:
            return given
        return exchanged - 1 if exchanged else 0.0

    return FourChannelConfig(
        variant=config.variant,
        master_mass=M_m,
        master_damping=GainMatrix(config.master_damping, n),
        slave_mass=M_s,
        slave_damping=GainMatrix(B_s, n),
        bandwidth=w,
        C_m=Local(config.C_m, is_master_tied),
        C_s=Local(config.C_s, is_slave_tied),
        C1=C1,
        C2=C2,
        C3=C3,
        C4=C4,
        C5=LocalForce(config.C5, C3),
        C6=LocalForce(config.C6, C2),
        acceleration_bandwidth=config.acceleration_bandwidth,
    )


def _MakeFourChannel(scenario: Scenario) -> Architecture:
    config: Any = _ResolveFourChannel(scenario)
    n, start = scenario.num_axes, _Start(scenario)
    packet = [*start, *[0.0] * ((3 if config.acceleration_bandwidth else 2) * n)]
    return Architecture(
        master_side=FourChannelMaster(
            mass=config.master_mass,
            damping=config.master_damping,
            local_damping=config.C_m.damping,
            local_stiffness=config.C_m.stiffness,
            C2=config.C2,
            C4=config.C4,
            C6=config.C6,
            start=start,
            acceleration_bandwidth=config.acceleration_bandwidth,
        ),
        slave_side=FourChannelSlave(
            mass=config.slave_mass,
            damping=config.slave_damping,
            local_damping=config.C_s.damping,
            local_stiffness=config.C_s.stiffness,
            C1=config.C1,
            C3=config.C3,
            C5=config.C5,
            start=start,
            acceleration_bandwidth=config.acceleration_bandwidth,
        ),
        initial_forward_packet=packet,
        initial_return_packet=packet,
    )


# Smith predictor.


def _ResolveSmithPredictor(scenario: Scenario) -> SmithPredictorConfig:
    config, n = scenario.controller.smith_predictor, scenario.num_axes

    def Given(gain: Any, default: np.ndarray) -> np.ndarray:
        return default if gain is None else GainMatrix(gain, n)

    stiffness = np.zeros((n, n))
    stiffness[0, 0] = _StartLayer(scenario).stiffness
    return SmithPredictorConfig(
        mass=Given(config.mass, _ApparentMass(scenario)),
        damping=Given(config.damping, _StartDamping(scenario)),
        stiffness=Given(config.stiffness, stiffness),
        delay=_RoundTrip(scenario) if config.delay is None else config.delay,
    )


def _MakeSmithPredictor(scenario: Scenario) -> Architecture:
    config: Any = _ResolveSmithPredictor(scenario)
    n, start = scenario.num_axes, _Start(scenario)
    return Architecture(
        master_side=SmithPredictorMaster(
            mass=config.mass,
            damping=config.damping,
            stiffness=config.stiffness,
            delay=config.delay,
        ),
        slave_side=MakeSlaveStation(DirectForce(num_axes=n)),
        initial_forward_packet=[0.0] * (2 * n),
        initial_return_packet=[*start, *[0.0] * n],
    )


_RESOLVERS = {
    "wave_variables": _ResolveWaveVariables,
    "time_domain_passivity": _ResolveTimeDomainPassivity,
    "proportional_damping": _ResolveProportionalDamping,
    "four_channel": _ResolveFourChannel,
    "smith_predictor": _ResolveSmithPredictor,
}

_MAKERS = {
    "wave_variables": _MakeWaveVariables,
    "time_domain_passivity": _MakeTimeDomainPassivity,
    "proportional_damping": _MakeProportionalDamping,
    "four_channel": _MakeFourChannel,
    "smith_predictor": _MakeSmithPredictor,
}
