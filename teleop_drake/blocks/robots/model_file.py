"""Model files as plants."""

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.arrays import ArrayLike

# What the plants made just now tell their shapes to; None: to nobody.
_SCENE_GRAPH: ContextVar[SceneGraph | None] = ContextVar("scene_graph", default=None)


def ReadModel(name: str) -> ElementTree.Element:
    """Returns the SDF model of this name in the package."""
    file = Path(__file__).parents[2] / "models" / f"{name}.sdf"
    return ElementTree.fromstring(file.read_text(encoding="utf-8"))


@contextlib.contextmanager
def TellingShapes(scene_graph: SceneGraph) -> Iterator[None]:
    """Lets the plants that are made meanwhile tell their shapes, for a picture.

    A plant that is simulated does not tell any: they would cost time and serve nobody.
    """
    token = _SCENE_GRAPH.set(scene_graph)
    try:
        yield
    finally:
        _SCENE_GRAPH.reset(token)


@contextlib.contextmanager
def NewPlant(gravity: ArrayLike | None = None) -> Iterator[MultibodyPlant]:
    """Gives a continuous plant named `plant`, and finalizes it at the end.

    Args:
        gravity: Acceleration of gravity along the first axes of the world, m/s^2 (1 to
            3); None: Drake's own, across the x-y plane.
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
        model: Such as ReadModel() returns.
        gravity: Acceleration of gravity along the first axes of the world, m/s^2 (1 to
            3); None: none.
    """
    with NewPlant(gravity) as plant:
        text = ElementTree.tostring(model, encoding="unicode")
        Parser(plant).AddModelsFromString(text, "sdf")
    return plant
