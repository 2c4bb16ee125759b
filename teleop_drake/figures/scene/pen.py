"""Pen of the scene: it draws now, or at an instant of an animation."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import Meshcat, MeshcatAnimation
from pydrake.math import RigidTransform

Array = NDArray[np.float64]

FRAMES_PER_SECOND = 1000
"""Of animations. Most frames are empty: what is in between is interpolated."""

# Largest error of that, as a share of the range of what moves.
_TOLERANCE = 5e-4


class Pen:
    """Moves what is in Meshcat at once."""

    def __init__(self, meshcat: Meshcat):
        self._meshcat = meshcat

    def Place(self, path: str, X: RigidTransform) -> None:
        """Gives an object its pose."""
        self._meshcat.SetTransform(path, X)

    def _Set(self, path: str, name: str, value: list[float] | bool) -> None:
        self._meshcat.SetProperty(path, name, value)

    def Move(self, path: str, p: Array) -> None:
        """Moves an object without turning it."""
        self._Set(path, "position", p.tolist())

    def Scale(self, path: str, factors: Sequence[float]) -> None:
        """Stretches an object along its own axes."""
        self._Set(path, "scale", list(factors))

    def Show(self, path: str, is_shown: bool) -> None:
        """Shows or hides an object."""
        self._Set(path, "visible", is_shown)


class AnimationPen(Pen):
    """Writes down where everything is when, and makes an animation of it.

    What the interpolation between other frames tells as well is left out.
    """

    def __init__(self) -> None:
        self._frame = 0
        # By path and property: the values of the frames.
        self._tracks: dict[tuple[str, str], dict[int, Any]] = {}

    def At(self, time: float) -> "AnimationPen":
        """Chooses the instant of what follows."""
        self._frame = round(time * FRAMES_PER_SECOND)
        return self

    def Place(self, path: str, X: RigidTransform) -> None:
        """Gives an object its pose; see Pen."""
        q = X.rotation().ToQuaternion().wxyz()
        if track := self._tracks.get((path, "pose")):
            # q and -q are the same rotation; half way between them is none.
            q = q if q @ next(reversed(track.values()))[3:] >= 0 else -q
        self._Set(path, "pose", [*X.translation(), *q])

    def _Set(self, path: str, name: str, value: list[float] | bool) -> None:
        self._tracks.setdefault((path, name), {})[self._frame] = value

    def MakeAnimation(self) -> MeshcatAnimation:
        """Returns what was written down."""
        animation = MeshcatAnimation(frames_per_second=FRAMES_PER_SECOND)
        for (path, name), track in self._tracks.items():
            frames = sorted(track)
            if name != "visible":
                values = np.array([track[frame] for frame in frames])
                needed = NeededFrames(np.array(frames), values)
                frames = [frames[i] for i in needed]
            for frame in frames:
                value = track[frame]
                if name == "pose":
                    rotation = np.array(value[3:]) / np.linalg.norm(value[3:])
                    X = RigidTransform(Quaternion(wxyz=rotation), value[:3])
                    animation.SetTransform(frame, path, X)
                else:
                    animation.SetProperty(frame, path, name, value)
        return animation


def NeededFrames(frames: Array, values: Array) -> list[int]:
    """Returns which samples a linear interpolation needs to tell all others.

    By Douglas' and Peucker's algorithm: the sample that is farthest from the line
    between two others is needed, until none is far from it.

    Args:
        frames: Ascending (N,).
        values: (N, k).
    """
    ranges = np.ptp(values, axis=0)
    tolerance = _TOLERANCE * max(float(ranges.max()), 1e-12)
    needed = {0, len(frames) - 1}
    open_spans = [(0, len(frames) - 1)]
    while open_spans:
        first, last = open_spans.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        share = (frames[inner] - frames[first]) / (frames[last] - frames[first])
        line = values[first] + share[:, np.newaxis] * (values[last] - values[first])
        errors = np.abs(values[inner] - line).max(axis=1)
        worst = int(errors.argmax())
        if errors[worst] > tolerance:
            middle = first + 1 + worst
            needed.add(middle)
            open_spans += [(first, middle), (middle, last)]
    return sorted(needed)
