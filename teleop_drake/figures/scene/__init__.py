"""The scene: a teleoperation in three dimensions, in Meshcat."""

from teleop_drake.figures.scene.scene import AddScene, MakeScene, Scene

__all__ = ["AddScene", "MakeScene", "Scene"]
