"""The scene: a teleoperation in three dimensions, in Meshcat."""

from teleop_drake.figures.scene.page import MakeReplay, Replay
from teleop_drake.figures.scene.scene import AddScene, MakeScene, Scene

__all__ = ["AddScene", "MakeReplay", "MakeScene", "Replay", "Scene"]
