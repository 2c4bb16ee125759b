"""What one sees while driving: the scene, and strips of what is felt."""

from collections import deque
from collections.abc import Mapping

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform

from teleop_drake.driving.controls import FullSpeed
from teleop_drake.figures.scene import MakeScene, Scene
from teleop_drake.figures.scene.scene import NewtonsOf
from teleop_drake.figures.style import COLORS, GREY
from teleop_drake.scenario import Scenario

Array = NDArray[np.float64]

SPAN = 8.0
"""What the strips show of the past, s."""

_PATH = "/driving"

# In the stage's units, of which the scene shows 2: the strips stand below the tool.
_WIDTH, _HEIGHT = 1.6, 0.14
_FORCE_Z, _SPEED_Z = -0.37, -0.53


class View:
    """Draws the scene and two strips below it: force and speed that the hand feels.

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
        """Begins a segment.

        Args:
            scenario: As it is driven.
        """
        self._scene = MakeScene(scenario, self._meshcat)
        self._past.clear()
        for name, z in (("force", _FORCE_Z), ("speed", _SPEED_Z)):
            path = f"{_PATH}/{name}"
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
        """Draws an instant.

        Args:
            time: In s.
            signals: As Scene.Draw() takes them.
            force: That the hand feels, N (n).
            velocity: That it feels, m/s (n).
        """
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


def MakeView(meshcat: Meshcat, scenario: Scenario) -> View:
    """Makes the view of a scenario.

    Args:
        meshcat: Where to.
        scenario: As it was loaded.
    """
    return View(meshcat, newtons=NewtonsOf(scenario), speed=FullSpeed(scenario))
