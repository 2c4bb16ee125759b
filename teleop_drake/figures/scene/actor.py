"""One run in the scene: robot, ghost, hand, forces and packets."""

from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from numpy.typing import NDArray
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba, Shape, Sphere
from pydrake.math import RigidTransform

from teleop_drake.figures.scene.pen import Pen
from teleop_drake.figures.scene.stage import Stage
from teleop_drake.figures.scene.visuals import AlongZ, RobotVisuals
from teleop_drake.figures.style import RunColor

Array = NDArray[np.float64]

FORCE_COLOR = "#000000"
COMMAND_COLOR = "#CC79A7"
FORWARD_COLOR = "#E69F00"
RETURN_COLOR = "#009E73"
"""Of what is drawn of every run; the robots have the colours of the runs."""

_GHOST_OPACITY = 0.35

NUM_BEADS = 12
"""Number of beads from the tool to the hand."""

# Shares of the shown width.
_TOOL, _HAND_SIZE, _BEAD, _DOT, _COMMAND = 0.009, 0.02, 0.004, 0.011, 0.003
_SHAFT, _HEAD = 0.006, 0.016

# How far above tool and hand their forces are drawn, as a share of the shown width.
_ABOVE = 0.04

LONGEST_ARROW = 0.25
"""Length of the arrow of the largest force, as a share of the shown width."""


@dataclass(kw_only=True)
class Moment:
    """What is seen at an instant. Vectors are along the task axes.

    Attributes:
        tool: p_WT in m (n).
        joints: q of the robot (nq); None: unknown, or it is no plant.
        felt: Where the operator feels the tool, m (n); None: there is no operator.
        command: Where the commanded motion is by now, m (n); None: nobody commands.
        tool_force: Of the environment on the tool, N (n).
        hand_force: What the operator applies, N (n).
        past: Where the tool was when the packets left that are under way now, m
            (k, n), the youngest first.
    """

    tool: Array
    joints: Array | None = None
    felt: Array | None = None
    command: Array | None = None
    tool_force: Array | None = None
    hand_force: Array | None = None
    past: Array | None = None


class Actor:
    """Draws one run.

    The robot is solid, at the bottom. Above it stands the ghost: the robot as the
    operator feels it, with the hand on its tool. Packets go up from the tool to the
    hand and down again; a packet that goes up stays at the x at which the tool was
    when it left, so that those under way trace what the hand is going to feel.

    Args:
        meshcat: Where to.
        path: Of the run.
        run: Its number, from 0 on: decides colour and place.
        visuals: Of its robot.
        stage: The stage.
        newtons: Force of the longest arrow, N.
        num_dots: Number of dots in each direction, for packets.
        has_operator: Whether somebody feels and commands through channels.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        path: str,
        *,
        run: int,
        visuals: RobotVisuals,
        stage: Stage,
        newtons: float,
        num_dots: int = 0,
        has_operator: bool = True,
    ):
        self.path = path
        self._meshcat = meshcat
        self._visuals = visuals
        self._stage = stage
        self._metres_per_newton = LONGEST_ARROW * stage.width / newtons
        self._has_operator = has_operator
        self.num_dots = num_dots if has_operator else 0
        self._tint = RunColor(run)
        meshcat.SetTransform(path, RigidTransform(stage.Offset(run)))
        self._AddRobot("robot", 1.0)
        self._AddArrow("tool_force")
        # A thin upright bar, on both floors at once.
        height = np.linalg.norm(stage.hand) + 0.06 * stage.width
        bar = Cylinder(_COMMAND * stage.width, height)
        X = AlongZ(stage.hand / 2, stage.up)
        self._Add("command/bar", bar, COMMAND_COLOR, X=X)
        if has_operator:
            self._AddRobot("ghost", _GHOST_OPACITY)
            meshcat.SetTransform(f"{path}/ghost", RigidTransform(stage.hand))
            self._AddArrow("hand_force")
            self._Add("hand", Sphere(_HAND_SIZE * stage.width), self._tint)
            for i in range(NUM_BEADS):
                self._Add(f"beads/{i}", Sphere(_BEAD * stage.width), RETURN_COLOR)
            for lane, colour in (("forward", FORWARD_COLOR), ("return", RETURN_COLOR)):
                for i in range(self.num_dots):
                    self._Add(f"{lane}/{i}", Sphere(_DOT * stage.width), colour)

    def _Add(
        self,
        name: str,
        shape: Shape,
        colour: str,
        opacity: float = 1.0,
        X: RigidTransform | None = None,
    ) -> None:
        path = f"{self.path}/{name}"
        self._meshcat.SetObject(path, shape, Rgba(*to_rgb(colour), opacity))
        if X is not None:
            self._meshcat.SetTransform(path, X)

    def _AddRobot(self, name: str, opacity: float) -> None:
        """Adds a robot's shapes, in the run's colour where the model gives none."""
        for part in self._visuals.parts:
            path = f"{name}/{part.body or 'world'}/{part.name}"
            colour, own = self._tint, opacity
            if part.rgba is not None:
                colour = to_hex((part.rgba.r(), part.rgba.g(), part.rgba.b()))
                own = part.rgba.a() * opacity
            self._Add(path, part.shape, colour, own, part.X_BG)
        tip = Sphere(_TOOL * self._stage.width)
        self._Add(f"{name}/tip", tip, self._tint, opacity)

    def _AddArrow(self, name: str) -> None:
        width = self._stage.width
        shaft = Cylinder(_SHAFT * width, 1.0)
        middle = RigidTransform([0, 0, 0.5])
        self._Add(f"{name}/shaft/unit", shaft, FORCE_COLOR, X=middle)
        # Its point is at the cone's origin, and z leads to its base.
        head = MeshcatCone(2 * _HEAD * width, _HEAD * width, _HEAD * width)
        X = AlongZ([0.0, 0.0, 2 * _HEAD * width], [0.0, 0.0, -1.0])
        self._Add(f"{name}/head/cone", head, FORCE_COLOR, X=X)

    def Draw(self, pen: Pen, moment: Moment) -> None:
        """Draws an instant."""
        tool = self._visuals.InSpace(moment.tool)
        joints = moment.joints
        if joints is None and self._visuals.is_plant:
            joints = self._visuals.Pose(moment.tool, self._visuals.start_q)
        self._DrawRobot(pen, "robot", tool, joints)
        self._DrawArrow(pen, "tool_force", tool, moment.tool_force)
        if moment.command is None:
            pen.Show(f"{self.path}/command", False)
        else:
            pen.Move(f"{self.path}/command", self._visuals.InSpace(moment.command))
        if not self._has_operator or moment.felt is None:
            return
        felt = self._visuals.InSpace(moment.felt)
        if joints is not None:
            joints = self._visuals.Pose(moment.felt, joints)
        self._DrawRobot(pen, "ghost", felt, joints)
        hand = felt + self._stage.hand
        pen.Move(f"{self.path}/hand", hand)
        self._DrawArrow(pen, "hand_force", hand, moment.hand_force)
        if moment.past is not None:
            for i, p in enumerate(moment.past):
                height = self._stage.hand * ((i + 1) / (len(moment.past) + 1))
                pen.Move(f"{self.path}/beads/{i}", self._visuals.InSpace(p) + height)

    def _DrawRobot(
        self, pen: Pen, name: str, tool: Array, joints: Array | None
    ) -> None:
        if joints is not None:
            for body, X_WB in self._visuals.BodyPoses(joints).items():
                pen.Place(f"{self.path}/{name}/{body}", X_WB)
        pen.Move(f"{self.path}/{name}/tip", tool)

    def _DrawArrow(self, pen: Pen, name: str, tail: Array, force: Array | None) -> None:
        """Draws a force above a point, at most half as long again as the longest."""
        vector = np.zeros(3) if force is None else self._visuals.Direction(force)
        size = float(np.linalg.norm(vector))
        width = self._stage.width
        length = min(size * self._metres_per_newton, 1.5 * LONGEST_ARROW * width)
        head = min(2 * _HEAD * width, length)
        path = f"{self.path}/{name}"
        tail = tail + self._stage.up * (_ABOVE * width)
        # An arrow without length keeps its direction.
        is_seen = length > 1e-3 * width
        pen.Place(path, AlongZ(tail, vector if is_seen else self._stage.forward))
        pen.Scale(f"{path}/shaft", [1.0, 1.0, max(length - head, 1e-6 * width)])
        pen.Move(f"{path}/head", np.array([0.0, 0.0, length - head]))
        pen.Scale(f"{path}/head", [max(head / (2 * _HEAD * width), 1e-6)] * 3)

    def DotEnds(
        self, lane: str, sent_from: Array, arrives_at: Array
    ) -> tuple[Array, Array]:
        """Returns where a dot begins and ends its way (3) in m.

        Args:
            sent_from: Where the hand or the tool was when it left, m (n).
            arrives_at: Where the tool is when it comes down, m (n).
        """
        begin = self._visuals.InSpace(sent_from)
        if lane == "return":
            return begin, begin + self._stage.hand
        end = self._visuals.InSpace(arrives_at)
        side = self._stage.backward
        return begin + side + self._stage.hand, end + side
