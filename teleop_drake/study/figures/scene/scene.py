"""Animation of runs in Meshcat, one below the other."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.typing import ColorType
from pydrake.geometry import (
    Box,
    Cylinder,
    Meshcat,
    MeshcatAnimation,
    MeshcatCone,
    Rgba,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.blocks.environments import (
    CONTACT,
    FindSurface,
    ShownNormal,
    Surface,
)
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.study.figures.scene.visuals import AlongZ, InSpace, RobotVisuals
from teleop_drake.study.figures.selection import CheckRecordings
from teleop_drake.study.figures.style import GREY, RunColor

ROOT = "/teleop"
"""Path of all drawings of the package, in metres and the robot's world frame."""

FORCE_COLOR = "#000000"
GHOST_OPACITY = 0.35

FRAMES_PER_SECOND = 60
"""Frames of the animation per second, between which Meshcat interpolates."""

# Width of the picture in Meshcat's units. Tasks of a few millimetres are scaled up,
# because the camera shows nothing that is nearer than a hundredth of a unit.
_SHOWN_WIDTH = 2.0

# Shares of the width: the ghost's height above the robot, the distance of one run from
# the next one, the margins before the start and behind the last surface.
_GHOST = 0.2
_PITCH = 0.42
_BEFORE = 0.25
_BEHIND = 0.3

# Shares of the width: the depth of the slabs, their extent beyond tool and ghost, and
# the thickness of a surface without a known material.
_DEPTH = 0.26
_OVERLAP = 0.07
_PLATE = 0.01

# Shares of the width: the tool's radius, the longest arrow and its height above the
# tool.
_TOOL = 0.009
_ARROW = 0.3
_ABOVE = 0.04

# How far behind the last surface the tool is shown, as a share of the way there: if a
# hard surface stops it, and if none does.
_STOPPED = 0.5
_FREE = 4.0

# Least extent of the shown motion, as a share of the tool's distance from the robot's
# base: with one or two axes, and in space, where more of the arm is shown.
_LEAST_SHARE = 0.2
_LEAST_SHARE_IN_SPACE = 0.8

_FIELD_OF_VIEW = 30.0  # degrees

Looks = tuple[ColorType, float]
"""Colour and opacity."""

# Light comes from behind the camera; the lamps inside the scene are off.
_LIGHTS = {
    "PointLightNegativeX": 0.0,
    "PointLightPositiveX": 0.0,
    "AmbientLight": 1.3,
    "FillLight": 2.2,
}


@dataclass(frozen=True, kw_only=True)
class Stage:
    """The region of the robot's world that is shown of a run.

    Attributes:
        X_WS: Pose of the stage. Its x axis is along the tool's way into the surfaces
            and points to the right in the picture; z points up.
        width: Width along x, m.
        ghost_height: Height of the ghost above the robot, as a share of the width; 0
            without an operator.
    """

    X_WS: RigidTransform
    width: float
    ghost_height: float

    def Up(self, share: float) -> Array:
        """Returns an upward vector (3) whose length is a share of the width, m."""
        return np.asarray(self.X_WS.rotation().col(2) * (share * self.width))


def FindOperator(recording: TaskRecording) -> tuple[str, str] | None:
    """Returns the signals of the position felt and the force applied by an operator.

    Their first n components are along the task axes.

    Returns:
        The names of the two signals; None for a run without an operator.
    """
    if "felt_position" in recording:
        return "felt_position", "force_command"
    if "return_packet_received" in recording:  # The thesis's own packets.
        return "return_packet_received", "forward_packet_sent"
    return None


def LooksOf(surface: Surface) -> tuple[str, float]:
    """Returns colour and opacity of the material behind a surface.

    A hard or unknown material is grey. Another material is orange if it exerts a force,
    and pale blue if it does not.
    """
    material = surface.material
    if material is None or surface.name == CONTACT:
        return GREY, 0.45
    if material.stiffness or material.damping:
        return "#E69F00", 0.22
    return "#56B4E9", 0.05


def AnimateRuns(recordings: Mapping[str, TaskRecording], meshcat: Meshcat) -> Stage:
    """Draws runs in Meshcat as an animation, which Meshcat's controls play.

    The robot is solid. Above it stands the ghost: the robot as the operator feels it.
    The largest force of all runs has the longest arrow.

    Args:
        recordings: The runs by their names, the topmost first. All robots have the same
            number of axes.
        meshcat: The Meshcat to draw in. Earlier drawings of the package are deleted.

    Returns:
        The stage of the first run; those of the next runs are below it.

    Raises:
        ValueError: If there is no run, or the numbers of axes differ.
    """
    CheckRecordings(recordings)
    runs = list(recordings.values())
    robots = [RobotVisuals(run.scenario.robot) for run in runs]
    stage = _MakeStage(runs, robots[0])
    _SetUpView(meshcat, stage, len(runs))
    # All runs share the times of the frames and the scale of the arrows.
    end = max(run.time[-1] for run in runs)
    times = np.arange(np.ceil(end * FRAMES_PER_SECOND) + 1) / FRAMES_PER_SECOND
    figures = [_Figures(run, times) for run in runs]
    drawn = [force for shown in figures for _, force in shown.values()]
    largest = np.linalg.norm(np.concatenate(drawn), axis=1).max() or 1.0
    # Each run is below the previous one, with its ghost above the robot.
    animation = MeshcatAnimation(FRAMES_PER_SECOND)
    for i, (run, visuals, shown) in enumerate(zip(runs, robots, figures, strict=True)):
        path = f"{ROOT}/run_{i}"
        meshcat.SetTransform(path, RigidTransform(stage.Up(-_PITCH * i)))
        _AddSlabs(meshcat, f"{path}/environment", stage, run.surfaces)
        guesses = np.tile(visuals.start_q, (len(times), 1))
        if "joint_position" in run:
            guesses = run.Interpolate("joint_position", times)
        for name, (positions, forces) in shown.items():
            figure = f"{path}/{name}"
            is_ghost = name == "ghost"
            looks = RunColor(i), GHOST_OPACITY if is_ghost else 1.0
            _AddFigure(meshcat, figure, visuals, stage, looks)
            height = stage.Up(stage.ghost_height if is_ghost else 0.0)
            meshcat.SetTransform(figure, RigidTransform(height))
            poses = zip(positions, forces / largest, guesses, strict=True)
            _Animate(animation, figure, visuals, stage, poses)
    meshcat.SetAnimation(animation)
    return stage


def _Animate(
    animation: MeshcatAnimation,
    path: str,
    visuals: RobotVisuals,
    stage: Stage,
    frames: Iterable[tuple[Array, Array, Array]],
) -> None:
    """Adds the poses of a robot or ghost, and of its arrow, in each frame.

    Args:
        frames: For each frame the position of the tool in m (n), the force as a share
            of the largest one (n), and a guess of the joint positions (nq).
    """
    for frame, (p_WT, force, q) in enumerate(frames):
        for body, X_WB in visuals.BodyPoses(visuals.Pose(p_WT, q)).items():
            animation.SetTransform(frame, f"{path}/{body}", X_WB)
        p_W = visuals.InSpace(p_WT)
        size = np.linalg.norm(force)
        animation.SetTransform(frame, f"{path}/tip", RigidTransform(p_W))
        # An arrow without length has no direction.
        z_W = InSpace(force) if size > 1e-6 else stage.X_WS.rotation().col(0)
        X_WA = AlongZ(p_W + stage.Up(_ABOVE), z_W)
        animation.SetTransform(frame, f"{path}/force", X_WA)
        scale = np.maximum([size**0.5, size**0.5, size], 1e-6)
        animation.SetProperty(frame, f"{path}/force", "scale", scale.tolist())


def _Figures(run: TaskRecording, times: Array) -> dict[str, tuple[Array, Array]]:
    """Returns positions of the tool in m and forces on it in N, each (N, 3 or less).

    The keys are `robot` and, if there is an operator, `ghost`. Only the first three
    axes are shown: in a packet, other quantities follow the task axes, and with six
    axes the last three are rotations.
    """
    n = min(run["tool_position"].shape[1], 3)

    def At(name: str) -> Array:
        return run.Interpolate(name, times)[:, :n]

    # The recorded force is that of the tool on the environment.
    figures = {"robot": (At("tool_position"), -At("environment_force"))}
    operator = FindOperator(run)
    if operator is not None:
        felt, force = operator
        figures["ghost"] = At(felt), At(force)
    return figures


def _Facing(x_W: Array) -> RotationMatrix:
    """Returns axes with x along a unit vector (3) and z up, or across if x is steep."""
    across = np.eye(3)[2 if abs(x_W[2]) < 0.7 else 0]
    z_W = across - x_W * (across @ x_W)
    z_W /= np.linalg.norm(z_W)
    return RotationMatrix(np.stack([x_W, np.cross(z_W, x_W), z_W], axis=1))


def _Ahead(surface: Surface, p_W: Array) -> float:
    """Returns how far a surface is ahead of a point (3) along its normal, m."""
    normal_W = InSpace(surface.normal_W)
    return float(normal_W @ (InSpace(surface.point_W) - p_W))


def _AllAhead(surfaces: Sequence[Surface], normal_W: Array, p_W: Array) -> list[float]:
    """Returns how far the surfaces with this normal (n) are ahead of a point (3), m."""
    return [_Ahead(x, p_W) for x in surfaces if x.normal_W @ normal_W > 0.99]


def _MakeStage(runs: Sequence[TaskRecording], visuals: RobotVisuals) -> Stage:
    """Returns the stage that shows the task of some runs."""
    surfaces = runs[0].surfaces
    positions = np.concatenate([run["tool_position"] for run in runs])
    n = positions.shape[1]
    normal = ShownNormal(surfaces, n)
    R_WS = _Facing(InSpace(normal))
    points_W = np.array([visuals.InSpace(p) for p in positions])
    points = points_W @ R_WS.matrix()
    start = points[0]
    # The task extends straight from the start to the last surface, and beyond it as far
    # as the tool moves, up to a limit that is larger if no hard surface stops the tool.
    # Without surfaces, it covers all positions of the tool.
    ahead = _AllAhead(surfaces, normal, points_W[0])
    depths = [depth for depth in ahead if np.isfinite(depth)]
    low = min([0.0, *depths])
    high = max([0.0, *depths])
    x_S = np.array([1.0, 0.0, 0.0])
    limit = np.full(3, np.inf)
    if depths:
        is_free = FindSurface(surfaces, CONTACT) is None
        limit = x_S * (_FREE if is_free else _STOPPED) * (high - low)
    task = start + np.outer([low, high], x_S)
    points = np.clip(points, task[0] - limit, task[1] + limit)
    shown = np.concatenate([task, points])
    # A least extent keeps the motion of a large robot recognisable.
    share = _LEAST_SHARE_IN_SPACE if n > 2 else _LEAST_SHARE
    extent = np.ptp(shown, axis=0)
    reach = max(extent.max(), share * np.linalg.norm(start)) or 1.0
    middle = shown.min(axis=0) + extent / 2
    centre = middle + x_S * (reach * (_BEHIND - _BEFORE) / 2)
    return Stage(
        X_WS=RigidTransform(R_WS, R_WS @ centre),
        width=reach * (1 + _BEFORE + _BEHIND),
        ghost_height=_GHOST if any(map(FindOperator, runs)) else 0.0,
    )


def _SetUpView(meshcat: Meshcat, stage: Stage, num_runs: int) -> None:
    """Sets the frame of all drawings, background, lights and camera."""
    meshcat.Delete(ROOT)
    scale = np.diag([_SHOWN_WIDTH / stage.width] * 3 + [1.0])
    meshcat.SetTransform(ROOT, scale @ stage.X_WS.inverse().GetAsMatrix4())
    for path in ("/Grid", "/Axes"):
        meshcat.SetProperty(path, "visible", False)
    meshcat.SetProperty("/Background/<object>", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.88, 0.9, 0.92])
    for name, intensity in _LIGHTS.items():
        meshcat.SetProperty(f"/Lights/{name}/<object>", "intensity", intensity)
    meshcat.SetProperty("/Lights/FillLight/<object>", "position", [-3.0, -8.0, 9.0])
    camera = Meshcat.PerspectiveCamera(
        fov=_FIELD_OF_VIEW, aspect=1.0, near=0.05, far=200.0
    )
    meshcat.SetCamera(camera)
    below = _PITCH * (num_runs - 1)
    shown = max(stage.ghost_height + 2 * _OVERLAP + below, 0.62) * _SHOWN_WIDTH
    distance = 0.62 * shown / np.tan(np.radians(_FIELD_OF_VIEW / 2))
    target = np.array([0.0, 0.0, (stage.ghost_height - below) / 2 * _SHOWN_WIDTH])
    meshcat.SetCameraPose(target + distance * np.array([0.12, -0.96, 0.26]), target)


def _Add(
    meshcat: Meshcat, path: str, shape: Shape, looks: Looks, X: RigidTransform
) -> None:
    meshcat.SetObject(path, shape, Rgba(*to_rgba(*looks)))
    meshcat.SetTransform(path, X)


def _AddSlabs(
    meshcat: Meshcat, path: str, stage: Stage, surfaces: Sequence[Surface]
) -> None:
    """Draws a slab behind each surface, up to the next one or the picture's edge.

    An unknown material is drawn as a thin plate.
    """
    centre_W = stage.X_WS.translation()
    width = stage.width
    height = (stage.ghost_height + 2 * _OVERLAP) * width

    for surface in surfaces:
        begin = _Ahead(surface, centre_W)
        low = max(begin, -width / 2)
        high = begin + _PLATE * width if surface.material is None else width / 2
        begins = _AllAhead(surfaces, surface.normal_W, centre_W)
        high = min([high, *(x for x in begins if x > begin)])
        if not low < high:
            continue
        R_WB = _Facing(InSpace(surface.normal_W))
        middle_B = np.array([(low + high) / 2, 0.0, stage.ghost_height / 2 * width])
        box = Box(high - low, _DEPTH * width, height)
        name = f"{path}/{surface.name}"
        X_WB = RigidTransform(R_WB, centre_W + R_WB @ middle_B)
        _Add(meshcat, name, box, LooksOf(surface), X_WB)
        # Otherwise the slab hides the ghost behind it, which is translucent as well.
        meshcat.SetProperty(f"{name}/<object>", "material.depthWrite", False)
        meshcat.SetProperty(f"{name}/<object>", "castShadow", False)


def _AddFigure(
    meshcat: Meshcat, path: str, visuals: RobotVisuals, stage: Stage, looks: Looks
) -> None:
    """Adds a robot and its arrow; `looks` apply to shapes without a colour."""
    for part in visuals.parts:
        own = looks
        rgba = part.rgba
        if rgba is not None:
            own = (rgba.r(), rgba.g(), rgba.b()), rgba.a() * looks[1]
        name = f"{path}/{part.body}/{part.name}"
        _Add(meshcat, name, part.shape, own, part.X_BG)
    width = stage.width
    ball = Sphere(_TOOL * width)
    _Add(meshcat, f"{path}/tip/ball", ball, looks, RigidTransform())
    # The cone has its point at the origin and its base along z.
    length = _ARROW * width
    head = 0.04 * width
    shaft = Cylinder(0.008 * width, length - head)
    middle = RigidTransform([0.0, 0.0, (length - head) / 2])
    _Add(meshcat, f"{path}/force/shaft", shaft, (FORCE_COLOR, 1.0), middle)
    cone = MeshcatCone(head, head / 2, head / 2)
    point = AlongZ([0.0, 0.0, length], [0.0, 0.0, -1.0])
    _Add(meshcat, f"{path}/force/head", cone, (FORCE_COLOR, 1.0), point)
