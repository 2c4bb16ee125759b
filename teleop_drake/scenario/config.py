"""The parts of a scenario: robot, surgeon, channels, tissue, controller and solver.

Each is a dataclass, with its unit and where its default is from beside every field,
and has a function that checks it: the Check functions raise a ScenarioError that names
the first bad field, its value and what is allowed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.analysis import GetIntegrationSchemes, SimulatorConfig

from teleop_drake.channels.base import SHORTEST_TIME
from teleop_drake.numerics.transfer_function import realize_transfer_function
from teleop_drake.robots import CheckRobot, RobotModels
from teleop_drake.scenario.architecture_config import (
    FourChannelConfig,
    ProportionalDampingConfig,
    SmithPredictorConfig,
    TimeDomainPassivityConfig,
    WaveVariablesConfig,
    check_controller,
)
from teleop_drake.scenario.tree import ElementName
from teleop_drake.validation import (
    REQUIRED,
    CheckChoice,
    CheckGain,
    CheckNumber,
    CheckVector,
    Refuse,
    ScenarioError,
    Show,
)

CONTROLLERS = ("direct_force", "adaptive_backstepping")
"""The thesis's two controllers, the baseline first."""

ARCHITECTURES = (
    *CONTROLLERS,
    "wave_variables",
    "time_domain_passivity",
    "proportional_damping",
    "four_channel",
    "smith_predictor",
)
"""Every kind of control architecture, the thesis's two first."""

TRACKING_CONTROLLERS = ("network_tracking",)
"""Every kind of controller of a TrackingScenario."""

DISTURBANCES = ("linear", "coupled")
"""Every kind of disturbance of a TrackingScenario."""

MAX_BASIS_FUNCTIONS = 10_000
"""Largest lattice that a network may have, so that a typing error cannot exhaust the
memory."""

MAX_FREQUENCY = 1000.0
"""Highest frequency of a trajectory in rad/s."""

INTEGRATION_SCHEMES = tuple(
    # cenic steps a MultibodyPlant, which would have to be named `plant` and stand at
    # the top of the diagram. velocity_implicit_euler writes the state as if all q came
    # first, then all v and z, whereas a Diagram has the q, v and z of one system after
    # those of another: it is wrong, and says nothing.
    scheme
    for scheme in GetIntegrationSchemes()
    if scheme not in ("cenic", "velocity_implicit_euler")
)
"""Drake's integration schemes that can simulate a teleoperator."""


@dataclass(kw_only=True, eq=False)
class RobotConfig:
    """The slave robot (thesis section 2.3)."""

    # slider (thesis eq. 2.12) or two_link_arm (eq. 2.13 and Appendix A).
    model: str = REQUIRED
    # p_WT at time 0, m, n entries; reachable, not singular, in front of the contact
    # surface. The robot starts at rest.
    start: np.ndarray = REQUIRED
    # up (y > 0) or down (y < 0) at the start pose; two_link_arm only, else null.
    elbow: str | None = None
    # Mass, kg, > 0; slider only, else null. Null also keeps the model's own.
    mass: float | None = None
    # Viscous damping of the rail, N s/m, >= 0; slider only, else null, as above.
    damping: float | None = None


@dataclass(kw_only=True, eq=False)
class SurgeonConfig:
    """What the surgeon commands (thesis section 2.5)."""

    # v_d until contact is perceived, m/s, n entries, not all zero.
    velocity: np.ndarray = REQUIRED
    # Force once contact is perceived, N, n entries; null: keeps commanding velocity.
    # It has no effect where the environment has no contact surface.
    contact_force: np.ndarray | None = None
    # Time of the final stop, s, >= 0; null: never.
    stop_time: float | None = None


@dataclass(kw_only=True, eq=False)
class HapticDeviceConfig:
    """F_h = H(s) (v_d - v) on each axis (thesis eq. 2.1, 2.4, 2.5)."""

    # Coefficients of H in N s/m, highest power of s first.
    numerator: np.ndarray = field(default_factory=lambda: np.array([25.0, 50.0]))
    # The same; the first is not zero, and there are at least as many (H is proper).
    denominator: np.ndarray = field(default_factory=lambda: np.array([1.0, 25.0, 0.0]))


@dataclass(kw_only=True, eq=False)
class LayerConfig:
    """One layer of the environment, from its start to the next one's (eq. 2.14).

    force = stiffness (x - reference) + damping v_x.
    """

    # Unique, letters, digits and _ only: overrides address a layer by it.
    name: str = REQUIRED
    # Where the layer begins, m, ascending; the first may be -.inf.
    start: float = REQUIRED
    # N/m, >= 0.
    stiffness: float = 0.0
    # N s/m, >= 0.
    damping: float = 0.0
    # Where the spring is relaxed, m.
    reference: float = 0.0


@dataclass(kw_only=True, eq=False)
class EnvironmentConfig:
    """Layers along x (thesis eq. 2.14 to 2.16); no force in front of the first."""

    layers: list[LayerConfig] = field(default_factory=list)


@dataclass(kw_only=True, eq=False)
class NetworkConfig:
    """Lattice of the Gaussian networks (thesis eq. 3.1); the input is p_WT."""

    # Corners of the lattice of means, m, n entries each, lower < upper.
    lower: np.ndarray = REQUIRED
    upper: np.ndarray = REQUIRED
    # Means along each axis, n entries, >= 1.
    count: list[int] = REQUIRED
    # Width of the Gaussians in units of the lattice spacing, > 0.
    width: float = 1.0


@dataclass(kw_only=True, eq=False)
class ControllerConfig:
    """The control architecture.

    `direct_force` uses `kind` only, `adaptive_backstepping` all up to `network`, and
    each of the others the field of its name. A gain is a number (times the identity) or
    an n x n matrix.
    """

    # One of ARCHITECTURES.
    kind: str = REQUIRED
    # Weight of the force error in s, m/(N s); symmetric positive definite (eq. 5.2).
    Lambda: np.ndarray | float = 1.0
    # Gain on s, 1/s; symmetric positive definite, and so is the symmetric part of
    # P G1 (eq. 5.22).
    G1: np.ndarray | float = REQUIRED
    # Gain on z, 1/s; symmetric positive definite (eq. 5.31).
    G2: np.ndarray | float = REQUIRED
    # Weight of s in the Lyapunov function; symmetric positive definite (eq. 5.10).
    P: np.ndarray | float = 1.0
    # beta of every update law, >= 0 (eq. 5.51).
    adaptation_rate: float = 0.1
    # nu of every update law, >= 0 (eq. 5.51).
    leakage: float = 0.1
    # Upsilon, pull of Psi to its initial value, 0 to 1 (eq. 5.51).
    supervision: float = 1.0
    # Psi at time 0, 1/kg: number, n x n matrix, or auto = (I + Lambda D_e) M_r^-1 at
    # the start pose (eq. 5.52); smallest singular value > minimum_psi.
    initial_psi: np.ndarray | float | str = "auto"
    # Bound of the projection that keeps Psi invertible, 1/kg, > 0 (eq. 5.53).
    minimum_psi: float = 0.1
    # Lattice of both networks.
    network: NetworkConfig = field(default_factory=NetworkConfig)
    wave_variables: WaveVariablesConfig = field(default_factory=WaveVariablesConfig)
    time_domain_passivity: TimeDomainPassivityConfig = field(
        default_factory=TimeDomainPassivityConfig
    )
    proportional_damping: ProportionalDampingConfig = field(
        default_factory=ProportionalDampingConfig
    )
    four_channel: FourChannelConfig = field(default_factory=FourChannelConfig)
    smith_predictor: SmithPredictorConfig = field(default_factory=SmithPredictorConfig)


@dataclass(kw_only=True, eq=False)
class TrajectoryConfig:
    """r_d(t) = centre + amplitude sin(frequency t + phase) (thesis eq. 3.28)."""

    # m, n entries.
    centre: np.ndarray = REQUIRED
    # m, n entries; the whole line is in reach of the robot.
    amplitude: np.ndarray = REQUIRED
    # rad/s, 0 to MAX_FREQUENCY.
    frequency: float = 1.0
    # rad.
    phase: float = 0.0


@dataclass(kw_only=True, eq=False)
class DisturbanceConfig:
    """The unknown force F_e on the tool (thesis eq. 3.7, 3.8)."""

    # One of DISTURBANCES; coupled needs n = 2.
    kind: str = REQUIRED
    # K, N/m; a number (times the identity) or an n x n matrix.
    gain: np.ndarray | float = REQUIRED


@dataclass(kw_only=True, eq=False)
class TrackingControllerConfig:
    """The controller of chapter 3. A gain is a number or an n x n matrix."""

    # One of TRACKING_CONTROLLERS.
    kind: str = REQUIRED
    # Weight of the position error in s, 1/s; symmetric positive definite (eq. 3.11).
    Lambda: np.ndarray | float = REQUIRED
    # Gain on s, 1/s; symmetric positive definite (eq. 3.18).
    G1: np.ndarray | float = REQUIRED
    # beta, >= 0 (eq. 3.19); 0 switches the network off.
    adaptation_rate: float = REQUIRED
    # nu, >= 0 (eq. 3.27).
    leakage: float = REQUIRED
    network: NetworkConfig = field(default_factory=NetworkConfig)


def DefaultSimulator() -> SimulatorConfig:
    """Returns the solver of a scenario that says nothing of it."""
    # Dormand-Prince 5(4), the thesis's ode45. The tolerance is absolute in Drake.
    return SimulatorConfig(
        integration_scheme="runge_kutta5",
        use_error_control=True,
        accuracy=1e-8,
        max_step_size=0.005,
    )


def CheckRobotConfig(robot: RobotConfig) -> None:
    """Checks `robot`."""
    CheckChoice("robot.model", robot.model, RobotModels())
    if robot.start is None:
        Refuse("robot.start", robot.start, "a list of finite numbers (m)")
    try:
        CheckRobot(
            model=robot.model,
            start=robot.start,
            elbow=robot.elbow,
            mass=robot.mass,
            damping=robot.damping,
        )
    except ValueError as e:
        raise ScenarioError(str(e)) from None


def CheckSurgeonConfig(surgeon: SurgeonConfig, n: int) -> None:
    """Checks `surgeon`.

    Args:
        surgeon: What to check.
        n: Number of task axes.
    """
    CheckVector("surgeon.velocity", surgeon.velocity, n, "m/s")
    if not np.any(surgeon.velocity):
        Refuse("surgeon.velocity", surgeon.velocity, "non-zero on at least one axis")
    if surgeon.contact_force is not None:
        CheckVector("surgeon.contact_force", surgeon.contact_force, n, "N")
    if surgeon.stop_time is not None:
        CheckNumber("surgeon.stop_time", surgeon.stop_time, "s", minimum=0)


def CheckHapticDeviceConfig(device: HapticDeviceConfig) -> None:
    """Checks `haptic_device`."""
    try:
        with np.errstate(over="ignore"):
            matrices = realize_transfer_function(device.numerator, device.denominator)
    except ValueError as e:
        raise ScenarioError(f"haptic_device.{e}") from None
    if not all(np.all(np.isfinite(matrix)) for matrix in matrices):
        Refuse(
            "haptic_device.denominator",
            device.denominator,
            "coefficients that can be divided by the first one",
        )


def CheckLayers(layers: Sequence[LayerConfig]) -> None:
    """Checks `environment.layers`."""
    names: set[str] = set()
    previous = -math.inf
    for i, layer in enumerate(layers):
        path = f"environment.layers.{ElementName({'name': layer.name}, i)}"
        if layer.name is None or not layer.name.isidentifier() or layer.name in names:
            Refuse(
                f"environment.layers.{i}.name",
                layer.name,
                "unique, of letters, digits and _, not beginning with a digit",
            )
        names.add(layer.name)
        if not (i == 0 and layer.start == -math.inf):
            CheckNumber(f"{path}.start", layer.start, "m")
        if i > 0 and layer.start <= previous:
            Refuse(
                f"{path}.start", layer.start, f"> {previous:g} m, the previous start"
            )
        previous = layer.start
        CheckNumber(f"{path}.stiffness", layer.stiffness, "N/m", minimum=0)
        CheckNumber(f"{path}.damping", layer.damping, "N s/m", minimum=0)
        CheckNumber(f"{path}.reference", layer.reference, "m")


def CheckControllerConfig(controller: ControllerConfig, n: int) -> None:
    """Checks `controller`.

    Args:
        controller: What to check.
        n: Number of task axes.
    """
    CheckChoice("controller.kind", controller.kind, ARCHITECTURES)
    # What a kind does not use may be missing, but not wrong: comparing the
    # architectures is one override away.
    is_needed = controller.kind == "adaptive_backstepping"
    try:
        check_controller(controller, n)
    except ValueError as e:
        raise ScenarioError(f"controller.{e}") from None
    gains = {}
    for key in ("Lambda", "G1", "G2", "P"):
        value = getattr(controller, key)
        if value is not None or is_needed:
            gains[key] = CheckGain(f"controller.{key}", value, n)
    if "G1" in gains:
        # With an overflow the product is not finite and is refused as well.
        with np.errstate(all="ignore"):
            product = gains["P"] @ gains["G1"]
            product = product + product.T
        if not (
            np.all(np.isfinite(product)) and np.all(np.linalg.eigvalsh(product) > 0)
        ):
            Refuse(
                "controller.P",
                controller.P,
                "such that the symmetric part of P G1 is positive definite",
            )
    CheckNumber("controller.adaptation_rate", controller.adaptation_rate, minimum=0)
    CheckNumber("controller.leakage", controller.leakage, minimum=0)
    CheckNumber("controller.supervision", controller.supervision, minimum=0, maximum=1)
    CheckNumber("controller.minimum_psi", controller.minimum_psi, "1/kg", above=0)
    network = controller.network
    if is_needed or any(
        item is not None for item in (network.lower, network.upper, network.count)
    ):
        CheckNetworkConfig(network, n)


def CheckNetworkConfig(network: NetworkConfig, n: int) -> None:
    """Checks `controller.network`.

    Args:
        network: What to check.
        n: Number of task axes.
    """
    path = "controller.network"
    CheckVector(f"{path}.lower", network.lower, n, "m")
    CheckVector(f"{path}.upper", network.upper, n, "m")
    if not np.all(network.lower < network.upper):
        Refuse(
            f"{path}.upper",
            network.upper,
            f"> {path}.lower = {Show(network.lower)} m on every axis",
        )
    count = network.count
    if count is None or len(count) != n or min(count) < 1:
        Refuse(f"{path}.count", count, f"a list of {n} whole numbers >= 1")
    if math.prod(count) > MAX_BASIS_FUNCTIONS:
        Refuse(f"{path}.count", count, f"at most {MAX_BASIS_FUNCTIONS} in all")
    CheckNumber(f"{path}.width", network.width, "lattice spacings", above=0)


def CheckSimulatorConfig(simulator: SimulatorConfig) -> None:
    """Checks `simulator`.

    Args:
        simulator: What to check.
    """
    CheckChoice(
        "simulator.integration_scheme",
        simulator.integration_scheme,
        INTEGRATION_SCHEMES,
    )
    # Below 1e-14 no step passes the error test.
    CheckNumber("simulator.accuracy", simulator.accuracy, minimum=1e-14)
    CheckNumber(
        "simulator.max_step_size",
        simulator.max_step_size,
        "s",
        minimum=SHORTEST_TIME,
    )
    if simulator.start_time != 0:
        Refuse("simulator.start_time", simulator.start_time, "0 s")
    CheckNumber(
        "simulator.target_realtime_rate", simulator.target_realtime_rate, minimum=0
    )
