"""The parts of a scenario that have no folder: controller, tracking, solver.

Each is a dataclass, with its unit and where its default is from beside every field. Its
checks raise a ScenarioError that names the first bad field, its value and what is
allowed.
"""

from dataclasses import field, fields
from typing import Any

import numpy as np
from pydrake.systems.analysis import GetIntegrationSchemes, SimulatorConfig

from teleop_drake.blocks.architectures import (
    ARCHITECTURE_KINDS,
    ARCHITECTURES,
    AdaptiveBacksteppingConfig,
    ArchitectureConfig,
    DampedForceConfig,
    FourChannelConfig,
    ProportionalDampingConfig,
    SmithPredictorConfig,
    TimeDomainPassivityConfig,
    WaveVariablesConfig,
)
from teleop_drake.blocks.architectures.adaptive_backstepping import (
    BacksteppingParameters,
    NetworkConfig,
)
from teleop_drake.blocks.architectures.robust_backstepping import (
    RobustBacksteppingConfig,
    RobustTermsConfig,
)
from teleop_drake.blocks.channels.base import SHORTEST_TIME
from teleop_drake.blocks.robots import RobotConfig
from teleop_drake.scenario.tree import FromTree
from teleop_drake.validation import (
    REQUIRED,
    CheckChoice,
    CheckNumber,
    CheckVector,
    Config,
    FixedFields,
    GainField,
    GainMatrix,
    Number,
    Refuse,
    ScenarioError,
    Show,
    Within,
)

TRACKING_CONTROLLERS = ("network_tracking",)
"""Every kind of controller of a TrackingScenario."""

DISTURBANCES = ("linear", "coupled")
"""Every kind of disturbance of a TrackingScenario."""

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


@Config
class _ChosenKind(FixedFields):
    """The choice of a control architecture; it stands first in a scenario."""

    # One of ARCHITECTURES, or module:Class of your own.
    kind: str = REQUIRED


@Config
class ControllerConfig(BacksteppingParameters, _ChosenKind):
    """The control architecture.

    `adaptive_backstepping` uses the parameters up to `network`, `robust_backstepping`
    these and `robust`, `direct_force` none, each of the others the field of its name,
    and one of your own `parameters`. A gain is a number (times the identity) or an
    n x n matrix.
    """

    robust: RobustTermsConfig = field(default_factory=RobustTermsConfig)
    damped_force: DampedForceConfig = field(default_factory=DampedForceConfig)
    wave_variables: WaveVariablesConfig = field(default_factory=WaveVariablesConfig)
    time_domain_passivity: TimeDomainPassivityConfig = field(
        default_factory=TimeDomainPassivityConfig
    )
    proportional_damping: ProportionalDampingConfig = field(
        default_factory=ProportionalDampingConfig
    )
    four_channel: FourChannelConfig = field(default_factory=FourChannelConfig)
    smith_predictor: SmithPredictorConfig = field(default_factory=SmithPredictorConfig)
    # The fields of an architecture of your own.
    parameters: dict[str, Any] = field(default_factory=dict)

    @property
    def path(self) -> str:
        """The place in a scenario of what the architecture of this kind has to say."""
        if self.kind not in ARCHITECTURES:
            return "controller.parameters"
        return f"controller.{self.kind}" if hasattr(self, self.kind) else "controller"

    @property
    def is_backstepping(self) -> bool:
        """Whether this kind uses the parameters up to `network`."""
        return self.kind in (
            AdaptiveBacksteppingConfig.kind,
            RobustBacksteppingConfig.kind,
        )

    def Chosen(self) -> ArchitectureConfig:
        """Returns the architecture that `kind` names.

        Raises:
            ScenarioError: If there is none of that name, or its parameters are unknown.
        """
        kind = ARCHITECTURE_KINDS.Find(self.kind, "controller.kind")
        if self.is_backstepping:
            assert issubclass(kind, AdaptiveBacksteppingConfig)
            return kind.Of(self)
        if self.kind in ARCHITECTURES:
            section: ArchitectureConfig = getattr(self, self.kind, kind())
            return section
        with Within("controller.parameters"):
            return FromTree(self.parameters, kind)

    def Check(self, num_axes: int) -> None:
        """Checks every field, also those that this kind does not use."""
        chosen = self.Chosen()
        for item in fields(self):
            section = getattr(self, item.name)
            if isinstance(section, ArchitectureConfig) and section is not chosen:
                section.Check(f"controller.{item.name}", num_axes)
        self.CheckParameters("controller", num_axes, is_needed=False)
        self.robust.CheckNumbers("controller.robust")
        chosen.Check(self.path, num_axes)


@Config
class TrajectoryConfig(FixedFields):
    """r_d(t) = centre + amplitude sin(frequency t + phase) (thesis eq. 3.28)."""

    # m, n entries.
    centre: np.ndarray = REQUIRED
    # m, n entries; the whole line is in reach of the robot.
    amplitude: np.ndarray = REQUIRED
    # rad/s, 0 to MAX_FREQUENCY.
    frequency: float = Number(1.0, "rad/s", minimum=0, maximum=MAX_FREQUENCY)
    # rad, -1000 to 1000: of a larger one, too few digits are left.
    phase: float = Number(0.0, "rad", minimum=-1000, maximum=1000)

    def Check(self, robot: RobotConfig) -> None:
        """Checks every field, and whether the robot reaches the whole line."""
        CheckVector("trajectory.centre", self.centre, robot.num_axes, "m")
        CheckVector("trajectory.amplitude", self.amplitude, robot.num_axes, "m")
        self.CheckNumbers("trajectory")
        # The farthest point is an end. The nearest may be inside.
        with np.errstate(all="ignore"):
            nearest = -(self.centre @ self.amplitude) / (
                self.amplitude @ self.amplitude
            )
        for share in (-1.0, 1.0, np.clip(np.nan_to_num(nearest), -1, 1)):
            try:
                robot.JointPositions(self.centre + share * self.amplitude)
            except ScenarioError as e:
                reason = str(e).removeprefix("start = ")
                raise ScenarioError(
                    f"trajectory.amplitude = {Show(self.amplitude)}: must keep the "
                    f"trajectory in reach ({reason})"
                ) from None


@Config
class DisturbanceConfig(FixedFields):
    """The unknown force F_e on the tool (thesis eq. 3.7, 3.8)."""

    # One of DISTURBANCES; coupled needs n = 2.
    kind: str = REQUIRED
    # K, N/m; a number (times the identity) or an n x n matrix.
    gain: np.ndarray | float = REQUIRED

    def Check(self, num_axes: int) -> None:
        """Checks both fields."""
        CheckChoice("disturbance.kind", self.kind, DISTURBANCES)
        n = num_axes
        gain = np.asarray(self.gain, float)  # Of null, it is NaN.
        if not np.isfinite(gain).all() or GainMatrix(gain, n).shape != (n, n):
            allowed = f"a finite number or {n} x {n} matrix (N/m)"
            Refuse("disturbance.gain", self.gain, allowed)


@Config
class TrackingControllerConfig(FixedFields):
    """The controller of chapter 3. A gain is a number or an n x n matrix."""

    # One of TRACKING_CONTROLLERS.
    kind: str = REQUIRED
    # Weight of the position error in s, 1/s; symmetric positive definite (eq. 3.11).
    Lambda: np.ndarray | float = GainField(REQUIRED)
    # Gain on s, 1/s; symmetric positive definite (eq. 3.18).
    G1: np.ndarray | float = GainField(REQUIRED)
    # beta, >= 0 (eq. 3.19); 0 switches the network off.
    adaptation_rate: float = Number(REQUIRED, minimum=0)
    # nu, >= 0 (eq. 3.27).
    leakage: float = Number(REQUIRED, minimum=0)
    network: NetworkConfig = field(default_factory=NetworkConfig)

    def Check(self, num_axes: int) -> None:
        """Checks every field."""
        CheckChoice("controller.kind", self.kind, TRACKING_CONTROLLERS)
        self.CheckGains("controller", num_axes)
        self.CheckNumbers("controller")
        self.network.Check("controller.network", num_axes)
        if self.network.has_velocity:
            allowed = "position, of which the network of chapter 3 is a function"
            Refuse("controller.network.inputs", self.network.inputs, allowed)


def DefaultSimulator() -> SimulatorConfig:
    """Returns the solver of a scenario that says nothing of it."""
    # Dormand-Prince 5(4), the thesis's ode45. The tolerance is absolute in Drake.
    return SimulatorConfig(
        integration_scheme="runge_kutta5",
        use_error_control=True,
        accuracy=1e-8,
        max_step_size=0.005,
    )


def CheckSimulatorConfig(simulator: SimulatorConfig) -> None:
    """Checks `simulator`."""
    scheme = simulator.integration_scheme
    CheckChoice("simulator.integration_scheme", scheme, INTEGRATION_SCHEMES)
    # Below 1e-14 no step passes the error test.
    CheckNumber("simulator.accuracy", simulator.accuracy, minimum=1e-14)
    step = simulator.max_step_size
    rate = simulator.target_realtime_rate
    CheckNumber("simulator.max_step_size", step, "s", minimum=SHORTEST_TIME)
    if simulator.start_time != 0:
        Refuse("simulator.start_time", simulator.start_time, "0 s")
    CheckNumber("simulator.target_realtime_rate", rate, minimum=0)
