"""The scene: a teleoperation in three dimensions, in Meshcat."""

from teleop_drake.figures.scene.replay import MakeReplay, Replay
from teleop_drake.figures.scene.scene import AddScene, Scene

__all__ = ["AddScene", "MakeReplay", "Replay", "Scene"]
