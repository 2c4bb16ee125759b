"""Base classes of the robots' configs, and the plants of their model files."""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, System

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckVector,
    Config,
    Refuse,
    Within,
)
from teleop_drake.model.blocks.robots.inverse_kinematics import (
    SolveInverseKinematics,
    ToolRotation,
)
from teleop_drake.model.blocks.robots.robot_diagram import JointDrive, MakeRobotDiagram
from teleop_drake.model.kinds import KindConfig
from teleop_drake.model.laws.task_space import MAX_ROTATION, rotated

# The SceneGraph with which new plants register their shapes; None: with none.
_SCENE_GRAPH: ContextVar[SceneGraph | None] = ContextVar("scene_graph", default=None)


def ModelText(name: str) -> str:
    """Returns the text of the SDF model of this name in the package."""
    file = Path(__file__).parents[2] / "models" / f"{name}.sdf"
    return file.read_text(encoding="utf-8")


def ReadModel(name: str) -> ElementTree.Element:
    """Returns the SDF model of this name in the package."""
    return ElementTree.fromstring(ModelText(name))


@contextlib.contextmanager
def TellingShapes(scene_graph: SceneGraph) -> Iterator[None]:
    """Makes new plants register their shapes with a SceneGraph, for a picture.

    Outside of this context, plants register none, which would only slow down a
    simulation.
    """
    token = _SCENE_GRAPH.set(scene_graph)
    try:
        yield
    finally:
        _SCENE_GRAPH.reset(token)


@contextlib.contextmanager
def NewPlant(gravity: ArrayLike | None = None) -> Iterator[MultibodyPlant]:
    """Yields a new continuous plant named `plant`, and finalizes it at the end.

    Args:
        gravity: Acceleration of gravity along the first axes of the world, m/s^2 (1 to
            3); None: Drake's default, along -z.
    """
    plant = MultibodyPlant(time_step=0.0)
    plant.set_name("plant")
    scene_graph = _SCENE_GRAPH.get()
    if scene_graph is not None:
        plant.RegisterAsSourceForSceneGraph(scene_graph)
    yield plant
    if gravity is not None:
        gravity_W = np.zeros(3)
        gravity_W[: np.size(gravity)] = gravity
        plant.mutable_gravity_field().set_gravity_vector(gravity_W)
    plant.Finalize()


def LoadModel(
    model: ElementTree.Element, gravity: ArrayLike | None = None
) -> MultibodyPlant:
    """Returns the plant of an SDF model.

    Args:
        model: The root element of the model, such as ReadModel() returns.
        gravity: Acceleration of gravity along the first axes of the world, m/s^2 (1 to
            3); None: Drake's default, along -z.
    """
    with NewPlant(gravity) as plant:
        Parser(plant).AddModelsFromString(
            ElementTree.tostring(model, encoding="unicode"), "sdf"
        )
    return plant


@Config
class RobotConfig(KindConfig, ABC):
    """The slave robot (thesis section 2.3).

    A robot of your own derives from this class, or from PlantRobotConfig, adds its
    fields, and makes its block in MakeRobot. A scenario selects it by the name of its
    class: `model: my_module:MyRobot`.
    """

    # p_WT at time 0, m, n entries; reachable, not singular, in front of the contact
    # surface. The robot starts at rest. With six entries, the last three are the
    # rotation vector relative to the tool's rotation at the robot's posture, rad; see
    # laws.task_space.
    start: np.ndarray = REQUIRED

    @property
    def num_axes(self) -> int:
        """Number n of task axes: the first n axes of the world; 6: also about them."""
        return len(self.start)

    def Check(self, path: str) -> None:
        """Checks every field, and reads the files that they name.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        with Within(path):
            if (
                np.ndim(self.start) != 1
                or len(self.start) not in (1, 2, 3, 6)
                or not np.isfinite(np.asarray(self.start, dtype=float)).all()
            ):
                Refuse(
                    "start",
                    self.start,
                    "a list of 1, 2 or 3 finite numbers (m), or of 6",
                )
            CheckRotation(self.start)
            self.CheckNumbers()

    @abstractmethod
    def MakeRobot(self) -> System:
        """Makes the block, whose default context is at rest at `start`.

        Its ports are those of robot_diagram.MakeRobotDiagram. It must have
        control_force, environment_force, tool_position and tool_velocity, and
        tool_acceleration for a linear analysis.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def JointPositions(self, p_WT: ArrayLike) -> Array:
        """Returns q of the robot's continuous state [q; qdot] with the tool at a point.

        By default, it is the point itself, which is right for a robot whose state is
        [p_WT; v_WT].

        Raises:
            ScenarioError: If the robot does not reach the point, or is singular there.
                The message begins with `start`, the name of the field.
        """
        return np.array(p_WT, dtype=float)


@Config
class PlantRobotConfig(RobotConfig):
    """A robot that is a MultibodyPlant, driven by the forces on its tool.

    A robot of your own that derives from this class has to define LoadPlant only.

    Attributes:
        is_frictionless: Whether the plant has n joints, none of them damped, as the
            controller of chapter 3 assumes.
    """

    is_frictionless: ClassVar[bool] = False

    @abstractmethod
    def LoadPlant(self, gravity: ArrayLike | None = None) -> MultibodyPlant:
        """Returns a continuous, finalized plant named `plant` with a frame `tool`.

        Its actuators are one for each joint, in any order.

        Args:
            gravity: Acceleration of gravity along the task axes, m/s^2 (n); None: the
                robot's own.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def Posture(self, plant: MultibodyPlant) -> Array:
        """Returns the q near which joint positions are searched; here the default q."""
        return np.asarray(plant.GetDefaultPositions())

    def JointPositions(self, p_WT: ArrayLike) -> Array:
        """Returns the q nearest to the posture with the tool at a point."""
        plant = self.LoadPlant()
        r = np.asarray(p_WT, dtype=float)
        return SolveInverseKinematics(
            plant, r[:3], self.Posture(plant), self.RotationAt(plant, r)
        )

    def RotationAt(self, plant: MultibodyPlant, r: Array) -> Array | None:
        """Returns the rotation (3, 3) of the tool at a position; None: it is free."""
        if r.size < 6:
            return None
        CheckRotation(r)
        R_PT = np.stack([rotated(r[3:], e) for e in np.eye(3)]).T
        return R_PT @ ToolRotation(plant, self.Posture(plant))

    def Check(self, path: str) -> None:
        """Checks every field, loads the plant and poses it."""
        super().Check(path)
        with Within(path):
            self.JointPositions(self.start)

    def MakeRobot(self, *, gravity: ArrayLike | None = None) -> Diagram:
        """Makes the block; see robot_diagram.MakeRobotDiagram."""
        plant = self.LoadPlant(gravity)
        q = self.JointPositions(self.start)
        return MakeRobotDiagram(
            plant=plant,
            num_axes=self.num_axes,
            joint_positions=q,
            posture=self.Posture(plant),
            drive=self.MakeDrive(plant, q, gravity),
        )

    def MakeDrive(
        self, plant: MultibodyPlant, q: Array, gravity: ArrayLike | None
    ) -> JointDrive:
        """Returns the systems that drive the joints besides the task; by default, none.

        Args:
            plant: The plant of the robot.
            q: Its joint positions at the start (nq).
            gravity: As in LoadPlant().
        """
        return JointDrive()


def CheckRotation(r: Array) -> None:
    """Refuses a start whose rotation vector is longer than MAX_ROTATION."""
    if np.linalg.norm(r[3:]) > MAX_ROTATION:
        Refuse("start", r, f"turned by at most {MAX_ROTATION:g} rad from the posture")


def PointOf(p_WT: ArrayLike, num_axes: int) -> Array:
    """Returns a position of the tool as a vector; refuses other sizes than n."""
    CheckVector("start", p_WT, num_axes, "m")
    return np.array(p_WT, dtype=float)
