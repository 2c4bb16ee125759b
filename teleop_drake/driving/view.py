"""The view of a drive: the scene, and strips of the felt force."""

from collections import deque
from collections.abc import Mapping

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.textpath import TextPath
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform

from teleop_drake.driving.controls import FullSpeed
from teleop_drake.figures.scene import Scene
from teleop_drake.figures.scene.scene import NewtonsOf
from teleop_drake.figures.style import COLORS, GREY
from teleop_drake.scenario import Scenario

Array = NDArray[np.float64]

SPAN = 8.0
"""What the strips show of the past, s."""

_PATH = "/driving"

# In the stage's units, of which the scene shows 2: the strips stand above the ghost,
# where no part of a robot comes to be in front of them.
_WIDTH, _HEIGHT = 1.4, 0.12
_FORCE_Z, _SPEED_Z = 0.83, 0.69
_LETTERS = 0.03


class View:
    """Draws the scene and two strips above it: force and speed that the hand feels.

    A strip shows the last SPAN seconds, now at the right; of each task axis a line in
    its own colour, full scale up to the frame. The upper one is the force.

    Args:
        meshcat: Where to.
        newtons: Force at the frame, N.
        speed: Speed at the frame, m/s.
    """

    def __init__(self, meshcat: Meshcat, *, newtons: float, speed: float):
        self._meshcat = meshcat
        self._scales = {"force": newtons, "speed": speed}
        self._scene: Scene | None = None
        self._past: deque[tuple[float, Array, Array]] = deque()
        self._num_drawn = 0

    def Begin(self, scenario: Scenario) -> None:
        """Begins a segment."""
        self._scene = Scene(self._meshcat, scenario)
        self._past.clear()
        for name, z, unit in (("force", _FORCE_Z, "N"), ("speed", _SPEED_Z, "m/s")):
            path = f"{_PATH}/{name}"
            text = f"{name} felt, ±{self._scales[name]:.2g} {unit}"
            ends = _Letters(text)
            self._meshcat.SetLineSegments(f"{path}/label", *ends, 1.0, Rgba(0, 0, 0, 1))
            self._meshcat.SetObject(
                f"{path}/frame",
                Box(_WIDTH, 0.002, _HEIGHT),
                Rgba(*to_rgb(GREY), 0.15),
            )
            self._meshcat.SetTransform(path, RigidTransform([0.0, 0.0, z]))
            zero = np.array([[-_WIDTH / 2, _WIDTH / 2], [0.0, 0.0], [0.0, 0.0]])
            self._meshcat.SetLine(f"{path}/zero", zero, 1.0, Rgba(*to_rgb(GREY)))

    def Draw(
        self,
        time: float,
        signals: Mapping[str, Array],
        force: Array,
        velocity: Array,
    ) -> None:
        """Draws an instant."""
        assert self._scene is not None
        self._scene.Draw(time, signals)
        self._past.append((time, np.array(force), np.array(velocity)))
        while self._past[0][0] < time - SPAN:
            self._past.popleft()
        # Every other picture: a line is sent as a whole.
        self._num_drawn += 1
        if self._num_drawn % 2 == 0:
            self._DrawStrips(time)

    def _DrawStrips(self, time: float) -> None:
        times = np.array([entry[0] for entry in self._past])
        x = (0.5 - (time - times) / SPAN) * _WIDTH
        if len(x) < 2:
            return
        for column, (name, scale) in enumerate(self._scales.items(), start=1):
            values = np.array([entry[column] for entry in self._past]) / scale
            heights = np.clip(values, -1.0, 1.0) * _HEIGHT / 2
            for axis in range(heights.shape[1]):
                vertices = np.array([x, np.full_like(x, -0.01), heights[:, axis]])
                colour = Rgba(*to_rgb(COLORS[axis % len(COLORS)]))
                self._meshcat.SetLine(
                    f"{_PATH}/{name}/line_{axis}", vertices, 3.0, colour
                )


def _Letters(text: str) -> tuple[Array, Array]:
    """Returns where the lines of a text in a strip begin and end (3, k each)."""
    corner = 0.01 - _WIDTH / 2, _HEIGHT / 2 - _LETTERS
    polygons = TextPath(corner, text, size=_LETTERS).to_polygons()
    outlines = [np.insert(np.asarray(x), 1, -0.01, axis=1) for x in polygons]
    begins = np.vstack([outline[:-1] for outline in outlines])
    ends = np.vstack([outline[1:] for outline in outlines])
    return begins.T, ends.T


def MakeView(meshcat: Meshcat, scenario: Scenario) -> View:
    """Makes the view of a scenario."""
    return View(meshcat, newtons=NewtonsOf(scenario), speed=FullSpeed(scenario))
