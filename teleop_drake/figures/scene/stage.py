"""Stage of the scene: directions, scale, camera, and the slabs of material."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from teleop_drake.environments import CONTACT, PUNCTURE, FindSurface, Surface
from teleop_drake.figures.scene.visuals import RobotVisuals
from teleop_drake.figures.style import GREY

Array = NDArray[np.float64]

Colour = tuple[str, float]
"""Colour and opacity."""

ROOT = "/teleop"
"""Path of everything that the package draws."""

SCENE = f"{ROOT}/scale/world"
"""Path in which lengths are metres and axes are the robot's world."""

# Width of what is shown in Meshcat's units. Its camera sees nothing nearer than a
# hundredth of one, and tasks are as small as millimetres.
_SHOWN_WIDTH = 2.0

# Shares of the shown width: the hand's height above the tool, the distance of one run
# from the next one, and the margins before the start and behind the last surface.
_HAND, _PITCH = 0.2, 0.42
_BEFORE, _BEHIND = 0.25, 0.3

# Shares of the shown width: half of the slabs' depth, and how far they reach beyond
# the tool and the hand.
_HALF_DEPTH, _OVERLAP = 0.13, 0.07

# How much further than the last surface the tool is seen, as a share of the way there:
# at most, if it is hard, and if there is no hard one.
_STOPPED, _FREE = 0.5, 4.0

# Least width of what the tool does, as a share of its distance from the robot's base:
# with one or two axes, and in space, where the arm beside the tool tells more.
_LEAST_SHARE, _LEAST_SHARE_IN_SPACE = 0.2, 0.8

_FIELD_OF_VIEW = 30.0  # degrees

_LIGHTS = {
    "PointLightNegativeX": 0.0,
    "PointLightPositiveX": 0.0,
    "AmbientLight": 1.3,
    "FillLight": 2.2,
}

# Materials, from nothing to what is behind a contact surface.
_EMPTY = ("#56B4E9", 0.05)
_SOFT = ("#E69F00", 0.22)
_HARD = (GREY, 0.45)


@dataclass(frozen=True, kw_only=True)
class Stage:
    """Directions and sizes of a scene, in the robot's world.

    Attributes:
        centre: Of what is shown of the first run (3), m.
        forward: Unit vector along which the tool goes (3); to the right in the picture.
        up: Unit vector from the tool to the hand (3); upwards in the picture.
        width: Of what is shown along `forward`, m.
        num_runs: Number of runs, one below the other.
        hand_height: Of the hand above the tool, as a share of the width.
    """

    centre: Array
    forward: Array
    up: Array
    width: float
    num_runs: int = 1
    hand_height: float = _HAND

    @property
    def hand(self) -> Array:
        """From the tool to the hand that feels it (3), m."""
        return self.up * (self.hand_height * self.width)

    @property
    def backward(self) -> Array:
        """From the lane of the return packets to that of the forward packets (3), m."""
        return self.forward * (-0.06 * self.width)

    def Offset(self, run: int) -> Array:
        """Returns how far a run is drawn from its place in the world (3), m."""
        return self.up * (-_PITCH * self.width * run)

    @property
    def X_SW(self) -> RigidTransform:
        """Pose of the robot's world in the stage, whose axes are x forward and z up.

        The position is that of the stage's centre.
        """
        R = np.array([self.forward, np.cross(self.up, self.forward), self.up])
        return RigidTransform(RotationMatrix(R), -R @ self.centre)

    def SetUpView(self, meshcat: Meshcat) -> None:
        """Places camera and lights, and what everything else is drawn in."""
        meshcat.Delete(ROOT)
        scale = _SHOWN_WIDTH / self.width
        meshcat.SetProperty(f"{ROOT}/scale", "scale", [scale] * 3)
        meshcat.SetTransform(SCENE, self.X_SW)
        for path in ("/Grid", "/Axes"):
            meshcat.SetProperty(path, "visible", False)
        meshcat.SetProperty("/Background/<object>", "top_color", [1.0, 1.0, 1.0])
        meshcat.SetProperty("/Background/<object>", "bottom_color", [0.88, 0.9, 0.92])
        meshcat.SetCamera(
            Meshcat.PerspectiveCamera(
                fov=_FIELD_OF_VIEW, aspect=1.0, near=0.05, far=200.0
            )
        )
        # Light from behind the camera, without a lamp that stands in the scene.
        for name, intensity in _LIGHTS.items():
            meshcat.SetProperty(f"/Lights/{name}/<object>", "intensity", intensity)
        meshcat.SetProperty("/Lights/FillLight/<object>", "position", [-3.0, -8.0, 9.0])
        # In the stage's axes: the first run's floors and those of the runs below it.
        below = _PITCH * (self.num_runs - 1)
        tall = (self.hand_height + 2 * _OVERLAP + below) * _SHOWN_WIDTH
        middle = (self.hand_height - below) / 2 * _SHOWN_WIDTH
        shown = max(tall, 0.62 * _SHOWN_WIDTH)
        distance = 0.62 * shown / np.tan(np.radians(_FIELD_OF_VIEW / 2))
        target = np.array([0.0, 0.0, middle])
        meshcat.SetCameraPose(target + distance * np.array([0.12, -0.96, 0.26]), target)

    def DrawSlabs(
        self,
        meshcat: Meshcat,
        path: str,
        visuals: RobotVisuals,
        surfaces: Sequence[Surface],
    ) -> None:
        """Draws what is behind each surface, up to the next one, as translucent slabs.

        What is hard is grey, other materials that push back are orange, and where
        nothing does there is a breath of blue. A surface that is not parallel to the
        others, or whose material is unknown, is a thin plate.
        """
        depth = 2 * _HALF_DEPTH * self.width
        height = (self.hand_height + 2 * _OVERLAP) * self.width

        def Draw(surface: Surface, box: Box, X: RigidTransform, colour: Colour) -> None:
            name = f"{path}/{surface.name}"
            meshcat.SetObject(name, box, Rgba(*to_rgb(colour[0]), colour[1]))
            meshcat.SetTransform(name, X)
            # Otherwise it hides the ghost, which is translucent as well, behind it.
            meshcat.SetProperty(f"{name}/<object>", "material.depthWrite", False)
            meshcat.SetProperty(f"{name}/<object>", "castShadow", False)

        for surface, low, high in self._Slabs(visuals, surfaces):
            material = surface.material
            is_empty = material is not None and not (
                material.stiffness or material.damping
            )
            is_hard = material is None or surface.name == CONTACT
            colour = _EMPTY if is_empty else _HARD if is_hard else _SOFT
            # In the stage's axes, which are forward, away from the camera, and up.
            x = (low + high) / 2 - self.centre @ self.forward
            middle = np.array([x, 0, self.hand_height / 2 * self.width])
            X = self.X_SW.inverse() @ RigidTransform(middle)
            Draw(surface, Box(high - low, depth, height), X, colour)
        for surface in surfaces:
            normal = visuals.Direction(surface.normal_W)
            if normal @ self.forward <= 0.99 and np.isfinite(surface.point_W).all():
                thickness = 0.01 * self.width
                R = RotationMatrix.MakeFromOneVector(normal, 0)
                point = visuals.InSpace(surface.point_W) + normal * thickness / 2
                Draw(
                    surface,
                    Box(thickness, depth, depth),
                    RigidTransform(R, point),
                    _HARD,
                )

    def SlabLabels(
        self, visuals: RobotVisuals, surfaces: Sequence[Surface]
    ) -> dict[str, Array]:
        """Returns where each material's name stands (3), m: at the top of its slab."""
        top = self.up * ((self.hand_height + _OVERLAP) * self.width)
        top += self.centre - self.forward * (self.centre @ self.forward)
        return {
            NameOf(surface): top + self.forward * ((low + high) / 2)
            for surface, low, high in self._Slabs(visuals, surfaces)
        }

    def _Slabs(
        self, visuals: RobotVisuals, surfaces: Sequence[Surface]
    ) -> list[tuple[Surface, float, float]]:
        """Returns the parallel surfaces that are seen, and where they begin and end.

        The last two are in m along the direction forward.
        """
        centre = float(self.centre @ self.forward)
        edges = (centre - self.width / 2, centre + self.width / 2)
        stacked = [
            x for x in surfaces if visuals.Direction(x.normal_W) @ self.forward > 0.99
        ]
        points = [np.clip(visuals.InSpace(x.point_W), -1e9, 1e9) for x in stacked]
        begins = [float(point @ self.forward) for point in points]
        slabs = []
        for surface, begin in zip(stacked, begins, strict=True):
            low = max(begin, edges[0])
            high = min([x for x in begins if x > begin], default=edges[1])
            high = min(high, edges[1])
            if surface.material is None:
                high = low + 0.004 * self.width
            if high > low:
                slabs.append((surface, low, high))
        return slabs


def NameOf(surface: Surface) -> str:
    """Returns the name of what is behind a surface: its material, if it is known."""
    return surface.material.name if surface.material else surface.name


def MakeStage(
    visuals: RobotVisuals,
    surfaces: Sequence[Surface],
    positions: Array,
    *,
    num_runs: int = 1,
    has_operator: bool = True,
) -> Stage:
    """Returns a stage on which a task is seen.

    Args:
        positions: Where the tool is sometime, at least at the start (N, n), m.
        num_runs: Number of runs, one below the other.
        has_operator: Whether there is a hand above the tool.
    """
    forward, finite = _Forward(visuals, surfaces, positions)
    up = np.eye(3)[2 if abs(forward[2]) < 0.7 else 0]
    up = up - forward * (up @ forward)
    up = up / np.linalg.norm(up)
    points = np.array([visuals.InSpace(p) for p in positions])
    start, along = points[0], points @ forward
    if finite:
        # The task reaches from the start to the last surface, and some further where
        # the tool does: far, if nothing hard is in its way.
        depths = [float(visuals.InSpace(x.point_W) @ forward) for x in finite]
        low, high = min(along[0], *depths), max(along[0], *depths)
        is_free = FindSurface(surfaces, CONTACT) is None
        limit = (_FREE if is_free else _STOPPED) * (high - low)
        low = max(min(low, float(along.min())), low - limit)
        high = min(max(high, float(along.max())), high + limit)
        middle = start + forward * ((low + high) / 2 - along[0])
        reach = high - low
    else:
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        reach = float(np.ptp(points, axis=0).max())
    # Nothing is seen of a robot that is so much larger than what it does.
    size = float(np.linalg.norm(start))
    is_in_space = positions.shape[1] > 2
    share = _LEAST_SHARE_IN_SPACE if is_in_space else _LEAST_SHARE
    reach = max(reach, share * size) or 1.0
    return Stage(
        centre=middle + forward * (reach * (_BEHIND - _BEFORE) / 2),
        forward=forward,
        up=up,
        width=reach * (1 + _BEFORE + _BEHIND),
        num_runs=num_runs,
        hand_height=_HAND if has_operator else 0.0,
    )


def _Forward(
    visuals: RobotVisuals, surfaces: Sequence[Surface], positions: Array
) -> tuple[Array, list[Surface]]:
    """Returns where the tool goes, into the surfaces, and the surfaces on that way."""
    finite = [x for x in surfaces if np.isfinite(x.point_W).all()]
    named = [x for name in (CONTACT, PUNCTURE) for x in finite if x.name == name]
    if not (named or finite):
        return visuals.Direction(np.eye(positions.shape[1])[0]), []
    normal_W = (named or finite)[0].normal_W
    parallel = [x for x in finite if x.normal_W @ normal_W > 0.99]
    return visuals.Direction(normal_W), parallel
