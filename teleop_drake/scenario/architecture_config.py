"""Parameters of the established architectures, as plain data, and their checks.

Each class is one field of scenario.ControllerConfig. `null` stands for a default that
derives from the rest of the scenario by the rule in the field's comment;
`architectures.ResolveController` computes it. A gain is a number (times the identity)
or a symmetric n x n matrix.

A ValueError names the parameter by its place in the controller, its value and what is
allowed.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teleop_drake.validation import CheckGain, CheckNumber, Refuse


@dataclass(kw_only=True, eq=False)
class WaveVariablesConfig:
    """The wave line; see systems.wave_master.WaveMaster."""

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


@dataclass(kw_only=True, eq=False)
class TimeDomainPassivityConfig:
    """Direct force under passivity control; see systems.passivity_slave."""

    # Time for which the energy must last at the present power, s, > 0. It plays the
    # part of the sample period of the customary controllers, 1 ms; the shorter, the
    # more exactly passive and the slower to simulate. Assumed.
    horizon: float = 0.01
    # Largest damping at the tool, N s/m, > 0. Null: m / horizon, with the smallest
    # apparent mass m at the start pose: the tool stops within a horizon at the fastest.
    maximum_damping: float | None = None
    # Largest mobility at the hand, m/(N s), > 0. Null: 1 / (h horizon), with h = s H(s)
    # for s to infinity: the haptic force falls within a horizon at the fastest.
    maximum_mobility: float | None = None
    # E_0, energy that the tool may take on each axis before the operator has given any,
    # J, > 0. Null: what brings it to the commanded speed v_d and keeps it there for a
    # round trip T, m |v_d|^2 / 2 + d |v_d|^2 T, with the largest apparent mass m at
    # the start pose and the damping d of rail and first layer.
    initial_energy: float | None = None


@dataclass(kw_only=True, eq=False)
class ProportionalDampingConfig:
    """P+d; see systems.proportional_master.ProportionalMaster."""

    # Mass of the handle, kg, > 0. Assumed: that of the slider (thesis eq. 2.12).
    master_mass: np.ndarray | float = 0.5
    # B_m, damping of the handle, N s/m, >= 0. Null: the resistance of the haptic device
    # at low frequency, so that the operator feels no more of it than of his own.
    master_damping: np.ndarray | float | None = None
    # B_s, damping of the tool, N s/m, >= 0. Null: as B_m.
    slave_damping: np.ndarray | float | None = None
    # By how much the dampings exceed what stability needs, > 1, for the null below:
    # 4 B_m B_s = margin (T_f + T_r)^2 K^2. Assumed.
    margin: float = 2.0
    # K, N/m, >= 0. Null: from the margin and the nominal delays, with the smallest
    # dampings, but at most what makes the handle as fast as the fastest pole p of the
    # haptic device, K = M |p|^2.
    stiffness: np.ndarray | float | None = None


FOUR_CHANNEL_VARIANTS = {
    # C1, C2, C3, C4; local stiffness at the master, at the slave.
    "four_channel": (1.0, 1.0, 1.0, 1.0, True, True),
    "position_position": (1.0, 0.0, 0.0, 1.0, True, True),
    "position_force": (1.0, 1.0, 0.0, 0.0, False, True),
    "force_force": (0.0, 1.0, 1.0, 0.0, False, False),
}
"""Variants of the four-channel architecture, by what goes forward and comes back."""


@dataclass(kw_only=True, eq=False)
class LocalController:
    """C = damping + stiffness / s of a four-channel station."""

    # N s/m, >= 0. Null: 2 M w with the mass M of the handle and the bandwidth w, which
    # is critical; 0 at a station to which no motion comes. Equal at both stations, so
    # that a lasting force arrives as it was sent.
    damping: np.ndarray | float | None = None
    # N/m, >= 0. Null: M w^2, or 0 likewise.
    stiffness: np.ndarray | float | None = None


@dataclass(kw_only=True, eq=False)
class FourChannelConfig:
    """Lawrence's architecture; see systems.four_channel_master.FourChannelMaster."""

    # One of FOUR_CHANNEL_VARIANTS. It decides what null means in C1 to C4.
    variant: str = "four_channel"
    # Mass of the handle, kg, > 0. Assumed: that of the slider (thesis eq. 2.12).
    master_mass: np.ndarray | float = 0.5
    # Damping of the handle, N s/m, >= 0. Assumed: that of the slider.
    master_damping: np.ndarray | float = 0.1
    # Mass in the model of the robot, kg, >= 0. Null: the apparent mass at the start.
    slave_mass: np.ndarray | float | None = None
    # Damping in the model of the robot, N s/m, >= 0, which C1 compensates. Null: the
    # robot's own in four_channel, none in the other variants.
    slave_damping: np.ndarray | float | None = None
    # w of the local controllers, rad/s, > 0. Null: 1 / (T_f + T_r), at which the round
    # trip turns the phase by 1 rad, but at most the fastest pole of the haptic device.
    bandwidth: float | None = None
    # C_m and C_s.
    C_m: LocalController = field(default_factory=LocalController)
    C_s: LocalController = field(default_factory=LocalController)
    # Motion forward and back, in units of the ideal Z_s + C_s and -(Z_m + C_m).
    C1: float | None = None
    C4: float | None = None
    # Force back and forward.
    C2: float | None = None
    C3: float | None = None
    # Local force at the slave and at the master. Null: C3 - 1 and C2 - 1 where that
    # force is exchanged, which transparency needs, else 0.
    C5: float | None = None
    C6: float | None = None
    # Corner of the filters that measure accelerations for C1 and C4, rad/s, > 0. Null:
    # without accelerations, as Lawrence has it in practice.
    acceleration_bandwidth: float | None = None


@dataclass(kw_only=True, eq=False)
class SmithPredictorConfig:
    """Direct force with a model at the master; see systems.smith_predictor_master."""

    # M of the model, kg, > 0. Null: the apparent mass of the robot at its start.
    mass: np.ndarray | float | None = None
    # B, N s/m, >= 0. Null: that of the robot and, along x, of the layer at the start.
    damping: np.ndarray | float | None = None
    # K, N/m, >= 0. Null: that of the layer at the start, along x.
    stiffness: np.ndarray | float | None = None
    # T, s, >= 0. Null: T_f + T_r, the nominal round trip.
    delay: float | None = None


def check_controller(controller: Any, num_axes: int) -> None:
    """Raises ValueError on parameters that no architecture can have.

    Args:
        controller: A scenario.ControllerConfig. All are checked, not only those of
            its kind.
        num_axes: Number n of task axes.
    """
    _check_wave_variables(controller.wave_variables, num_axes)
    _check_proportional_damping(controller.proportional_damping, num_axes)
    _check_four_channel(controller.four_channel, num_axes)
    _check_smith_predictor(controller.smith_predictor, num_axes)
    passivity = controller.time_domain_passivity
    path = "time_domain_passivity"
    CheckNumber(f"{path}.horizon", passivity.horizon, "s", above=0)
    for key, unit in (
        ("maximum_damping", "N s/m"),
        ("maximum_mobility", "m/(N s)"),
        ("initial_energy", "J"),
    ):
        value = getattr(passivity, key)
        if value is not None:
            CheckNumber(f"{path}.{key}", value, unit, above=0)


def _check_proportional_damping(config: ProportionalDampingConfig, n: int) -> None:
    path = "proportional_damping"
    if config.master_mass is None:
        Refuse(f"{path}.master_mass", None, "a number or a matrix (kg)")
    CheckGain(f"{path}.master_mass", config.master_mass, n, may_be_null=True)
    for key in ("master_damping", "slave_damping", "stiffness"):
        CheckGain(
            f"{path}.{key}", getattr(config, key), n, may_be_zero=True, may_be_null=True
        )
    CheckNumber(f"{path}.margin", config.margin, "", above=1)


def _check_four_channel(config: FourChannelConfig, n: int) -> None:
    path = "four_channel"
    if config.variant not in FOUR_CHANNEL_VARIANTS:
        variants = ", ".join(FOUR_CHANNEL_VARIANTS)
        Refuse(f"{path}.variant", config.variant, f"one of {variants}")
    for key in ("master_mass", "master_damping"):
        if getattr(config, key) is None:
            Refuse(f"{path}.{key}", None, "a number or a matrix")
    CheckGain(f"{path}.master_mass", config.master_mass, n, may_be_null=True)
    for key in ("master_damping", "slave_mass", "slave_damping"):
        CheckGain(
            f"{path}.{key}", getattr(config, key), n, may_be_zero=True, may_be_null=True
        )
    for key in ("C_m", "C_s"):
        local = getattr(config, key)
        for name in ("damping", "stiffness"):
            gain = getattr(local, name)
            CheckGain(
                f"{path}.{key}.{name}", gain, n, may_be_zero=True, may_be_null=True
            )
    for key in ("bandwidth", "acceleration_bandwidth"):
        if getattr(config, key) is not None:
            CheckNumber(f"{path}.{key}", getattr(config, key), "rad/s", above=0)
    for key in ("C1", "C2", "C3", "C4", "C5", "C6"):
        if getattr(config, key) is not None:
            CheckNumber(f"{path}.{key}", getattr(config, key), "")


def _check_smith_predictor(config: SmithPredictorConfig, n: int) -> None:
    path = "smith_predictor"
    CheckGain(f"{path}.mass", config.mass, n, may_be_null=True)
    for key in ("damping", "stiffness"):
        CheckGain(
            f"{path}.{key}", getattr(config, key), n, may_be_zero=True, may_be_null=True
        )
    if config.delay is not None:
        CheckNumber(f"{path}.delay", config.delay, "s", minimum=0)


def _check_wave_variables(config: WaveVariablesConfig, n: int) -> None:
    path = "wave_variables"
    CheckGain(f"{path}.impedance", config.impedance, n, may_be_null=True)
    CheckGain(
        f"{path}.master_damping",
        config.master_damping,
        n,
        may_be_zero=True,
        may_be_null=True,
    )
    for key in ("forward_bandwidth", "return_bandwidth"):
        value = getattr(config, key)
        if value is not None:
            CheckNumber(f"{path}.{key}", value, "rad/s", above=0)
    for key in ("forward_scaling", "return_scaling"):
        value = getattr(config, key)
        if value is not None:
            CheckNumber(f"{path}.{key}", value, "", above=0, maximum=1)
    CheckNumber(f"{path}.drift_correction", config.drift_correction, "1/s", minimum=0)
