"""The scene: a teleoperation in three dimensions, in Meshcat."""

from teleop_drake.study.figures.scene.replay import MakeReplay, Replay

__all__ = ["MakeReplay", "Replay"]
