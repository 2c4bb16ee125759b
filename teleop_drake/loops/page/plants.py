"""The MultibodyPlants of a diagram as a page draws them: frames and links."""

from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, System

from teleop_drake.loops.engine.plant_tree import ReadPlantTree
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import PathsIn
from teleop_drake.loops.numerics.rigid_body import RigidBodyTree, calc_motion

# The directions to the right and upwards in a drawing of joints about several axes,
# which is a view from the side and from above.
_OBLIQUE = [[0.866, -0.5, 0.0], [0.25, 0.433, 0.866]]

_PARALLEL = 1e-6


def TreesIn(
    diagram: System, context: Context, left_out: Collection[str] = ()
) -> dict[str, RigidBodyTree]:
    """Returns the links of each MultibodyPlant, keyed by the plant's path.

    Args:
        left_out: The paths of plants that do not move in the page.
    """
    contexts = ContextsIn(diagram, context)
    return {
        path: ReadPlantTree(system, contexts[system]).tree
        for system, path in PathsIn(diagram)
        if isinstance(system, MultibodyPlant) and path not in left_out
    }


def PlantData(path: str, tree: RigidBodyTree) -> dict[str, Any]:
    """Returns the links of a plant, and the name of the port with its state.

    Each link has its `parent` (-1: the world), the `frame` of its joint in the parent's
    frame as [R, p] (3, 4), the `axis` of the joint, `turns`, which is False for a
    prismatic joint, and its `centre` of mass.
    """
    masses = np.where(tree.masses > 0, tree.masses, np.inf)
    centres = tree.moments / masses[:, np.newaxis]
    links = [
        {
            "parent": int(tree.parents[i]),
            "turns": not tree.is_prismatic[i],
            "frame": tree.frames[i].tolist(),
            "axis": tree.axes[i].tolist(),
            "centre": centres[i].tolist(),
        }
        for i in range(len(masses))
    ]
    return {"state": f"{path}:state", "links": links}


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
