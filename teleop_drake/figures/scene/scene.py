"""The scene of a teleoperation: made once, then drawn at any instant."""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    OutputPort,
)

from teleop_drake.environments import CONTACT, FindSurface, Surface, SurfacesOf
from teleop_drake.figures.scene.actor import NUM_BEADS, Actor, Moment
from teleop_drake.figures.scene.pen import Pen
from teleop_drake.figures.scene.stage import SCENE, MakeStage
from teleop_drake.figures.scene.visuals import RobotVisuals
from teleop_drake.kernel.callbacks import Weakly
from teleop_drake.scenario import AnyScenario, AsScenario, ScenarioLike
from teleop_drake.signals import NamedSignals

Array = NDArray[np.float64]

USED = (
    *("tool_position", "joint_position", "environment_force", "desired_position"),
    *("felt_position", "return_packet_received"),
    *("force_command", "velocity_command", "forward_packet_sent"),
)
"""Every signal that is drawn, as far as the loop has it."""

CHANNELS = {"forward": "forward_channel", "return": "return_channel"}
"""The lanes of the packets, and the fields of a scenario."""


class OperatorSignals(NamedTuple):
    """What the operator feels and commands, at an instant (n) or at many (N, n).

    Attributes:
        felt: p_WT as the operator feels it, m; None: there is no operator.
        velocity: The commanded velocity, m/s; likewise.
        force: What the operator applies, N; likewise.
    """

    felt: Array | None = None
    velocity: Array | None = None
    force: Array | None = None


def FindOperator(signals: Mapping[str, Array], num_axes: int) -> OperatorSignals:
    """Returns the operator's part of the signals of any architecture."""
    n = num_axes
    if "felt_position" in signals:
        names = ("felt_position", "velocity_command", "force_command")
        return OperatorSignals(*(signals[name] for name in names))
    if "return_packet_received" in signals:  # The thesis's own packets.
        felt = signals["return_packet_received"][..., :n]
        sent = signals["forward_packet_sent"]
        return OperatorSignals(felt, sent[..., n : 2 * n], sent[..., :n])
    return OperatorSignals()


class Scene(LeafSystem):
    """Draws a teleoperation in Meshcat while it is simulated (no equation; a picture).

    | port | name                | size | unit     |
    |------|---------------------|------|----------|
    | in   | one for each signal | any  | see USED |

    State: none. It publishes periodically; the solver's steps end there. It shows one
    run: the robot at the bottom, what the operator feels above it, and beads in between
    which trace what is under way; see Actor. It remembers what it has drawn, for beads
    show what was. That is a picture's memory: the simulation does not depend on it.

    Args:
        meshcat: Where to. What the package has drawn there before is deleted.
        scenario: Of the run.
        surfaces: Of the environment.
        sizes: The sizes of the signals, by their names in USED.
        period: Between two pictures, s.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        scenario: AnyScenario,
        *,
        surfaces: Sequence[Surface],
        sizes: Mapping[str, int],
        period: float,
    ):
        LeafSystem.__init__(self)
        self._names = list(sizes)
        for name, size in sizes.items():
            self.DeclareVectorInputPort(name, size)
        self.DeclarePeriodicPublishEvent(period, 0.0, Weakly(self._Publish))
        self._pen = Pen(meshcat)
        self._num_axes = scenario.num_axes
        visuals = RobotVisuals(scenario.robot)
        channel = getattr(scenario, CHANNELS["return"], None)
        self._has_operator = channel is not None
        self._delay = 0.0 if channel is None else channel.delay
        self._start = start = np.array(scenario.robot.start, dtype=float)
        reach = _Reach(scenario, start, surfaces)
        stage = MakeStage(visuals, surfaces, reach, has_operator=self._has_operator)
        stage.SetUpView(meshcat)
        stage.DrawSlabs(meshcat, f"{SCENE}/environment", visuals, surfaces)
        self._actor = Actor(
            meshcat,
            f"{SCENE}/run",
            run=0,
            visuals=visuals,
            stage=stage,
            newtons=NewtonsOf(scenario),
            has_operator=self._has_operator,
        )
        self._history: deque[tuple[float, Array]] = deque()
        self._command = start

    def _Publish(self, context: Context) -> EventStatus:
        """Draws an instant; one that is earlier than the last one begins anew."""
        time = context.get_time()
        values = {name: self.GetInputPort(name).Eval(context) for name in self._names}
        operator = FindOperator(values, self._num_axes)
        tool = values["tool_position"]
        if self._history and time < self._history[-1][0]:
            self._history.clear()
        if not self._history:
            self._command = self._start
        elif operator.velocity is not None:
            step = time - self._history[-1][0]
            self._command = self._command + operator.velocity * step
        self._history.append((time, tool))
        while time - self._history[0][0] > self._delay + 1:
            self._history.popleft()
        command = past = None
        if self._has_operator:
            command = self._command
            known, tools = map(np.array, zip(*self._history, strict=True))
            past = Between(time - BeadAges(self._delay), known, tools)
        self._actor.Draw(
            self._pen,
            Moment(
                tool=tool,
                joints=values.get("joint_position"),
                felt=operator.felt,
                command=values.get("desired_position", command),
                tool_force=Opposite(values.get("environment_force")),
                hand_force=operator.force,
                past=past,
            ),
        )
        return EventStatus.Succeeded()


def BeadAges(delay: float) -> Array:
    """Returns how long ago the packets left that the beads are, s."""
    return np.arange(1, NUM_BEADS + 1) / (NUM_BEADS + 1) * delay


def Between(times: Array, known: Array, values: Array) -> Array:
    """Returns values (N, k) between those at known times (M, k), clamped to these."""
    return np.stack([np.interp(times, known, x) for x in values.T], -1)


def Opposite(force: Array | None) -> Array | None:
    """Returns the force on the tool, given that of the tool on the environment."""
    return None if force is None else -force


def NewtonsOf(scenario: AnyScenario) -> float:
    """Returns the force in N that has the longest arrow while a simulation runs.

    The one that the operator holds on contact has an arrow of half that length.
    """
    operator = getattr(scenario, "surgeon", None)
    force = getattr(operator, "contact_force", None)
    return 2 * float(np.linalg.norm(0.0 if force is None else force)) or 1.0


def _Reach(scenario: AnyScenario, start: Array, surfaces: Sequence[Surface]) -> Array:
    """Returns the start, and where the command leads to if nothing hard is ahead."""
    if FindSurface(surfaces, CONTACT) is not None:
        return start[np.newaxis]
    operator = getattr(scenario, "surgeon", None)
    velocity = getattr(operator, "velocity", None)
    if velocity is None:
        return np.array([start - 0.3, start + 0.3])
    return np.array([start, start + np.asarray(velocity) * scenario.duration])


def AddScene(
    builder: DiagramBuilder,
    scenario: ScenarioLike,
    meshcat: Meshcat,
    *,
    period: float = 1 / 32,
) -> Scene:
    """Adds a picture of the loop to its diagram; afterwards every simulation is seen.

    Call it after AddTeleoperator(), or after the systems of a tracking were added.

    Args:
        builder: Of the diagram, with `robot` and what else there is of the loop.
        scenario: What it was made for, or its name or file.
        period: Between two pictures, s. The solver's steps end there.

    Returns:
        The scene.

    Raises:
        RuntimeError: If there is no robot, or it does not tell where its tool is.
    """
    systems = builder.GetSystems()
    signals: dict[str, OutputPort] = NamedSignals(systems)
    if "tool_position" not in signals:
        raise RuntimeError("scene: the diagram must have a signal 'tool_position'")
    surfaces: Sequence[Surface] = ()
    if builder.HasSubsystemNamed("environment"):
        surfaces = SurfacesOf(builder.GetSubsystemByName("environment")) or ()
    used = {name: signals[name] for name in USED if name in signals}
    sizes = {name: port.size() for name, port in used.items()}
    scenario = AsScenario(scenario)
    scene = Scene(meshcat, scenario, surfaces=surfaces, sizes=sizes, period=period)
    builder.AddNamedSystem("scene", scene)
    for name, port in used.items():
        builder.Connect(port, scene.GetInputPort(name))
    return scene
