"""A hand in the loop: real time, in a browser."""

from teleop_drake.driving.controls import MakeControls, MeshcatControls
from teleop_drake.driving.drive import AsRecorded, Drive, Segment
from teleop_drake.driving.score import Score, Scores
from teleop_drake.driving.scripted import ScriptedHand
from teleop_drake.driving.settings import Settings
from teleop_drake.driving.view import MakeView, View

__all__ = [
    "AsRecorded",
    "Drive",
    "MakeControls",
    "MakeView",
    "MeshcatControls",
    "Score",
    "Scores",
    "ScriptedHand",
    "Segment",
    "Settings",
    "View",
]
