"""Shapes of a robot, and their poses at given joint positions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Capsule, Rgba, Role, SceneGraph, Shape
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from scipy.optimize import least_squares

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.blocks.robots import PlantRobotConfig, RobotConfig
from teleop_drake.model.blocks.robots.base import TellingShapes
from teleop_drake.model.blocks.robots.inverse_kinematics import TOOL, ToolJacobian

# Radius of the sticks that replace links without shapes, as a share of the longest.
_STICK = 0.015


@dataclass(frozen=True, kw_only=True)
class Part:
    """One shape of a robot.

    Attributes:
        name: A unique name of letters, digits and _.
        body: The name of the body that it is fixed to.
        shape: The shape.
        X_BG: Its pose in the body's frame.
        rgba: Its colour in the model; None if the model sets none.
    """

    name: str
    body: str
    shape: Shape
    X_BG: RigidTransform
    rgba: Rgba | None = None


class RobotVisuals:
    """The shapes of a robot and its kinematics, from a second plant.

    The simulated plant has no shapes, which makes it faster. If the model has no
    shapes, its links are drawn as sticks between the joints. A robot that is no plant
    has neither shapes nor joints; only the point of its tool is drawn.

    Attributes:
        parts: The shapes.
        start_q: Joint positions at the start of the task (nq).
    """

    def __init__(self, robot: RobotConfig):
        start = np.array(robot.start, dtype=float)
        num_axes = min(start.size, 3)
        self._plant: MultibodyPlant | None = None
        self.parts: list[Part] = []
        self.start_q = np.zeros(0)
        self._rest = np.zeros(3 - num_axes)
        if not isinstance(robot, PlantRobotConfig):
            return
        scene_graph = SceneGraph()
        with TellingShapes(scene_graph):
            self._plant = robot.LoadPlant()
        self._context = self._plant.CreateDefaultContext()
        self.start_q = np.asarray(robot.JointPositions(start))
        # Coordinates that are no task axes, such as the height of a planar arm.
        self._rest = self.Tool(self.start_q)[num_axes:]
        self.parts = _Shapes(self._plant, scene_graph) or _Sticks(self._plant)

    def InSpace(self, p_WT: ArrayLike) -> Array:
        """Returns a point of the task as a point in space (3), m.

        Args:
            p_WT: The point along the task axes, m (n).
        """
        return np.concatenate([np.asarray(p_WT)[:3], self._rest])

    def Tool(self, q: ArrayLike) -> Array:
        """Returns the position of the tool in space (3), m."""
        assert self._plant is not None
        self._plant.SetPositions(self._context, q)
        pose = self._plant.GetFrameByName(TOOL).CalcPoseInWorld(self._context)
        return np.array(pose.translation())

    def BodyPoses(self, q: ArrayLike) -> dict[str, RigidTransform]:
        """Returns the poses in the world of the moving bodies with shapes, by name."""
        if self._plant is None:
            return {}
        self._plant.SetPositions(self._context, q)
        names = dict.fromkeys(part.body for part in self.parts)
        return {
            name: self._plant.GetBodyByName(name).EvalPoseInWorld(self._context)
            for name in names
            if name != self._plant.world_body().name()
        }

    def Pose(self, p_WT: ArrayLike, q: ArrayLike) -> Array:
        """Returns joint positions with the tool at a point, near given ones (nq).

        If the point is out of reach, the tool is brought close to it. For a robot that
        is no plant, the given joint positions are returned.

        Args:
            p_WT: The point along the task axes, m (n).
            q: The joint positions from which the search starts (nq).
        """
        plant = self._plant
        if plant is None:
            return np.array(q, dtype=float)
        p = np.asarray(p_WT, dtype=float)[:3]

        def Error(q: Array) -> Array:
            return self.Tool(q)[: p.size] - p

        def Jacobian(q: Array) -> Array:
            plant.SetPositions(self._context, q)
            return ToolJacobian(plant, self._context, p.size)

        return np.asarray(least_squares(Error, q, Jacobian, xtol=1e-12, gtol=1e-12).x)


def _Shapes(plant: MultibodyPlant, scene_graph: SceneGraph) -> list[Part]:
    """Returns the illustration shapes of a plant; none if it registered none."""
    if not plant.geometry_source_is_registered():
        return []
    inspector = scene_graph.model_inspector()
    parts = []
    for i, geometry in enumerate(inspector.GetAllGeometryIds(Role.kIllustration)):
        frame = inspector.GetFrameId(geometry)
        properties = inspector.GetIllustrationProperties(geometry)
        parts.append(
            Part(
                name=f"shape_{i}",
                body=plant.GetBodyFromFrameId(frame).name(),
                shape=inspector.GetShape(geometry),
                X_BG=inspector.GetPoseInFrame(geometry),
                # GetPropertyOrDefault() of newer versions of Drake takes no None.
                rgba=properties.GetProperty("phong", "diffuse")
                if properties.HasProperty("phong", "diffuse")
                else None,
            )
        )
    return parts


def _Sticks(plant: MultibodyPlant) -> list[Part]:
    """Returns a stick along each link, to the next joint or to the tool."""
    ends: list[tuple[str, Array]] = []
    for i in plant.GetJointIndices():
        joint = plant.get_joint(i)
        parent = joint.parent_body()
        X_BF = joint.frame_on_parent().GetFixedPoseInBodyFrame()
        ends.append((parent.name(), np.array(X_BF.translation())))
    sizes = [np.linalg.norm(p) for _, p in ends]
    radius = _STICK * max(sizes, default=0.0)
    return [
        Part(
            name=f"stick_{i}",
            body=body,
            shape=Capsule(radius=radius, length=size),
            X_BG=AlongZ(p / 2, p),
        )
        for i, ((body, p), size) in enumerate(zip(ends, sizes, strict=True))
        if size > radius
    ]


def InSpace(vector: ArrayLike) -> Array:
    """Returns a vector along the task axes (n) as a vector in space (3)."""
    vector = np.asarray(vector, dtype=float)[:3]
    return np.pad(vector, (0, 3 - vector.size))


def AlongZ(p: ArrayLike, direction: Sequence[float] | Array) -> RigidTransform:
    """Returns a pose at a point with its z axis along a direction."""
    R = RotationMatrix.MakeFromOneVector(np.asarray(direction, dtype=float), 2)
    return RigidTransform(R, np.asarray(p, dtype=float))
