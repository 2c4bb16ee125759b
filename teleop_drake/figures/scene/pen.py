"""What the scene is drawn with: now, or at an instant of an animation."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat, MeshcatAnimation
from pydrake.math import RigidTransform

Array = NDArray[np.float64]

FRAMES_PER_SECOND = 1000
"""Of animations. Most frames are empty: what is in between is interpolated."""


class Pen:
    """Moves what is in Meshcat, at once or in an animation.

    Args:
        meshcat: Where everything stands.
        animation: What is written down instead of moving anything; None: nothing.
    """

    def __init__(self, meshcat: Meshcat, animation: MeshcatAnimation | None = None):
        self._meshcat = meshcat
        self._animation = animation
        self.frame = 0

    def At(self, time: float) -> "Pen":
        """Chooses the instant in s of what follows, in an animation.

        Args:
            time: From 0 on.
        """
        self.frame = round(time * FRAMES_PER_SECOND)
        return self

    def Place(self, path: str, X: RigidTransform) -> None:
        """Gives an object its pose.

        Args:
            path: Of the object.
            X: Pose in that of its parent.
        """
        if self._animation is None:
            self._meshcat.SetTransform(path, X)
        else:
            self._animation.SetTransform(self.frame, path, X)

    def Move(self, path: str, p: Array) -> None:
        """Moves an object without turning it.

        Args:
            path: Of the object.
            p: Position in its parent (3), m.
        """
        self._SetVector(path, "position", p.tolist())

    def Scale(self, path: str, factors: Sequence[float]) -> None:
        """Stretches an object along its own axes.

        Args:
            path: Of the object.
            factors: Not zero (3).
        """
        self._SetVector(path, "scale", list(factors))

    def _SetVector(self, path: str, name: str, value: list[float]) -> None:
        if self._animation is None:
            self._meshcat.SetProperty(path, name, value)
        else:
            self._animation.SetProperty(self.frame, path, name, value)

    def Show(self, path: str, is_shown: bool) -> None:
        """Shows or hides an object.

        Args:
            path: Of the object.
            is_shown: Whether it is seen from now on.
        """
        if self._animation is None:
            self._meshcat.SetProperty(path, "visible", is_shown)
        else:
            self._animation.SetProperty(self.frame, path, "visible", is_shown)
