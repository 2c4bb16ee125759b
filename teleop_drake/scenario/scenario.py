"""Scenarios: one task, its robot, channels, tissue and controller, as plain data.

A scenario is a tree of dataclasses: a `Scenario` is a teleoperation, and what has a
`trajectory` is a `TrackingScenario`. `LoadScenario` reads one from YAML, applies
overrides and validates it; `ScenarioToYaml` writes it back. Units are SI throughout.
Vectors have one entry per task axis (n = 1 for the slider, n = 2 for the planar arm).

"thesis" is P. P. Sarda, "Control of a Teleoperating Robotic Arm Subject to Time
Delays", MS thesis, The University of Texas at Arlington, 2012. A number that it does
not state is marked "assumed" or "fitted" in the scenario files.
"""

import os
from collections.abc import Sequence
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import System

from teleop_drake.arrays import Array
from teleop_drake.blocks.architectures import Facts
from teleop_drake.blocks.channels import (
    ChannelConfig,
    ConstantDelay,
    TransportChannelConfig,
)
from teleop_drake.blocks.channels.base import SHORTEST_TIME
from teleop_drake.blocks.environments import (
    CONTACT,
    EnvironmentConfig,
    FindSurface,
    LayersEnvironmentConfig,
    Surface,
)
from teleop_drake.blocks.environments.base import StiffnessAndDamping
from teleop_drake.blocks.operators import ConstantVelocityConfig, OperatorConfig
from teleop_drake.blocks.robots import (
    ROBOT_KINDS,
    FactsOfConfig,
    FactsOfRobot,
    PlantRobotConfig,
    RobotConfig,
)
from teleop_drake.blocks.systems.actuator import ActuatorConfig
from teleop_drake.blocks.systems.haptic_device import HapticDeviceConfig
from teleop_drake.blocks.systems.sampled_sensor import SensorConfig
from teleop_drake.kinds import KindConfig
from teleop_drake.scenario.config import (
    CheckSimulatorConfig,
    ControllerConfig,
    DefaultSimulator,
    DisturbanceConfig,
    TrackingControllerConfig,
    TrajectoryConfig,
)
from teleop_drake.scenario.overrides import CHANNELS, FieldsOf, GetPath
from teleop_drake.scenario.tree import FromTree, ToTree
from teleop_drake.scenario.yaml_text import DumpYaml
from teleop_drake.validation import (
    REQUIRED,
    CheckVector,
    Choices,
    Config,
    FixedFields,
    IsGiven,
    Number,
    Refuse,
    Show,
    Within,
)

# With more, joints move faster than any step of the solver, m/s^2.
_MOST_GRAVITY = 1000.0

# Farther away, a small motion is lost in the rounding of the position, m.
_FARTHEST_START = 1e6


@Config
class _ScenarioBase(FixedFields):
    """What every scenario has."""

    # Short name; the file's stem where the file gives none.
    name: str = ""
    # A title in words for pages and `teleop-drake list`; empty: the name.
    title: str = ""
    # One sentence for `teleop-drake list`.
    description: str = ""
    # Two sentences for a page: what happens, and what to change.
    story: str = ""
    # Where the task comes from.
    source: str = ""
    # `module:Class` of a task of one's own, which derives from tasks.Task; null: the
    # task of this class of scenarios.
    task: str | None = None
    # Simulated time.
    duration: float = Number(REQUIRED, "s", minimum=SHORTEST_TIME)
    robot: RobotConfig = REQUIRED

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _ScenarioBase):
            return NotImplemented
        return ScenarioToYaml(self) == ScenarioToYaml(other)

    # Mutable, so not hashable.
    __hash__ = None  # type: ignore[assignment]

    @property
    def num_axes(self) -> int:
        """Number of task axes n, the robot's."""
        return self.robot.num_axes

    def Value(self, dotted: str) -> Any:
        """Returns the value of a field as plain data.

        Args:
            dotted: The path of the field, such as `environment.layers.bone.stiffness`,
                or a key of ALIASES, which stands for the first of its fields.

        Raises:
            ScenarioError: If there is no such field.
        """
        return GetPath(ToTree(self), FieldsOf(dotted)[0])

    def Validate(self) -> None:
        """Checks every field.

        Raises:
            ScenarioError: naming the first bad field, its value and what is allowed.
        """
        # The round trip checks the types, and leaves arrays where a user who edits a
        # scenario in Python may have put lists.
        FromTree(ToTree(self), type(self))._Check()

    def _Check(self) -> None:
        """Checks the values, which have the right types."""
        if not self.name or not self.name.isprintable() or {"/", "\\"} & {*self.name}:
            Refuse("name", self.name, "one line of text without / and \\")
        self.CheckNumbers()
        if not IsGiven(self.robot):
            ROBOT_KINDS.Find(None, "robot.model")
        self.robot.Check("robot")


@Config
class Scenario(_ScenarioBase):
    """One simulation of a teleoperation, completely described.

    Two scenarios are equal when every field is. Fields may be edited in Python, with
    anything that numpy.asarray takes for a vector; call `Validate` afterwards.
    """

    surgeon: OperatorConfig = field(default_factory=ConstantVelocityConfig)
    haptic_device: HapticDeviceConfig = field(default_factory=HapticDeviceConfig)
    forward_channel: ChannelConfig = field(default_factory=TransportChannelConfig)
    return_channel: ChannelConfig = field(default_factory=TransportChannelConfig)
    environment: EnvironmentConfig = field(default_factory=LayersEnvironmentConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    # Between the law and the robot; the thesis has neither.
    actuator: ActuatorConfig = field(default_factory=ActuatorConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    # The run ends as diverged when |v_WT| exceeds this many times |v_d|. Assumed.
    divergence_speed_ratio: float = Number(5.0, above=1, maximum=1000)
    # Drake's own. Steps are shorter than max_step_size where the smallest delay is;
    # start_time is 0.
    simulator: SimulatorConfig = field(default_factory=DefaultSimulator)

    def Value(self, dotted: str) -> Any:
        """Returns the value of a field; see _ScenarioBase.

        The parameters of a controller of a user's own have their defaults.
        """
        if not dotted.startswith("controller.parameters."):
            return super().Value(dotted)
        parameters = ToTree(self.controller.Chosen())
        return GetPath({"controller": {"parameters": parameters}}, dotted)

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns the surfaces of the environment, none if it tells none."""
        return self.environment.Surfaces(self.robot.start)

    def FindSurface(self, name: str) -> Surface | None:
        """Returns a surface, `contact` for instance; None: there is none so named."""
        return FindSurface(self.Surfaces(), name)

    def Facts(
        self, robot: System | None = None, environment: System | None = None
    ) -> Facts:
        """Returns what the defaults of an architecture derive from.

        Args:
            robot: The robot in the diagram; None: the scenario's own.
            environment: The environment in the diagram; None: the scenario's own.
        """
        start = np.asarray(self.robot.start, dtype=float)
        told = FactsOfConfig(self.robot) if robot is None else FactsOfRobot(robot)
        stiffness, D_e = (
            self.environment.StiffnessAndDamping(start)
            if environment is None
            else StiffnessAndDamping(environment, start)
        )
        return Facts(
            start=start,
            velocity=np.asarray(self.surgeon.velocity, dtype=float),
            haptic_device=self.haptic_device,
            forward_channel=self.forward_channel,
            return_channel=self.return_channel,
            duration=self.duration,
            inertia=told.inertia,
            robot_damping=told.damping,
            environment_stiffness=stiffness,
            environment_damping=D_e,
        )

    def ConstantDelays(self) -> list[ConstantDelay]:
        """Returns the forward and the return delay that stand for the channels."""
        return [
            getattr(self, path).AsConstantDelay(path, self.duration)
            for path in CHANNELS
        ]

    @property
    def initial_psi(self) -> Array:
        """Psi at time 0 in 1/kg (n, n); see BacksteppingParameters.InitialPsi."""
        return self.controller.InitialPsi(self.Facts())

    def _Check(self) -> None:
        """Checks the values; see _ScenarioBase."""
        super()._Check()
        n = self.num_axes
        self.surgeon.Check("surgeon", n)
        self.haptic_device.Check("haptic_device")
        # The channels, which need the duration.
        self._CheckChannels()
        # The tissue and the tool in front of it.
        with Within("environment"):
            self.environment.Check()
        CheckStart(self.robot.start, self.Surfaces())
        self.actuator.CheckNumbers("actuator")
        self.sensor.Check("sensor")
        if n == 6:
            period = self.sensor.encoder.sample_period
            if period is not None:
                ideal = "null with six axes: the rate of a rotation is not its velocity"
                Refuse("sensor.encoder.sample_period", period, ideal)
            if not self.actuator.is_ideal:
                Refuse("actuator", ToTree(self.actuator), "ideal with six axes")
        # The controller, whose defaults derive from what has been checked.
        controller = self.controller
        controller.Check(n)
        is_given = not isinstance(controller.initial_psi, str)
        has_psi = controller.is_backstepping or is_given
        if has_psi:
            controller.InitialPsi(self.Facts())
        CheckSimulatorConfig(self.simulator)

    def _CheckChannels(self) -> None:
        for path in CHANNELS:
            getattr(self, path).Check(path, self.duration)


@Config
class TrackingScenario(_ScenarioBase):
    """One simulation of the tracking task of chapter 3, completely described.

    An arm follows a trajectory while it learns a disturbance. There is neither an
    operator nor a delay. For the rest see `Scenario`.
    """

    # Acceleration of gravity along the task axes, m/s^2, n entries.
    gravity: np.ndarray = REQUIRED
    trajectory: TrajectoryConfig = field(default_factory=TrajectoryConfig)
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    controller: TrackingControllerConfig = field(
        default_factory=TrackingControllerConfig
    )
    # The run ends as diverged when |v_WT| exceeds this. Assumed.
    divergence_speed: float = Number(10.0, "m/s", above=0)
    # Drake's own; start_time is 0.
    simulator: SimulatorConfig = field(default_factory=DefaultSimulator)

    def _Check(self) -> None:
        """Checks the values; see _ScenarioBase."""
        super()._Check()
        # The controller's model has no friction, and a slider does.
        robot = self.robot
        n = self.num_axes
        if not isinstance(robot, PlantRobotConfig) or not robot.is_frictionless:
            possible = [
                x.kind for x in ROBOT_KINDS.kinds if getattr(x, "is_frictionless", 0)
            ]
            Refuse("robot.model", robot.kind, Choices(robot.kind, possible))
        CheckVector("gravity", self.gravity, n, "m/s^2")
        if np.abs(self.gravity).max() > _MOST_GRAVITY:
            Refuse("gravity", self.gravity, f"at most {_MOST_GRAVITY:g} m/s^2 in size")
        self.trajectory.Check(robot)
        self.disturbance.Check(n)
        self.controller.Check(n)
        CheckSimulatorConfig(self.simulator)


AnyScenario = Scenario | TrackingScenario
"""What LoadScenario() returns."""

ScenarioLike = AnyScenario | str | os.PathLike[str]
"""A scenario, or what LoadScenario() loads one from; simulate() and others take it."""


def ScenarioFiles(scenario: _ScenarioBase) -> dict[str, str]:
    """Returns the files that a scenario names, by their dotted fields."""
    files = {
        f"{name}.{key}": getattr(config, key)
        for name, config in vars(scenario).items()
        if isinstance(config, KindConfig)
        for key in config.file_fields
    }
    return {dotted: file for dotted, file in files.items() if file is not None}


def ScenarioToYaml(scenario: _ScenarioBase) -> str:
    """Returns YAML text of which `LoadScenario` or `ScenarioFromYaml` makes its equal.

    The text is plain ASCII, has every field, and depends on nothing but their values.
    """
    tree = ToTree(FromTree(ToTree(scenario), type(scenario)))
    return DumpYaml(tree, is_compact=True)


def CheckStart(start: ArrayLike, surfaces: Sequence[Surface]) -> None:
    """Refuses a tool that starts behind the contact surface, or too far away.

    Args:
        start: p_WT at time 0 in m (n).

    Raises:
        ScenarioError: If it does, or a surface is not one for n axes.
    """
    for surface in surfaces:
        if surface.point_W.shape != np.shape(start):
            Refuse(
                f"environment: point_W of surface {surface.name!r}",
                surface.point_W,
                f"a list of {np.size(start)} numbers (m)",
            )
    if np.abs(start).max() > _FARTHEST_START:
        Refuse("robot.start", start, f"within {_FARTHEST_START:g} m of the origin")
    contact = FindSurface(surfaces, CONTACT)
    if contact is None or contact.Depth(start) < 0:
        return
    normal = contact.normal_W
    if normal[0] == 1:
        where = f"x < {contact.point_W[0]:g} m"
    else:
        where = f"{Show(normal)} . p < {contact.Along(contact.point_W):g} m"
    Refuse("robot.start", start, f"in front of the contact surface ({where})")
