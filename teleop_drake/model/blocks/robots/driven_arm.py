"""Arms with a controller of their own, which compensates weight and holds a posture."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import (
    CheckChoice,
    CheckNumber,
    CheckVector,
    Config,
    Number,
    Refuse,
    Within,
)
from teleop_drake.model.blocks.robots.base import PlantRobotConfig
from teleop_drake.model.blocks.robots.inverse_kinematics import TOOL, ToolRotation
from teleop_drake.model.blocks.robots.robot_diagram import JointDrive
from teleop_drake.model.blocks.systems.gravity_compensation import GravityCompensation
from teleop_drake.model.blocks.systems.posture_hold import PostureHold
from teleop_drake.model.laws.task_space import PostureGains

HOLDS = ("none", "posture", "orientation")
"""The quantities that an arm can hold with the joints that the task leaves free."""

MAX_FREQUENCY = 1000.0
"""Highest natural frequency of the hold, rad/s."""

# The measure det A of laws.task_space below which there is damping, and the damping at
# a singular pose. Assumed. The Puma's pose in the scenarios has det A = 0.02.
_NEAR = 1e-3
_DAMPING = 1e-2


@Config
class DrivenArmConfig(PlantRobotConfig):
    """An arm whose own controller compensates its weight and holds its free joints.

    The equations are in laws.task_space, systems.gravity_compensation and
    systems.joint_friction. A robot of your own that derives from this class has to
    define LoadModel only.
    """

    default_gravity: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 0.0)

    # Joint positions near which those at the start are searched, rad or m, nq entries.
    # They select one of several poses. Null: the default of the model, usually zero.
    posture: np.ndarray | None = None
    # Acceleration of gravity along the world's axes, m/s^2, 3 entries. Null: none for
    # the model `arm`. Assumed: motors compensate the weight, as they do in most arms.
    gravity: np.ndarray | None = None
    # Whether the motors compensate the weight of the arm and of a mass
    # payload + payload_error at the tool. Assumed.
    gravity_compensation: bool = False
    # Mass at the tool's origin, kg, >= 0.
    payload: float = Number(0.0, "kg", minimum=0)
    # Mass that the gravity compensation assumes beyond the payload, kg;
    # payload + payload_error >= 0.
    payload_error: float = 0.0
    # Quantity held with the joints that the n axes of the task leave free, one of
    # HOLDS: nothing, the posture at the start, or the tool's orientation at `posture`.
    # Assumed.
    hold: str = "none"
    # Natural frequency of the hold, rad/s, > 0 to MAX_FREQUENCY. Assumed.
    hold_frequency: float = Number(10.0, "rad/s", above=0, maximum=MAX_FREQUENCY)
    # Damping ratio of the hold, 0 to 100. Assumed.
    hold_damping_ratio: float = Number(1.0, minimum=0, maximum=100)

    def Check(self, path: str) -> None:
        """Checks every field, loads the plant and poses it."""
        with Within(path):
            CheckChoice("hold", self.hold, HOLDS)
            self.CheckNumbers()
            error = self.payload_error
            payload = self.payload
            CheckNumber("payload_error", error, "kg", minimum=-payload, maximum=1000)
            if error and not self.gravity_compensation:
                Refuse("payload_error", error, "0, as nothing compensates")
        super().Check(path)

    @abstractmethod
    def LoadModel(self, gravity: ArrayLike, payload: float) -> MultibodyPlant:
        """Returns the plant with gravity in m/s^2 (1 to 3) and a payload in kg.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def LoadPlant(self, gravity: ArrayLike | None = None) -> MultibodyPlant:
        """Returns the plant; see PlantRobotConfig.LoadPlant."""
        return self.LoadModel(self._Gravity(gravity), self.payload)

    def _Gravity(self, gravity: ArrayLike | None) -> ArrayLike:
        if gravity is not None:
            return gravity
        if self.gravity is None:
            return self.default_gravity
        CheckVector("gravity", self.gravity, 3, "m/s^2")
        return self.gravity

    def Posture(self, plant: MultibodyPlant) -> Array:
        """Returns the q near which joint positions are searched (nq)."""
        if self.posture is None:
            return super().Posture(plant)
        CheckVector("posture", self.posture, plant.num_positions(), "rad or m")
        return np.asarray(self.posture, dtype=float)

    def RotationAt(self, plant: MultibodyPlant, r: Array) -> Array | None:
        """Returns the rotation (3, 3) of the tool at a position; None: it is free.

        If the orientation is held, it is the tool's rotation at the posture.
        """
        if self.hold != "orientation":
            return super().RotationAt(plant, r)
        nv = plant.num_velocities()
        if nv < self.num_axes + 3 or self.num_axes == 6:
            Refuse(
                "hold",
                self.hold,
                f"none or posture for {self.num_axes} axes and {nv} joints",
            )
        return ToolRotation(plant, self.Posture(plant))

    def MakeDrive(
        self, plant: MultibodyPlant, q: Array, gravity: ArrayLike | None
    ) -> JointDrive:
        """Returns the systems that drive the joints; see PlantRobotConfig.MakeDrive."""
        drive = JointDrive()
        if self.gravity_compensation:
            known = self.payload + self.payload_error
            model = self.LoadModel(self._Gravity(gravity), known)
            drive.gravity_compensation = GravityCompensation(model=model)
        if self.hold != "none":
            drive.hold = PostureHold(
                plant=plant,
                num_axes=self.num_axes,
                tool_name=TOOL,
                joint_positions=q,
                gains=PostureGains(
                    self.hold_frequency, self.hold_damping_ratio, _NEAR, _DAMPING
                ),
                keeps_orientation=self.hold == "orientation",
            )
        return drive


def AddPayload(plant: MultibodyPlant, mass: float) -> None:
    """Welds a point mass in kg to the tool of a plant that is not finalized."""
    if mass == 0:
        return
    tool = plant.GetFrameByName(TOOL)
    inertia = SpatialInertia(mass, np.zeros(3), UnitInertia(0, 0, 0))
    body = plant.AddRigidBody("payload", tool.model_instance(), inertia)
    plant.WeldFrames(tool, body.body_frame())
