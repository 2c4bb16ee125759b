"""The scene: a teleoperation in three dimensions, in Meshcat."""

from teleop_drake.figures.scene.replay import MakeReplay, Replay

__all__ = ["MakeReplay", "Replay"]
