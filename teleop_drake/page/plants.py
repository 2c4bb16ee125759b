"""The MultibodyPlants of a diagram as a page draws them: frames and links."""

from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, System

from teleop_drake.arrays import Array
from teleop_drake.blocks.systems.plant_tree import ReadPlantTree
from teleop_drake.contexts import ContextsIn
from teleop_drake.signals import PathsIn

# The directions to the right and upwards in a drawing of joints about several axes,
# which is a view from the side and from above.
_OBLIQUE = [[0.866, -0.5, 0.0], [0.25, 0.433, 0.866]]

_PARALLEL = 1e-6


def PlantsIn(diagram: System, context: Context) -> list[dict[str, Any]]:
    """Returns the links of each plant, and the name of the port with its state.

    Each link has its `parent` (-1: the world), the `frame` of its joint in the parent's
    frame as [R, p] (3, 4), the `axis` of the joint, `turns`, which is False for a
    prismatic joint, and its `centre` of mass.
    """
    contexts = ContextsIn(diagram, context)
    plants = []
    for system, path in PathsIn(diagram):
        if not isinstance(system, MultibodyPlant):
            continue
        tree = ReadPlantTree(system, contexts[system]).tree
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
        plants.append({"state": f"{path}:state", "links": links})
    return plants


def ViewOf(plants: list[dict[str, Any]]) -> list[list[float]]:
    """Returns the directions to the right and upwards in the drawing of plants."""
    axes = [axis for plant in plants for axis in _AxesOf(plant["links"])]
    # If all joints turn about one axis, it points out of the picture.
    for k in (1, 0, 2):
        if all(abs(abs(axis[k]) - 1) < _PARALLEL for axis in axes):
            view: list[list[float]] = np.delete(np.eye(3), k, axis=0).tolist()
            return view
    return _OBLIQUE


def _AxesOf(links: list[dict[str, Any]]) -> list[Array]:
    """Returns the axes of the revolute joints in the world frame at q = 0."""
    rotations = [np.eye(3)]
    axes = []
    for link in links:
        frame = np.array(link["frame"])
        R = rotations[link["parent"] + 1] @ frame[:, :3]
        rotations.append(R)
        if link["turns"]:
            axes.append(R @ link["axis"])
    return axes
