"""Scenarios: one task, its robot, channels, tissue and controller, as plain data.

A scenario is a tree of dataclasses. A `Scenario` is a teleoperation. A scenario with a
`trajectory` is a `TrackingScenario`. `LoadScenario` reads a scenario from YAML, applies
overrides and validates it; `ScenarioToYaml` writes it. Units are SI throughout. Vectors
have one entry per task axis (n = 1 for the slider, n = 2 for the planar arm).

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

from teleop_drake.loops.delays.base import SHORTEST_TIME
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.solver import DefaultSimulator
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckKind,
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
from teleop_drake.model.blocks.architectures import Facts
from teleop_drake.model.blocks.environments import (
    CONTACT,
    EnvironmentConfig,
    FindSurface,
    Surface,
)
from teleop_drake.model.blocks.environments.base import StiffnessAndDamping
from teleop_drake.model.blocks.environments.kinds import ENVIRONMENT_KINDS
from teleop_drake.model.blocks.operators import ConstantVelocityConfig, OperatorConfig
from teleop_drake.model.blocks.robots import (
    ROBOT_KINDS,
    FactsOfConfig,
    FactsOfRobot,
    PlantRobotConfig,
    RobotConfig,
)
from teleop_drake.model.blocks.systems.actuator import ActuatorConfig
from teleop_drake.model.blocks.systems.haptic_device import HapticDeviceConfig
from teleop_drake.model.blocks.systems.sampled_sensor import SensorConfig
from teleop_drake.model.channels import ChannelConfig, ConstantDelay
from teleop_drake.model.channels.kinds import CHANNEL_KINDS
from teleop_drake.model.kinds import FileOf, KindConfig
from teleop_drake.model.scenario.config import (
    CheckSimulatorConfig,
    ControllerConfig,
    DisturbanceConfig,
    TrackingControllerConfig,
    TrajectoryConfig,
)
from teleop_drake.model.scenario.overrides import CHANNELS, FieldsOf, GetPath
from teleop_drake.model.scenario.tree import FromTree, ToTree
from teleop_drake.model.scenario.yaml_text import DumpYaml

# The largest acceleration of gravity, m/s^2. With more, joints move too fast for the
# solver's steps.
_MOST_GRAVITY = 1000.0

# The largest coordinate of the start, m. Farther away, small motions are lost in the
# rounding of the position.
_FARTHEST_START = 1e6


@Config
class _ScenarioBase(FixedFields):
    """The fields that all scenarios have."""

    # Short name; by default the stem of the file's name.
    name: str = ""
    # A title in words for pages and `teleop-drake list`; empty: the name.
    title: str = ""
    # One sentence for `teleop-drake list`.
    description: str = ""
    # Two sentences for a page: what happens, and what to change.
    story: str = ""
    # Where the task comes from.
    source: str = ""
    # `module:Class` of your own task, which derives from tasks.Task; null: the task of
    # this class of scenarios.
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
        """Number n of the robot's task axes."""
        return self.robot.num_axes

    def Value(self, dotted: str) -> Any:
        """Returns the value of a field as plain data.

        Args:
            dotted: The path of the field, such as `environment.layers.bone.stiffness`,
                or a key of ALIASES, for the first of its fields.

        Raises:
            ScenarioError: If there is no such field.
        """
        return GetPath(ToTree(self), FieldsOf(dotted)[0])

    def Validate(self) -> None:
        """Checks every field.

        Raises:
            ScenarioError: If a field is not valid. The message contains the first such
                field, its value and the allowed values.
        """
        # The round trip checks the types. In the checked copy, lists that a user has
        # assigned in Python are arrays.
        FromTree(ToTree(self), type(self))._Check()

    def _Check(self) -> None:
        """Checks the values of the fields. Their types are right."""
        if not self.name or not self.name.isprintable() or {"/", "\\"} & {*self.name}:
            Refuse("name", self.name, "one line of text without / and \\")
        self.CheckNumbers()
        if not IsGiven(self.robot):
            ROBOT_KINDS.Find(None, "robot.model")
        self.robot.Check("robot")


@Config
class Scenario(_ScenarioBase):
    """The complete description of one simulation of a teleoperation.

    Two scenarios are equal if all their fields are equal. Fields may be edited in
    Python. For a vector, assign any value that numpy.asarray() accepts. Call Validate()
    afterwards.
    """

    surgeon: OperatorConfig = field(default_factory=ConstantVelocityConfig)
    haptic_device: HapticDeviceConfig = field(default_factory=HapticDeviceConfig)
    forward_channel: ChannelConfig = field(default_factory=CHANNEL_KINDS.kinds[0])
    return_channel: ChannelConfig = field(default_factory=CHANNEL_KINDS.kinds[0])
    environment: EnvironmentConfig = field(default_factory=ENVIRONMENT_KINDS.kinds[0])
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    # Drive and sensors between the control law and the robot; the thesis has neither.
    actuator: ActuatorConfig = field(default_factory=ActuatorConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    # The run ends as diverged when |v_WT| exceeds this many times |v_d|. Assumed.
    divergence_speed_ratio: float = Number(5.0, above=1, maximum=1000)
    # Drake's config of the solver. Steps are shorter than max_step_size if the smallest
    # delay is; start_time is 0.
    simulator: SimulatorConfig = field(default_factory=DefaultSimulator)

    def Value(self, dotted: str) -> Any:
        """Returns the value of a field; see _ScenarioBase.

        Parameters of a user's controller that are not given have their defaults.
        """
        if not dotted.startswith("controller.parameters."):
            return super().Value(dotted)
        parameters = ToTree(self.controller.Chosen())
        return GetPath({"controller": {"parameters": parameters}}, dotted)

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns the surfaces that the environment declares."""
        return self.environment.Surfaces(self.robot.start)

    def FindSurface(self, name: str) -> Surface | None:
        """Returns the surface with a name, such as `contact`, or None."""
        return FindSurface(self.Surfaces(), name)

    def Facts(
        self, robot: System | None = None, environment: System | None = None
    ) -> Facts:
        """Returns the facts from which the defaults of an architecture derive.

        Args:
            robot: The robot in the diagram; by default the scenario's robot.
            environment: The environment in the diagram; by default the scenario's.
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
        """Returns the constant delays that replace the channels in linear analyses.

        Raises:
            ScenarioError: If no constant delay can stand for a channel.
        """
        for path in CHANNELS:
            fields = getattr(self, path).fields
            if getattr(self, path).FieldDelays():
                allowed = "left out: an analysis has one delay each way"
                Refuse(f"{path}.fields", list(fields), allowed)
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
        self._CheckChannels()
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
        # The controller comes last, because its defaults derive from the other fields.
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
    """The complete description of one simulation of the tracking task of chapter 3.

    An arm follows a trajectory and learns a disturbance. There is neither an operator
    nor a delay. Equality and editing of fields are as for `Scenario`.
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
    # Drake's config of the solver; start_time is 0.
    simulator: SimulatorConfig = field(default_factory=DefaultSimulator)

    def _Check(self) -> None:
        """Checks the values; see _ScenarioBase."""
        super()._Check()
        # The controller's model has no friction, so that the robot must have none.
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
"""A scenario, the name of a built-in scenario, or the path of a scenario file."""


def ScenarioFiles(scenario: _ScenarioBase) -> dict[str, str]:
    """Returns the paths of files in a scenario's fields, by the fields' dotted paths.

    Fields that are null are left out.
    """
    files = {
        f"{name}.{key}": FileOf(getattr(config, key))
        for name, config in vars(scenario).items()
        if isinstance(config, KindConfig)
        for key in config.file_fields
    }
    return {dotted: file for dotted, file in files.items() if file is not None}


def ScenarioToYaml(scenario: _ScenarioBase) -> str:
    """Returns YAML text from which an equal scenario can be loaded.

    LoadScenario() and ScenarioFromYaml() load it. The text is plain ASCII, contains
    every field, and depends only on the fields' values.
    """
    allowed = "a scenario, as LoadScenario() returns it"
    CheckKind("scenario", scenario, _ScenarioBase, allowed)
    tree = ToTree(FromTree(ToTree(scenario), type(scenario)))
    return DumpYaml(tree, is_compact=True)


def CheckStart(start: ArrayLike, surfaces: Sequence[Surface]) -> None:
    """Checks that the tool starts in front of the contact surface and not too far away.

    Args:
        start: p_WT at time 0 in m (n).
        surfaces: The surfaces of the environment.

    Raises:
        ScenarioError: If the start is not allowed, or a surface does not have n axes.
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
