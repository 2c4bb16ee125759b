"""The sections of a scenario for the controller, the tracking task and the solver.

Each section is a dataclass. A comment at each field states its unit and the source of
its default. Check() raises a ScenarioError with the first invalid field, its value and
the allowed values.
"""

from dataclasses import field, fields

import numpy as np
from pydrake.systems.analysis import GetIntegrationSchemes, SimulatorConfig

from teleop_drake.loops.delays.base import SHORTEST_TIME
from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import (
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
from teleop_drake.model.blocks.architectures import (
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
from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    BacksteppingParameters,
    NetworkConfig,
)
from teleop_drake.model.blocks.architectures.robust_backstepping import (
    RobustBacksteppingConfig,
    RobustTermsConfig,
)
from teleop_drake.model.blocks.robots import RobotConfig
from teleop_drake.model.scenario.tree import FromTree

TRACKING_CONTROLLERS = ("network_tracking",)
"""The kinds of controllers of a TrackingScenario."""

DISTURBANCES = ("linear", "coupled")
"""The kinds of disturbances of a TrackingScenario."""

MAX_FREQUENCY = 1000.0
"""Highest frequency of a trajectory in rad/s."""

INTEGRATION_SCHEMES = tuple(
    # cenic requires a MultibodyPlant named `plant` at the top of the diagram.
    # velocity_implicit_euler assumes that all q of the state come first, then all v and
    # z. A Diagram has the q, v and z of each system together, so that the results are
    # wrong without an error.
    scheme
    for scheme in GetIntegrationSchemes()
    if scheme not in ("cenic", "velocity_implicit_euler")
)
"""Drake's integration schemes that can simulate a teleoperator."""


@Config
class _ChosenKind(FixedFields):
    """The kind of a control architecture, the first field of the section."""

    # One of ARCHITECTURES, or module:Class of your own architecture.
    kind: str = REQUIRED


@Config
class ControllerConfig(BacksteppingParameters, _ChosenKind):
    """The control architecture.

    `adaptive_backstepping` uses the parameters up to `network`, and
    `robust_backstepping` also uses `robust`. `direct_force` has no parameters. Each of
    the other kinds uses the field of its name, and your own kind uses `parameters`. A
    gain is a number (times the identity) or an n x n matrix.
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
    # The fields of your own architecture.
    parameters: Record = field(default_factory=dict)

    @property
    def path(self) -> str:
        """The dotted path of the section with the parameters of this kind."""
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
        """Returns the config of the architecture that `kind` names.

        Raises:
            ScenarioError: If the kind or one of its parameters is unknown.
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
        """Checks every field, including those that this kind does not use."""
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
    # m, n entries; the robot must reach the whole line.
    amplitude: np.ndarray = REQUIRED
    # rad/s, 0 to MAX_FREQUENCY.
    frequency: float = Number(1.0, "rad/s", minimum=0, maximum=MAX_FREQUENCY)
    # rad, -1000 to 1000; larger angles lose too many digits.
    phase: float = Number(0.0, "rad", minimum=-1000, maximum=1000)

    def Check(self, robot: RobotConfig) -> None:
        """Checks every field, and whether the robot reaches the whole line."""
        CheckVector("trajectory.centre", self.centre, robot.num_axes, "m")
        CheckVector("trajectory.amplitude", self.amplitude, robot.num_axes, "m")
        self.CheckNumbers("trajectory")
        # The point farthest from the robot is an end of the line. The nearest one may
        # be inside.
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

    # One of DISTURBANCES; coupled requires n = 2.
    kind: str = REQUIRED
    # K, N/m; a number (times the identity) or an n x n matrix.
    gain: np.ndarray | float = REQUIRED

    def Check(self, num_axes: int) -> None:
        """Checks both fields."""
        CheckChoice("disturbance.kind", self.kind, DISTURBANCES)
        n = num_axes
        gain = np.asarray(self.gain, float)  # Null becomes NaN.
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


def CheckSimulatorConfig(simulator: SimulatorConfig) -> None:
    """Checks the section `simulator` of a scenario.

    Raises:
        ScenarioError: If a field is not allowed.
    """
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
