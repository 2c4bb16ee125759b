"""The MultibodyPlants of a diagram as a page draws them: frames, links and shapes."""

import itertools
from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import (
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Role,
    SceneGraph,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, FrameIndex
from pydrake.systems.framework import Context, System

from teleop_drake.loops.engine.plant_tree import PlantTree, ReadPlantTree
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import PathsIn
from teleop_drake.loops.numerics.rigid_body import RigidBodyTree, calc_motion

# The directions to the right and upwards in a drawing of joints about several axes,
# which is a view from the side and from above.
_OBLIQUE = [[0.866, -0.5, 0.0], [0.25, 0.433, 0.866]]

_PARALLEL = 1e-6

# Points of a circle and of a ball of radius 1 m, and the corners of a box.
_TURNS = 2 * np.pi * np.arange(24) / 24
_CIRCLE = np.stack([np.cos(_TURNS), np.sin(_TURNS), 0 * _TURNS], axis=1)
_BALL = np.concatenate(
    [
        np.cos(height) * _CIRCLE + [0.0, 0.0, np.sin(height)]
        for height in np.pi * np.arange(-3, 4) / 8
    ]
)
_CORNERS = np.array([*itertools.product((-1.0, 1.0), repeat=3)])

_DIGITS = 5  # of places in m, in the page.


class PlantPicture(NamedTuple):
    """What a page draws of a MultibodyPlant.

    Attributes:
        tree: The links.
        tips: For each link, the places of the frames that are fixed to it, in its
            frame, m (each 3).
        shapes: For each shape, its link (-1: the world) and points whose convex hull it
            is, in the link's frame, m (each 3).
    """

    tree: RigidBodyTree
    tips: list[list[list[float]]]
    shapes: list[tuple[int, list[list[float]]]]


def PlantPictures(
    diagram: System, context: Context, left_out: Collection[str] = ()
) -> dict[str, PlantPicture]:
    """Returns the picture of each MultibodyPlant, keyed by the plant's path.

    Args:
        diagram: The diagram.
        context: Its Context.
        left_out: The paths of plants that do not move in the page.
    """
    contexts = ContextsIn(diagram, context)
    inspectors = [
        system.model_inspector()
        for system in contexts
        if isinstance(system, SceneGraph)
    ]
    pictures = {}
    for system, path in PathsIn(diagram):
        if isinstance(system, MultibodyPlant) and path not in left_out:
            plant = ReadPlantTree(system, contexts[system])
            shapes = [x for inspector in inspectors for x in _Shapes(system, inspector)]
            pictures[path] = PlantPicture(
                plant.tree,
                _Tips(system, plant),
                [_InLink(plant, *shape) for shape in shapes],
            )
    return pictures


def _InLink(
    read: PlantTree, body: int, X_BG: RigidTransform, points: Array
) -> tuple[int, list[list[float]]]:
    """Returns the link of a body, and points on the body in the link's frame."""
    link, X_LB = read.poses[body]
    return link, (X_LB @ X_BG @ points.T).T.round(_DIGITS).tolist()


def _Tips(plant: MultibodyPlant, read: PlantTree) -> list[list[list[float]]]:
    """Returns the places of the frames fixed to each link; see PlantPicture."""
    tips: list[list[list[float]]] = [[] for _ in read.tree.parents]
    for frame in map(plant.get_frame, map(FrameIndex, range(plant.num_frames()))):
        link, X_LB = read.poses[int(frame.body().index())]
        X_LF = X_LB @ frame.GetFixedPoseInBodyFrame()
        place = X_LF.translation().round(_DIGITS).tolist()
        if link >= 0 and any(place) and place not in tips[link]:
            tips[link].append(place)
    return tips


def _Shapes(
    plant: MultibodyPlant, inspector: SceneGraphInspector
) -> list[tuple[int, RigidTransform, Array]]:
    """Returns the illustration shapes of a plant or, without any, its collision shapes.

    Each has the index of its body, its pose there, and points of its hull (m, 3).
    """
    source = plant.get_source_id()
    if source is None or not inspector.SourceIsRegistered(source):
        return []
    bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
    frames = [(int(b.index()), plant.GetBodyFrameIdIfExists(b.index())) for b in bodies]
    for role in (Role.kIllustration, Role.kProximity):
        shapes = [
            (body, inspector.GetPoseInFrame(geometry), _PointsOf(inspector, geometry))
            for body, frame in frames
            if frame is not None
            for geometry in inspector.GetGeometries(frame, role)
        ]
        found = [shape for shape in shapes if len(shape[2])]
        if found:
            return found
    return []


def _PointsOf(inspector: SceneGraphInspector, geometry: GeometryId) -> Array:
    """Returns points whose hull is a shape; a mesh is its box, a half space nothing."""
    shape = inspector.GetShape(geometry)
    if isinstance(shape, Sphere):
        return shape.radius() * _BALL
    if isinstance(shape, Ellipsoid):
        return np.array([shape.a(), shape.b(), shape.c()]) * _BALL
    if isinstance(shape, (Capsule, Cylinder)):
        half = [0.0, 0.0, shape.length() / 2]
        end = shape.radius() * (_BALL if isinstance(shape, Capsule) else _CIRCLE)
        return np.concatenate([end + half, end - half])
    box = inspector.GetObbInGeometryFrame(geometry)
    if box is None:
        return np.zeros((0, 3))
    return (box.pose() @ (box.half_width() * _CORNERS).T).T


def PlantData(path: str, picture: PlantPicture) -> dict[str, Any]:
    """Returns the links of a plant, and the name of the port with its state.

    Each link has its `parent` (-1: the world), the `frame` of its joint in the parent's
    frame as [R, p] (3, 4), the `axis` of the joint, `turns`, which is False for a
    prismatic joint, its `centre` of mass and its `tips`. Each of the `shapes` has its
    `link` and `points`; see PlantPicture.
    """
    tree = picture.tree
    masses = np.where(tree.masses > 0, tree.masses, np.inf)
    centres = tree.moments / masses[:, np.newaxis]
    links = [
        {
            "parent": int(tree.parents[i]),
            "turns": not tree.is_prismatic[i],
            "frame": tree.frames[i].tolist(),
            "axis": tree.axes[i].tolist(),
            "centre": centres[i].tolist(),
            "tips": picture.tips[i],
        }
        for i in range(len(masses))
    ]
    shapes = [{"link": link, "points": points} for link, points in picture.shapes]
    return {"state": f"{path}:state", "links": links, "shapes": shapes}


def ViewOf(trees: Iterable[RigidBodyTree]) -> list[list[float]]:
    """Returns the directions to the right and upwards in the drawing of plants."""
    axes = [axis for tree in trees for axis in _AxesOf(tree)]
    # If all joints turn about one axis, it points out of the picture.
    for k in (1, 0, 2):
        if all(abs(abs(axis[k]) - 1) < _PARALLEL for axis in axes):
            view: list[list[float]] = np.delete(np.eye(3), k, axis=0).tolist()
            return view
    return _OBLIQUE


def _AxesOf(tree: RigidBodyTree) -> list[Array]:
    """Returns the axes of the revolute joints in the world frame at q = 0."""
    at_rest = np.zeros(len(tree.parents))
    rotations = [S[:3] for S in calc_motion(tree, at_rest, at_rest).S]
    return [axis for axis in rotations if axis.any()]
